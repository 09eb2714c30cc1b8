"""Render, then solve, gives the normal back; and what shadow, saturation, noise and scale do to it."""

import numpy as np
import pytest

from itree_jax.sensing.albedo import dominant_albedo
from itree_jax.sensing.photometric import least_squares, photometric_stereo
from itree_jax.sensor import Noise

NOISE = Noise()
LIMIT = np.radians(42.0)


def slant(normals):
    return np.arccos(np.clip(-normals[..., 2], -1, 1))


def as_float32(images):
    return images.astype(np.float32)


@pytest.mark.parametrize("lights", [3, 4, 6])
def test_a_sphere_is_recovered_exactly(lights, make_lights, sphere, shade, angle_between):
    L, e = make_lights(lights), np.linspace(0.8, 1.2, lights)
    needle = photometric_stereo(as_float32(shade(sphere, L, e)), L, e, NOISE)
    inside = slant(sphere) < LIMIT - np.radians(0.5)
    assert np.asarray(needle.interpretable)[inside].all()
    there = np.asarray(needle.interpretable)
    assert angle_between(needle.normals, sphere)[inside].max() < 1e-5
    assert angle_between(needle.normals, sphere)[there].max() < 1e-4  # grazing: three lights side by side
    np.testing.assert_allclose(np.asarray(needle.albedo)[there], 0.6, rtol=1e-4)
    np.testing.assert_allclose(np.asarray(needle.confidence)[there], 1.0, atol=1e-3)
    assert not np.asarray(needle.shadowed)[:, inside].any()


def test_three_lights_are_interpretable_exactly_within_the_ratio_of_the_slant_limit(make_lights, sphere, shade):
    L, e = make_lights(3), np.ones(3)
    images = shade(sphere, L, e)
    azimuth = np.linspace(0, 2 * np.pi, 3600)
    rim = np.stack([np.cos(azimuth) * np.sin(LIMIT), np.sin(azimuth) * np.sin(LIMIT), -np.cos(LIMIT) + 0 * azimuth], 1)
    least = ((rim @ L.T).min(1) / (rim @ L.T).max(1)).min()
    ratio = images.min(0) / np.maximum(images.max(0), 1e-9)
    needle = photometric_stereo(as_float32(images), L, e, NOISE)
    sure = np.abs(ratio - least) > 1e-3
    np.testing.assert_array_equal(np.asarray(needle.interpretable)[sure], (ratio > least)[sure])
    background = slant(sphere) > np.radians(89.9)
    assert not np.asarray(needle.normals)[background].any()


def test_stronger_lights_change_the_albedo_only(make_lights, sphere, shade):
    L, e = make_lights(3), np.array([1.0, 0.9, 1.1])
    images = as_float32(shade(sphere, L, e, albedo=0.4))
    once = photometric_stereo(images, L, e, NOISE)
    told = photometric_stereo(images, L, 2 * e, NOISE)
    np.testing.assert_array_equal(told.interpretable, once.interpretable)
    np.testing.assert_allclose(told.normals, once.normals, atol=1e-6)
    np.testing.assert_allclose(told.albedo, np.asarray(once.albedo) / 2, rtol=1e-6)
    brighter = photometric_stereo(2 * images, L, e, NOISE)
    np.testing.assert_allclose(brighter.normals, once.normals, atol=1e-6)
    np.testing.assert_allclose(brighter.albedo, 2 * np.asarray(once.albedo), rtol=1e-6)


@pytest.mark.parametrize("lights", [4, 6])
@pytest.mark.parametrize("fill", [0.0, 0.02, 0.08])
def test_a_shadowed_light_is_found_and_the_normal_stays_right(lights, fill, make_lights, sphere, shade, angle_between):
    L, e = make_lights(lights), np.ones(lights)
    images = shade(sphere, L, e)
    images[1, :, :32] = fill * 0.6  # what neighbours reflect into the shadow
    needle = photometric_stereo(as_float32(images), L, e, NOISE)
    inside = slant(sphere) < np.radians(25.0)
    half = inside & (np.arange(64) < 32)
    shadowed = np.asarray(needle.shadowed)
    assert shadowed[1][half].all()
    assert not shadowed[1][inside & ~half].any()
    assert not np.delete(shadowed, 1, axis=0)[:, inside].any()
    assert np.asarray(needle.interpretable)[inside].all()
    assert angle_between(needle.normals, sphere)[inside].max() < 1e-5


