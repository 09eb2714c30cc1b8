"""What the sensor makes of views: Lambert's law, needles that come back, edges that several lights show, regions."""

import dataclasses

import numpy as np
import pytest
from itree_kernels.camera import Camera

from itree_jax.sensing.noise_model import intensity_std
from itree_jax.sensing.reaching import MODEL_ERROR
from itree_jax.sensor import Noise
from itree_jax.tree.sights import (
    BRIGHTEST,
    PIXELS_AT_ONCE,
    describe_region,
    lit_images,
    needle_deviation,
    noisy,
    read,
    window_edges,
    window_images,
)

QUIET = Noise(full_well_e=1e9, read_noise_e=0.0, bits=24)


def test_intensities_are_lamberts_with_room_for_highlights(sensor):
    lights = dataclasses.replace(sensor, light_intensities=np.array([2.0, 1.0, 0.5]))
    normal = np.stack([sensor.light_directions[0], [0, 0, -1.0], -sensor.light_directions[0]])
    lit = np.ones((3, 3), bool)
    lit[1, 1] = False
    images = lit_images(normal, lit, lights)
    cosine = np.maximum(sensor.light_directions @ normal.T, 0.0)
    np.testing.assert_allclose(images, BRIGHTEST * np.array([1.0, 0.5, 0.25])[:, None] * cosine * lit, rtol=1e-6)
    assert images[0, 0] == pytest.approx(BRIGHTEST)
    assert images[1, 1] == 0.0


def test_without_noise_the_needles_come_back_and_the_slant_limit_cuts(sensor):
    angle = np.linspace(0, np.radians(60), 200)
    azimuth = np.linspace(0, 40, 200)
    normal = np.stack([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), -np.cos(angle)], axis=1)
    images = lit_images(normal, np.ones((3, 200), bool), sensor)
    assert (np.abs(angle - sensor.slant_limit) > 1e-4).all()
    quiet = dataclasses.replace(sensor, noise=QUIET)
    seen, needles = read(noisy(images, quiet, 1), quiet)
    np.testing.assert_array_equal(seen, angle < sensor.slant_limit)
    np.testing.assert_allclose(needles[seen], normal[seen], atol=5e-4)
    rough = read(noisy(images, sensor, 1), sensor)[1]
    error = np.degrees(np.arccos(np.clip((rough * normal).sum(1), -1, 1)))[seen]
    assert 0.05 < np.median(error) < 2.0  # a hundred times the electrons' noise of one part in a hundred


def test_noise_follows_its_seed_and_is_as_large_as_the_model_says(sensor):
    images = np.full((3, 4000), 0.5, np.float32)
    first, again, other = (noisy(images, sensor, seed) for seed in (7, 7, 8))
    np.testing.assert_array_equal(first, again)
    assert (first != other).mean() > 0.9
    assert (first - images).std() == pytest.approx(float(intensity_std(np.float32([0.5]), sensor.noise)[0]), rel=0.1)


def test_pixels_are_read_alike_wherever_they_stand_in_the_list(sensor):
    rng = np.random.default_rng(0)
    count = PIXELS_AT_ONCE[0] * PIXELS_AT_ONCE[1] + 5
    images = rng.uniform(0, BRIGHTEST, (3, count)).astype(np.float32)
    seen, needles = read(images, sensor)
    assert seen.shape == (count,)
    assert needles.shape == (count, 3)
    last, at = read(images[:, -7:], sensor)
    np.testing.assert_array_equal(last, seen[-7:])
    np.testing.assert_allclose(at, needles[-7:], atol=1e-6)


def test_windows_are_dark_where_nothing_is(sensor):
    rng = np.random.default_rng(0)
    there = rng.random((2, 5, 5)) < 0.5
    normal = np.broadcast_to(np.float32([0, 0, -1]), (2, 5, 5, 3))
    lit = rng.random((2, 3, 5, 5)) < 0.5
    images = window_images(there, normal, lit, sensor)
    cosine = -sensor.light_directions[:, 2]
    expected = BRIGHTEST * cosine[:, None, None, None] * (there & np.moveaxis(lit, 1, 0))
    np.testing.assert_allclose(images, expected, rtol=1e-6)


def test_an_edge_that_one_light_shows_is_a_shadows_and_one_that_all_show_is_the_parts(sensor):
    images = np.full((2, 3, 32, 32), 0.4, np.float32)
    images[0, :, :, 16:] = 0.1  # under every light
    images[1, 0, :, 16:] = 0.1  # under the first alone
    edges = np.asarray(window_edges(images, sensor.noise))
    strength = np.linalg.norm(edges[:, 8:24], axis=-1)
    assert (strength[0].max(axis=1) > 0.5).all()
    across = np.abs(strength[0].argmax(axis=1) - 15.5)
    assert (across < 1.5).all()
    np.testing.assert_allclose(edges[0, 8:24, 15:17, 1], 0.0, atol=1e-5)  # it runs down: cos 2 phi = -1
    assert (edges[0, 8:24].min(axis=1)[:, 0] < -0.5).all()
    np.testing.assert_allclose(strength[1], 0.0, atol=1e-6)


def test_a_window_has_its_edges_whatever_else_is_in_the_batch(sensor):
    images = np.random.default_rng(0).uniform(0, 0.7, (20, 3, 16, 16)).astype(np.float32)
    many = np.asarray(window_edges(images, sensor.noise))
    np.testing.assert_allclose(np.asarray(window_edges(images[17:18], sensor.noise))[0], many[17], atol=1e-5)


@pytest.mark.parametrize("exposure", [BRIGHTEST, 0.1])
def test_a_needle_errs_by_noise_and_model_together(sensor, exposure):
    noise = sensor.noise
    electrons = exposure * noise.full_well_e
    variance = electrons + noise.read_noise_e**2 + (noise.full_well_e * 2.0**-noise.bits) ** 2 / 12
    expected = np.hypot(np.sqrt(variance) / electrons, MODEL_ERROR)
    assert needle_deviation(noise, exposure) == pytest.approx(expected, rel=1e-3)


def test_a_region_of_a_tilted_plane_lies_where_the_plane_does():
    p, q, pitch, size = 0.5, -0.2, 0.8, 40
    camera = Camera("orthographic", 1 / pitch, 1 / pitch, (size - 1) / 2, (size - 1) / 2, size, size)
    offset = (np.arange(size) - (size - 1) / 2) * pitch
    x, y = np.meshgrid(offset, offset)
    mask = (np.abs(x - 3.0) < 6.0) & (np.abs(y + 2.0) < 4.0)
    normal = np.array([p, q, -1.0]) / np.sqrt(1 + p**2 + q**2)
    found = describe_region(mask, np.broadcast_to(normal, (size, size, 3)), 100.0 + p * x + q * y, camera)
    pixels = x[mask], y[mask]
    expected = [pixels[0].mean(), pixels[1].mean(), 100.0 + p * pixels[0].mean() + q * pixels[1].mean()]
    np.testing.assert_allclose(found.centre, expected, atol=1e-6)
    np.testing.assert_allclose(found.normal, normal, atol=1e-6)
    assert found.area == pytest.approx(mask.sum() * pitch**2 * np.sqrt(1 + p**2 + q**2), rel=1e-6)
