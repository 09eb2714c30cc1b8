"""The material's response: fitted where normals are known, it tells others; a Lambertian material needs none.

Glossy is the lobe of blasted metal: Lambert's law errs by degrees on it.
"""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from itree_cad.bundled import bundled_part
from itree_kernels.camera import Camera
from itree_kernels.instances import Material
from itree_kernels.lit_scene import LitScene, render_scene
from itree_kernels.mesh import ray_mesh
from itree_kernels.noise import sensor_noise
from scipy.spatial.transform import Rotation

from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.material_response import apply_response, fit_response, light_sets
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.photometric import needle_map
from itree_jax.sensing.reading import read_needles, turned_back
from itree_jax.sensor import Sensor

CAMERA = Camera("pinhole", 1815.0, 1815.0, 99.5, 79.5, 200, 160)
SENSOR = replace(bundled_sensor("bench"), camera=CAMERA)
AZIMUTH = np.radians([270.0, 0.0, 90.0, 180.0])
SIN, COS = np.sin(np.radians(35.0)), np.cos(np.radians(35.0))
RING = np.stack([SIN * np.cos(AZIMUTH), SIN * np.sin(AZIMUTH), np.full(4, -COS)], axis=1)
FOUR = replace(SENSOR, light_directions=RING, light_intensities=np.ones(4))
MATTE, GLOSSY = Material(0.6), Material(0.4, 0.35, 10.0)


def ball(material: Material, sensor: Sensor = SENSOR, seed: int = 0) -> tuple[np.ndarray, LitScene]:
    """Images with noise, and the truth, of a sphere that fills them."""
    solid = trimesh.creation.icosphere(5, radius=38.0)
    return photographed([solid], np.eye(3)[None], np.array([[0.0, 0.0, 900.0]]), material, sensor, seed)


def small_bin(material: Material, sensor: Sensor = SENSOR, seed: int = 1) -> tuple[np.ndarray, LitScene]:
    part = bundled_part("ikeuchi-1987")
    solid = trimesh.Trimesh(part.vertices, part.triangles, process=False)
    R = Rotation.from_euler("xyz", [[8, 0, 20], [90, 25, -50]], degrees=True).as_matrix()
    t = np.array([[-18.0, -10.0, 875.0], [22.0, 14.0, 868.0]])
    return photographed([solid, solid], R, t, material, sensor, seed)


def photographed(solids, R, t, material: Material, sensor: Sensor, seed: int) -> tuple[np.ndarray, LitScene]:
    meshes = [ray_mesh(s.vertices, s.faces, np.zeros(len(s.faces), np.int32), device="cpu") for s in solids]
    light = sensor.light_directions, sensor.light_intensities
    lit = render_scene(meshes, list(range(len(meshes))), R, t, sensor.camera, *light, material)
    return sensor_noise(lit.images, 12000.0, 6.0, 12, seed), lit


def read(images: np.ndarray, sensor: Sensor = SENSOR) -> NeedleMap:
    return NeedleMap(*(np.asarray(a) for a in needle_map(images, sensor)))


def median_error(needle: NeedleMap, lit: LitScene, where: np.ndarray) -> float:
    """[deg]"""
    chord = np.linalg.norm(needle.normals - lit.normal, axis=-1)[where & needle.interpretable]
    return float(np.degrees(np.median(2.0 * np.arcsin(0.5 * chord))))


def bands(shape: tuple[int, int]) -> np.ndarray:
    """Half of an image, in diagonal bands wider than what neighbours share."""
    v, u = np.indices(shape)
    return (u + v) // 12 % 2 == 0


@pytest.fixture(scope="module")
def glossy_ball():
    images, lit = ball(GLOSSY)
    needle = read(images)
    return needle, lit, fit_response(needle, lit.normal, (lit.instance == 0) & bands(lit.instance.shape))