@pytest.mark.parametrize("lights", [4, 6])
def test_a_highlight_is_left_out(lights, make_lights, sphere, shade, angle_between):
    L, e = make_lights(lights), np.ones(lights)
    images = shade(sphere, L, e, albedo=0.5)
    images[0, :32] += 0.4
    needle = photometric_stereo(as_float32(images), L, e, NOISE)
    inside = slant(sphere) < np.radians(15.0)
    assert np.asarray(needle.interpretable)[inside].all()
    assert angle_between(needle.normals, sphere)[inside].max() < 1e-5


def test_a_saturated_light_is_left_out(make_lights, sphere, shade, angle_between):
    L, e = make_lights(4), np.array([1.0, 1.0, 1.0, 2.2])
    full = shade(sphere, L, e)
    images = np.minimum(full, 1.0)
    inside = slant(sphere) < np.radians(35.0)
    needle = photometric_stereo(as_float32(images), L, e, NOISE)
    np.testing.assert_array_equal(np.asarray(needle.saturated)[3], full[3] >= 1 - 2**-12)
    assert np.asarray(needle.interpretable)[inside].all()
    assert angle_between(needle.normals, sphere)[inside].max() < 1e-5
    of_three = photometric_stereo(as_float32(images[1:]), L[1:], e[1:], NOISE)
    assert not np.asarray(of_three.interpretable)[full[3] >= 1].any()


def test_two_lights_of_four_are_too_few(make_lights, shade):
    L, e = make_lights(4), np.ones(4)
    images = shade(np.tile([0.0, 0.0, -1.0], (64, 64, 1)), L, e)
    images[[0, 1]] = 0.01
    needle = photometric_stereo(as_float32(images), L, e, NOISE)
    assert not np.asarray(needle.interpretable).any()
    np.testing.assert_array_equal(np.asarray(needle.shadowed)[:, 0, 0], [True, True, False, False])


def test_an_inconsistent_pixel_is_not_interpretable(make_lights, shade):
    L, e = make_lights(6), np.ones(6)
    images = shade(np.tile([0.0, 0.0, -1.0], (64, 64, 1)), L, e)
    images[::2] *= 1.5  # lights of alternating strength: no surface does that, whichever are left out
    needle = photometric_stereo(as_float32(images), L, e, NOISE)
    assert not np.asarray(needle.interpretable).any()


def noisy(images, rng):
    electrons = rng.poisson(images * NOISE.full_well_e) + rng.normal(0.0, NOISE.read_noise_e, images.shape)
    steps = 2**NOISE.bits - 1
    return as_float32(np.clip(np.round(electrons / NOISE.full_well_e * steps) / steps, 0.0, 1.0))


@pytest.mark.parametrize("lights", [3, 4, 6])
@pytest.mark.parametrize("tilt", [0.0, 20.0, 35.0])
def test_predicted_deviation_is_the_actual_one(lights, tilt, make_lights, shade, angle_between):
    L, e = make_lights(lights), np.linspace(0.9, 1.1, lights)
    normal = np.array([np.sin(np.radians(tilt)) * 0.6, np.sin(np.radians(tilt)) * 0.8, -np.cos(np.radians(tilt))])
    images = noisy(shade(np.tile(normal, (64, 64, 1)), L, e, albedo=0.3), np.random.default_rng(7))
    needle = photometric_stereo(images, L, e, NOISE)
    assert np.asarray(needle.interpretable).mean() > 0.999
    actual = np.sqrt(np.mean(angle_between(needle.normals, normal) ** 2))
    predicted = np.sqrt(np.mean(np.asarray(needle.normal_std) ** 2))
    assert predicted == pytest.approx(actual, rel=0.1)


@pytest.mark.parametrize("batch", [(), (1,), (3, 1, 2)])
def test_a_batch_is_its_elements_one_by_one(batch, make_lights, sphere, shade):
    L, e = make_lights(4), np.ones(4)
    rng = np.random.default_rng(3)
    scale = rng.uniform(0.5, 1.0, (*batch, 1, 1, 1))
    images = noisy(scale * shade(sphere, L, e), rng)
    images[..., 0, :16, :] = 0.0
    whole = photometric_stereo(images, L, e, NOISE)
    for index in np.ndindex(*batch):
        alone = photometric_stereo(images[index], L, e, NOISE)
        for name, of_batch, of_one in zip(whole._fields, whole, alone, strict=True):
            # a comparison may fall either way where the two differ by the last bit: other shapes, other vector code
            differs = np.abs(np.asarray(of_batch[index], float) - np.asarray(of_one, float)) > 1e-4
            assert differs.mean() < 1e-3, name


