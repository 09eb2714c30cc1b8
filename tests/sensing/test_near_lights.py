"""Near point lights: their field, what distant lights make of it, and how spheres tell where they stand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError

from itree_jax.sensing.light_calibration.calibrate import SphereImages, calibrate
from itree_jax.sensing.light_calibration.near import refine_from_shading, triangulate
from itree_jax.sensing.light_calibration.sphere import Sphere
from itree_jax.sensing.lights import directions_on_axis
from itree_jax.sensing.near_lights import lights_of, near_light_field
from itree_jax.sensing.photometric import needle_map
from itree_jax.sensor import Noise, Sensor

from .conftest import light_ring
from .rendered_spheres import PINHOLE, degrees_between, near_matte, near_mirror, pixels

DISTANCE = 300.0
CAMERA = Camera("pinhole", 200.0, 200.0, 47.5, 31.5, 96, 64)
# 260 mm from the parts, 40 degrees off the axis: 15 % weaker at the image's rim than in the middle
POSITIONS = np.array([0.0, 0.0, DISTANCE]) + 260.0 * light_ring(4, np.radians(40.0))
INTENSITIES = np.array([0.5, 0.6, 0.55, 0.65])
SENSOR = Sensor(
    CAMERA, directions_on_axis(POSITIONS, DISTANCE), INTENSITIES, Noise(), np.radians(42.0), 60.0, DISTANCE,
    light_positions=POSITIONS,
)  # fmt: skip


def images_of(X: np.ndarray, normal: np.ndarray, albedo: float = 0.8) -> np.ndarray:
    """Lambert's law under the lamps of `SENSOR`, written out."""
    away = POSITIONS - X[..., None, :]
    square = (away**2).sum(-1)
    reference = ((POSITIONS - [0.0, 0.0, DISTANCE]) ** 2).sum(-1)
    cosine = np.maximum((normal[..., None, :] * away).sum(-1) / np.sqrt(square), 0.0)
    return np.moveaxis(albedo * INTENSITIES * reference / square * cosine, -1, 0).astype(np.float32)


def plane(slope: float) -> tuple[np.ndarray, np.ndarray]:
    """Depth and normals of the plane z = distance + slope x."""
    ray = CAMERA.unproject(pixels(CAMERA), np.ones((64, 96)))
    depth = DISTANCE / (1.0 - slope * ray[..., 0])
    return depth, np.broadcast_to(np.array([slope, 0.0, -1.0]) / np.hypot(1.0, slope), ray.shape)


def ball() -> tuple[np.ndarray, np.ndarray]:
    """Depth (0 beside it) and normals of a sphere at the working distance."""
    X, normal, _ = Sphere(CAMERA, np.array([5.0, -3.0, DISTANCE]), 35.0, 0.0).at(pixels(CAMERA))
    return np.nan_to_num(X[..., 2]), np.nan_to_num(normal)


def test_on_the_axis_a_near_light_is_the_distant_one_of_its_direction():
    camera = Camera("pinhole", 200.0, 200.0, 48.0, 32.0, 97, 65)
    L, e = near_light_field(POSITIONS, INTENSITIES, DISTANCE, camera, DISTANCE)
    assert L.shape == (65, 97, 4, 3)
    assert e.shape == (65, 97, 4)
    np.testing.assert_allclose(np.asarray(L)[32, 48], SENSOR.light_directions, atol=1e-6)
    np.testing.assert_allclose(np.asarray(e)[32, 48], INTENSITIES, rtol=1e-6)


def test_lights_far_away_are_distant_ones():
    far = np.array([0.0, 0.0, DISTANCE]) + 1e7 * light_ring(3)
    L, e = near_light_field(far, np.ones(3), DISTANCE, CAMERA, DISTANCE)
    np.testing.assert_allclose(L, np.broadcast_to(light_ring(3), L.shape), atol=1e-5)
    np.testing.assert_allclose(e, 1.0, atol=1e-4)


@pytest.mark.parametrize("kind", ["orthographic", "pinhole"])
def test_the_field_points_at_the_lamp_and_falls_with_the_squared_distance(kind):
    camera = Camera(kind, 2.0 if kind == "orthographic" else 200.0, 200.0, 47.5, 31.5, 96, 64)
    depth = DISTANCE + np.random.default_rng(0).uniform(-20, 20, (64, 96))
    L, e = near_light_field(POSITIONS, INTENSITIES, depth, camera, DISTANCE)
    away = POSITIONS - camera.unproject(pixels(camera), depth)[..., None, :]
    distance = np.linalg.norm(away, axis=-1)
    np.testing.assert_allclose(L, away / distance[..., None], atol=1e-6)
    np.testing.assert_allclose(e, INTENSITIES * 260.0**2 / distance**2, rtol=1e-5)


def test_where_depth_is_unknown_the_working_distance_stands_for_it():
    depth = np.full((64, 96), 280.0)
    depth[10, 20] = 0.0
    L, e = near_light_field(POSITIONS, INTENSITIES, depth, CAMERA, DISTANCE)
    at_distance = near_light_field(POSITIONS, INTENSITIES, DISTANCE, CAMERA, DISTANCE)
    np.testing.assert_array_equal(L[10, 20], at_distance[0][10, 20])
    np.testing.assert_array_equal(e[10, 20], at_distance[1][10, 20])
    assert (np.asarray(e)[11] != np.asarray(at_distance[1])[11]).all()