@pytest.mark.parametrize("sensor", [SENSOR, FOUR], ids=["three", "four"])
@pytest.mark.parametrize("scene", [ball, small_bin])
def test_a_lambertian_material_keeps_nothing(scene, sensor):
    images, lit = scene(MATTE, sensor)
    response = fit_response(read(images, sensor), lit.normal, lit.instance >= 0)
    assert response.is_lambertian
    assert response.lights == sensor.light_count
    needle = read(images, sensor)
    for before, after in zip(needle, apply_response(needle, response), strict=True):
        np.testing.assert_array_equal(before, after)


def test_a_glossy_sphere_is_better_on_pixels_not_fitted_on(glossy_ball):
    needle, lit, response = glossy_ball
    assert not response.is_lambertian
    elsewhere = (lit.instance == 0) & ~bands(lit.instance.shape)
    before, after = (median_error(n, lit, elsewhere) for n in (needle, apply_response(needle, response)))
    assert before > 3.0
    assert after < 0.8  # two thirds of a degree is what noise leaves
    (one,) = response.sets.values()
    assert np.degrees(one.lambertian) == pytest.approx(before, rel=0.15)  # what it says of itself, on pixels left out
    assert np.degrees(one.residual) == pytest.approx(after, rel=0.3)


def test_fitted_on_one_image_it_reads_another(glossy_ball):
    images, lit = small_bin(GLOSSY)
    needle = read(images)
    all_lit = lit.lit.all(axis=0)
    before, after = (median_error(n, lit, all_lit) for n in (needle, apply_response(needle, glossy_ball[2])))
    assert before > 3.0
    assert after < 1.0


def test_a_bin_tells_its_own_response():
    """From normals that a depth map would tell: half of the pixels, some of them quite wrong."""
    images, lit = small_bin(GLOSSY)
    rng = np.random.default_rng(0)
    known = (lit.instance >= 0) & bands(lit.instance.shape)
    told = lit.normal + rng.normal(0.0, np.radians(2.0), lit.normal.shape)
    told[rng.random(known.shape) < 0.1] = [0.0, 0.0, -1.0]
    needle = read(images)
    response = fit_response(needle, told / np.linalg.norm(told, axis=-1, keepdims=True), known)
    elsewhere = lit.lit.all(axis=0) & ~bands(lit.instance.shape)
    before, after = (median_error(n, lit, elsewhere) for n in (needle, apply_response(needle, response)))
    assert after < 0.5 * before


def test_confidence_is_high_where_right_and_low_where_a_shadow_was_taken_for_light(glossy_ball):
    """A light that half reaches a patch makes another normal: three lights fit it, but not its brightness."""
    _, lit, response = glossy_ball
    images, _ = ball(GLOSSY, seed=9)
    patch = np.zeros(lit.instance.shape, bool)
    patch[60:100, 80:120] = True
    images[0, patch] *= 0.55
    needle = apply_response(read(images), response)
    seen = needle.interpretable & (lit.instance == 0) & (lit.normal[..., 2] < -0.8)
    assert seen[patch].mean() > 0.9
    assert np.median(needle.confidence[seen & ~patch]) > 0.8
    assert np.median(needle.confidence[seen & patch]) < 0.1
    wrong = np.linalg.norm(needle.normals - lit.normal, axis=-1) > np.radians(10.0)
    assert needle.confidence[seen & wrong].mean() < 0.3 * needle.confidence[seen & ~wrong].mean()


def test_sets_without_a_map_stay_as_they_are():
    images, lit = ball(GLOSSY, FOUR)
    needle = read(images, FOUR)
    response = fit_response(needle, lit.normal, lit.instance == 0)
    codes = light_sets(needle)
    assert len(response.sets) >= 2
    one = max(response.sets)
    some = replace(response, sets={k: v for k, v in response.sets.items() if k != one})
    after = apply_response(needle, some)
    untouched = (codes == one) | ~np.isin(codes, list(some.sets))
    assert untouched.sum() > 500
    for name in ("normals", "confidence", "normal_bias", "interpretable"):
        np.testing.assert_array_equal(getattr(after, name)[untouched], getattr(needle, name)[untouched])
    changed = np.isin(codes, list(some.sets)) & needle.interpretable
    assert (after.normals[changed] != needle.normals[changed]).any(-1).mean() > 0.99