@pytest.mark.parametrize("lights", [3, 4, 6])
def test_shadow_is_probable_where_a_light_is_dark_and_not_where_it_shines(lights, make_lights, sphere, shade):
    L, e = make_lights(lights), np.ones(lights)
    inside = slant(sphere) < np.radians(20.0)
    probability = {}
    for fill in (0.0, 0.02, 0.08, 0.5):  # of albedo, under light 1
        images = shade(sphere, L, e)
        images[1] = fill * 0.6
        needle = photometric_stereo(as_float32(images), L, e, NOISE)
        probability[fill] = np.asarray(needle.shadow_probability)[1][inside]
        others = np.delete(np.asarray(needle.shadow_probability), 1, axis=0)[:, inside]
        assert lights == 3 or (fill == 0.5) or others.max() < 0.05
    assert probability[0.0].min() > 0.9
    assert probability[0.02].min() > 0.9
    assert probability[0.08].min() > 0.5
    lit = np.asarray(photometric_stereo(as_float32(shade(sphere, L, e)), L, e, NOISE).shadow_probability)
    assert lit[:, inside].max() < 0.05


@pytest.mark.parametrize("lights", [3, 4])
def test_bias_is_the_angle_by_which_the_model_error_turns_the_normal(lights, make_lights, shade, angle_between):
    L, e = make_lights(lights), np.ones(lights)
    normal = np.array([0.3, 0.2, -1.0]) / np.linalg.norm([0.3, 0.2, -1.0])
    images = shade(np.tile(normal, (64, 64, 1)), L, e)
    rng = np.random.default_rng(5)
    off = images + 0.03 * images.max() * rng.normal(size=images.shape)
    needle = photometric_stereo(as_float32(images), L, e, NOISE)
    turned = photometric_stereo(as_float32(off), L, e, NOISE)
    there = np.asarray(turned.interpretable)
    actual = np.sqrt(np.mean(angle_between(turned.normals, normal)[there] ** 2))
    assert np.asarray(needle.normal_bias).mean() == pytest.approx(actual, rel=0.1)


def test_least_squares_takes_every_light_for_lit(make_lights, sphere, shade, angle_between):
    L, e = make_lights(4), np.linspace(0.8, 1.2, 4)
    images = as_float32(shade(sphere, L, e))
    inside = slant(sphere) < np.radians(40.0)
    assert angle_between(least_squares(images, L, e, NOISE).normals, sphere)[inside].max() < 1e-5
    images[1] = 0.0
    assert angle_between(least_squares(images, L, e, NOISE).normals, sphere)[inside].min() > np.radians(5.0)


def test_dominant_albedo_is_that_of_the_parts_not_of_a_larger_dark_bin(make_lights, sphere, shade):
    L, e = make_lights(3), np.ones(3)
    albedo = np.full((64, 64), 0.04)
    albedo[20:40, 20:40] = 0.7  # a tenth of the image
    albedo[44:48, 28:36] = 0.45  # a foreign body
    normals = np.tile([0.0, 0.0, -1.0], (64, 64, 1))
    images = noisy(shade(normals, L, e, albedo), np.random.default_rng(0))
    needle = photometric_stereo(images, L, e, NOISE)
    assert float(dominant_albedo(needle)) == pytest.approx(0.7, rel=0.005)
    assert np.asarray(needle.confidence)[20:40, 20:40].min() > 0.8
    assert np.asarray(needle.confidence)[albedo < 0.5].max() < 1e-4
    strict = photometric_stereo(images, L, e, NOISE, albedo_tolerance=0.1)
    np.testing.assert_array_equal(strict.interpretable, albedo == 0.7)


def test_darkness_has_no_needles_and_no_nan(make_lights):
    needle = photometric_stereo(np.zeros((4, 64, 64), np.float32), make_lights(4), np.ones(4), NOISE)
    assert not np.asarray(needle.interpretable).any()
    for name in ("normals", "albedo", "confidence", "normal_std"):
        np.testing.assert_array_equal(getattr(needle, name), 0.0, err_msg=name)
    assert float(dominant_albedo(needle)) == 0.0