def test_the_field_is_differentiable_in_the_positions():
    def total(p):
        L, e = near_light_field(p, INTENSITIES.astype(np.float32), 1.0, small, 1.0)
        return (L * jnp.arange(3.0)).sum() + e.sum()

    small = Camera("pinhole", 2.0, 2.0, 1.0, 1.0, 3, 3)
    p = jnp.asarray(POSITIONS / DISTANCE, jnp.float32)
    gradient = np.asarray(jax.grad(total)(p))
    for index in [(0, 0), (1, 2), (3, 1)]:
        step = np.zeros_like(p)
        step[index] = 1e-2
        slope = (total(p + step) - total(p - step)) / 2e-2
        assert gradient[index] == pytest.approx(float(slope), rel=2e-2, abs=1e-2)


@pytest.mark.parametrize(("depth", "normal"), [plane(0.0), plane(0.3), ball()], ids=["plane", "sloped plane", "sphere"])
def test_photometric_stereo_is_exact_under_near_lights_and_measurably_wrong_if_they_pass_for_distant(depth, normal):
    images = images_of(CAMERA.unproject(pixels(CAMERA), depth), normal)
    there = (depth > 0) & (np.arccos(np.clip(-normal[..., 2], -1, 1)) < np.radians(40.0))
    near = needle_map(images, SENSOR, depth)
    assert np.asarray(near.interpretable)[there].all()
    assert degrees_between(near.normals, normal)[there].max() < 0.01
    np.testing.assert_allclose(np.asarray(near.albedo)[there], 0.8, rtol=1e-3)
    distant = needle_map(images, Sensor(**{**vars(SENSOR), "light_positions": None}))
    assert degrees_between(distant.normals, normal)[there].max() > 2.0


def test_without_depth_a_plane_at_the_working_distance_is_exact():
    depth, normal = plane(0.0)
    images = images_of(CAMERA.unproject(pixels(CAMERA), depth), normal)
    assert degrees_between(needle_map(images, SENSOR).normals, normal).max() < 0.01
    batch = needle_map(np.stack([images, images]), SENSOR)
    assert degrees_between(batch.normals, normal).max() < 0.01


def test_distant_lights_pass_through_as_they_are():
    sensor = Sensor(**{**vars(SENSOR), "light_positions": None})
    L, e = lights_of(sensor, np.ones((64, 96)))
    assert L is sensor.light_directions
    assert e is sensor.light_intensities


def test_rays_that_meet_tell_the_position():
    points = np.random.default_rng(0).uniform(-100, 100, (4, 1, 3)) + np.array([0.0, 0.0, 600.0])
    away = POSITIONS - points
    found = triangulate(np.broadcast_to(points, away.shape), away / np.linalg.norm(away, axis=-1, keepdims=True))
    np.testing.assert_allclose(found.positions, POSITIONS, atol=1e-9)
    assert found.misses.max() < 1e-9


def test_rays_that_miss_each_other_tell_by_how_much():
    """Two skew rays 2 mm apart: the position is half way."""
    points = np.array([[[0.0, 1.0, 0.0]], [[0.0, -1.0, 0.0]]])
    directions = np.array([[[0.6, 0.0, -0.8]], [[-0.6, 0.0, -0.8]]])
    found = triangulate(points, directions)
    np.testing.assert_allclose(found.positions, [[0.0, 0.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(found.misses, 1.0)


def test_one_place_or_parallel_rays_tell_no_position():
    L = light_ring(3)
    with pytest.raises(ItreeError, match="two places or more, there is 1"):
        triangulate(np.zeros((1, 3, 3)), L[None])
    with pytest.raises(ItreeError, match=r"light 0: .* parallel within 0\.00 degrees"):
        triangulate(np.array([[[0.0, 0, 500]] * 3, [[50.0, 0, 500]] * 3]), np.stack([L, L]))


PLACES = [Sphere(PINHOLE, np.array(c), 45.0, 0.0) for c in ([-40.0, 0, 300], [35.0, 10, 320], [0.0, -30, 280])]


def test_spheres_at_three_places_tell_where_the_lamps_stand():
    reference = ((POSITIONS - [0.0, 0.0, DISTANCE]) ** 2).sum(-1)
    images = np.stack([near_matte(s, POSITIONS, 0.8 * INTENSITIES * reference) for s in PLACES])
    start = POSITIONS + np.random.default_rng(0).normal(0.0, 15.0, POSITIONS.shape)
    found = refine_from_shading(images, PLACES, start, DISTANCE)
    np.testing.assert_allclose(found.positions, POSITIONS, atol=0.05)
    np.testing.assert_allclose(found.strengths, 0.8 * INTENSITIES, rtol=1e-3)
    assert found.residuals.max() < 1e-3


@pytest.mark.parametrize("kind", ["chrome", "matte"])
def test_the_whole_calibration_finds_near_lamps(kind, tmp_path):
    reference = ((POSITIONS - [0.0, 0.0, DISTANCE]) ** 2).sum(-1)
    places = []
    for sphere in PLACES:
        images = near_mirror(sphere, POSITIONS)
        if kind == "matte":
            images = near_matte(sphere, POSITIONS, 0.8 * INTENSITIES * reference)
        places.append(SphereImages(tmp_path, list("abcd"), images, sphere))
    found = calibrate(places, kind, near_at=DISTANCE)
    assert found.positions is not None
    error = np.linalg.norm(found.positions - POSITIONS, axis=1)
    assert error.max() < (0.1 if kind == "matte" else 4.0)  # of 260; a pixel of a highlight is 20
    if kind == "matte":
        np.testing.assert_allclose(found.intensities, INTENSITIES / INTENSITIES.mean(), rtol=2e-3)
        assert degrees_between(found.directions, SENSOR.light_directions).max() < 0.05
    assert set(found.to_json()) == {"positions_mm", "intensities"}