def test_what_only_pixels_beside_shadows_gain_is_no_response():
    """Where one of four lights is blocked, neighbours' light and the border of a depth map may turn normals alike."""
    images, lit = ball(MATTE, FOUR)
    needle = read(images, FOUR)
    told, turn = lit.normal.copy(), Rotation.from_euler("x", 12, degrees=True)
    told[light_sets(needle) != 0b1111] = turn.apply(told[light_sets(needle) != 0b1111])
    for code in (0b0111, 0b1011, 0b1101, 0b1110):
        assert (light_sets(needle) == code).sum() > 1000
    assert fit_response(needle, told, lit.instance == 0).is_lambertian


def test_codes_tell_the_lights():
    images, _ = ball(MATTE, FOUR)
    needle = read(images, FOUR)
    codes = light_sets(needle)
    for light in range(4):
        np.testing.assert_array_equal((codes >> light) & 1, needle.reaching[light])


@settings(max_examples=12, deadline=None)
@given(st.floats(0.1, 4.0))
def test_the_scale_of_the_images_changes_nothing(glossy_ball, scale):
    needle, lit, response = glossy_ball
    known = (lit.instance == 0) & bands(lit.instance.shape)
    brighter = needle._replace(albedo=(scale * needle.albedo).astype(np.float32))
    other = fit_response(brighter, lit.normal, known)
    assert other.sets.keys() == response.sets.keys()
    # the unit is the mode of a histogram of log albedo, whose cells do not scale: to a percent
    assert other.unit == pytest.approx(scale * response.unit, rel=0.02)
    seen = needle.interpretable & (lit.instance == 0)
    one, two = apply_response(needle, response), apply_response(brighter, other)
    assert np.degrees(np.abs(one.normals - two.normals)[seen].max(-1)).mean() < 0.02
    np.testing.assert_allclose(one.confidence[seen], two.confidence[seen], atol=0.05)


def test_too_few_pixels_or_normals_of_one_half_keep_nothing(glossy_ball):
    needle, lit, _ = glossy_ball
    few = np.zeros(lit.instance.shape, bool)
    few[75:90, 95:110] = True  # 225 pixels
    assert fit_response(needle, lit.normal, few).is_lambertian
    block = np.zeros(lit.instance.shape, bool)
    v, u = np.indices(block.shape)
    block = ((v // 16 + u // 16) % 2 == 0) & (lit.instance == 0)  # nothing is left out to be tested on
    assert fit_response(needle, lit.normal, block).is_lambertian
    assert fit_response(needle, lit.normal, np.zeros_like(few)).is_lambertian


def test_a_depth_map_fits_it(glossy_ball):
    """`read_needles`: photometric stereo, and the response where a depth map helps."""
    images, lit = ball(GLOSSY)
    depth = np.where(lit.depth > 0, lit.depth + np.random.default_rng(2).normal(0.0, 0.1, lit.depth.shape), 0.0)
    seen = lit.instance == 0
    before = median_error(read_needles(images, SENSOR, None), lit, seen)
    after = median_error(read_needles(images, SENSOR, depth.astype(np.float32)), lit, seen)
    assert after < 0.5 * before
    given = read_needles(images, SENSOR, None, glossy_ball[2])  # a response that is known already
    assert median_error(given, lit, seen) < 0.8


def test_a_turned_map_is_read_in_the_frame_of_its_response(glossy_ball):
    needle, _, response = glossy_ball
    R = Rotation.from_euler("xyz", [4, -7, 30], degrees=True).as_matrix()
    turned = needle._replace(normals=needle.normals @ R.T)
    expected, got = apply_response(needle, response), turned_back(turned, R, response)
    np.testing.assert_allclose(got.normals, expected.normals @ R.T, atol=1e-5)
    np.testing.assert_allclose(got.confidence, expected.confidence, atol=1e-4)
    assert turned_back(turned, R, None) is turned
