"""Needles of a depth map: planes exactly, noise as predicted, creases sharp, curved surfaces without bias."""

import numpy as np
import pytest
import warp as wp
from itree_kernels.camera import Camera
from itree_kernels.window_fits import window_sums

from itree_jax.sensing.depth_needles import RADIUS, depth_needles

from .curving_twin import added_by_third_order
from .depth_needles_twin import depth_needles_twin
from .window_fits_twin import window_fits

FAR = 900.0  # [mm]
PINHOLE = Camera("pinhole", 1815.0, 1815.0, 39.5, 29.5, 80, 60)
ORTHOGRAPHIC = Camera("orthographic", 2.0, 2.0, 39.5, 29.5, 80, 60)
CAMERAS = pytest.mark.parametrize("camera", [PINHOLE, ORTHOGRAPHIC], ids=["pinhole", "orthographic"])
MM_PER_PX = FAR / PINHOLE.fx


def rays(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Origin and direction (z = 1) of every pixel's ray."""
    v, u = np.indices((camera.height, camera.width)).astype(float)
    xy = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy], axis=-1)
    zero, one = np.zeros((*u.shape, 1)), np.ones((*u.shape, 1))
    if camera.is_orthographic:
        return np.concatenate([xy, zero], axis=-1), np.concatenate([0.0 * xy, one], axis=-1)
    return np.zeros((*u.shape, 3)), np.concatenate([xy, one], axis=-1)


def tilted(slant: float, azimuth: float) -> np.ndarray:
    """Unit normal toward the camera."""
    return np.array([np.sin(slant) * np.cos(azimuth), np.sin(slant) * np.sin(azimuth), -np.cos(slant)])


def plane(camera: Camera, normal: np.ndarray) -> np.ndarray:
    """Depth [mm] of the plane through (0, 0, FAR)."""
    origin, direction = rays(camera)
    return (np.array([0.0, 0.0, FAR]) - origin) @ normal / (direction @ normal)


def cylinder(camera: Camera, radius: float, axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depth and normals of a cylinder whose axis goes through (0, 0, FAR); 0 off it."""
    origin, d = rays(camera)
    axis = axis / np.linalg.norm(axis)
    to = origin - np.array([0.0, 0.0, FAR])
    d_across, to_across = (a - (a @ axis)[..., None] * axis for a in (d, to))
    a, b = (d_across**2).sum(-1), (d_across * to_across).sum(-1)
    square = b**2 - a * ((to_across**2).sum(-1) - radius**2)
    hit = square > 0
    z = np.where(hit, (-b - np.sqrt(np.where(hit, square, 0.0))) / a, 0.0)
    normal = to_across + z[..., None] * d_across
    return z, np.where(hit[..., None], normal / np.linalg.norm(normal, axis=-1, keepdims=True), 0.0)


def noisy(depth: np.ndarray, noise: float, seed: int) -> np.ndarray:
    jitter = np.random.default_rng(seed).normal(0.0, noise, depth.shape)
    return np.where(depth > 0, depth + jitter, 0.0).astype(np.float32)


@CAMERAS
@pytest.mark.parametrize("slant", [0.0, 0.5, 1.1])
@pytest.mark.parametrize("azimuth", [0.0, 2.0, -1.3])
def test_a_plane_is_exact(camera, slant, azimuth, angle_between):
    normal = tilted(slant, azimuth)
    found = depth_needles(plane(camera, normal), camera, 0.0)
    assert found.known[1:-1, 1:-1].all()
    assert angle_between(found.normals[found.known], normal).max() < 1e-6
    assert (found.normal_std == 0.0).all()


@CAMERAS
@pytest.mark.parametrize("slant", [0.0, 0.7])
def test_noise_turns_normals_as_predicted(camera, slant, angle_between):
    normal, noise = tilted(slant, 0.6), 0.3
    errors, predicted = [], []
    for seed in range(6):
        found = depth_needles(noisy(plane(camera, normal), noise, seed), camera, noise)
        whole = (slice(RADIUS, -RADIUS),) * 2
        assert found.known[whole].mean() > 0.995
        known = found.known[whole]
        errors.append(angle_between(found.normals[whole][known], normal))
        predicted.append(found.normal_std[whole][known])
    rms = np.sqrt(np.mean(np.concatenate(errors) ** 2))
    assert rms == pytest.approx(np.sqrt(np.mean(np.concatenate(predicted) ** 2)), rel=0.12)


@pytest.mark.parametrize(("noise", "turn"), [(0.02, 30.0), (0.1, 60.0), (0.3, 90.0)])
def test_a_crease_stays_sharp(noise, turn, angle_between):
    half = np.radians(turn / 2)
    left, right = tilted(half, np.pi + 0.3), tilted(half, 0.3)
    z = np.maximum(plane(PINHOLE, left), plane(PINHOLE, right))  # a roof toward the camera
    truth = np.where((z == plane(PINHOLE, left))[..., None], left, right)
    found = depth_needles(noisy(z, noise, 0), PINHOLE, noise)
    _, direction = rays(PINHOLE)
    distance = np.abs(direction @ np.array([np.cos(0.3), np.sin(0.3), 0.0])) * PINHOLE.fx
    beside = found.known & (distance > 1.5) & (distance < 6.0)
    assert beside.sum() > 0.9 * ((distance > 1.5) & (distance < 6.0)).sum()
    error = np.degrees(angle_between(found.normals[beside], truth[beside]))
    assert np.median(error) < 5.0 * noise + 0.1
    assert np.percentile(error, 95) < turn / 4  # on its own side: the other one is `turn` away


@pytest.mark.parametrize(
    ("pixels", "noise", "most_slant", "error"),
    [(10, 0.3, 30, 3.5), (20, 0.3, 30, 3.5), (40, 0.3, 45, 3.0), (10, 0.05, 40, 1.2), (20, 0.05, 45, 0.8)],
)
def test_a_cylinder_has_no_bias(pixels, noise, most_slant, error, angle_between):
    """Also one of ten pixels: a bolt's shank."""
    z, normals = cylinder(PINHOLE, pixels * MM_PER_PX, np.array([0.3, 1.0, 0.2]))
    slant = np.arccos(np.clip(-normals[..., 2], -1, 1))
    biases, errors, known = [], [], []
    for seed in range(4):
        found = depth_needles(noisy(z, noise, seed), PINHOLE, noise)
        asked = (z > 0) & (slant < np.radians(most_slant)) & (slant > np.radians(10.0))
        here = asked & found.known
        known.append(here.sum() / asked.sum())
        errors.append(np.degrees(angle_between(found.normals[here], normals[here])))
        toward = np.cross(np.cross([0.0, 0.0, -1.0], normals[here]), normals[here])  # falls toward more slant
        toward /= np.linalg.norm(toward, axis=-1, keepdims=True)
        biases.append(np.degrees(((found.normals[here] - normals[here]) * toward).sum(-1)))
    assert np.mean(known) > 0.8
    assert abs(np.mean(np.concatenate(biases))) < 0.2 + 1.5 * noise
    assert np.sqrt(np.mean(np.concatenate(errors) ** 2)) < error


def test_a_step_belongs_to_its_two_sides(angle_between):
    near, far = plane(PINHOLE, tilted(0.3, 1.0)), plane(PINHOLE, tilted(0.2, -2.0)) + 15.0
    left = np.arange(PINHOLE.width) < 40
    z = np.where(left, near, far)
    found = depth_needles(noisy(z, 0.1, 0), PINHOLE, 0.1)
    assert found.known.mean() > 0.98
    truth = np.where(left[:, None], tilted(0.3, 1.0), tilted(0.2, -2.0))
    error = angle_between(found.normals, np.broadcast_to(truth, found.normals.shape))
    assert np.degrees(np.percentile(error[found.known], 99)) < 3.0


def test_holes_are_bridged_within_a_surface_and_get_no_needle(angle_between):
    normal = tilted(0.4, 0.9)
    z = plane(PINHOLE, normal)
    z[np.random.default_rng(0).random(z.shape) < 0.1] = 0.0
    found = depth_needles(noisy(z, 0.3, 1), PINHOLE, 0.3)
    assert not found.known[z == 0].any()
    assert found.known[z > 0].mean() > 0.8
    assert np.degrees(np.median(angle_between(found.normals[found.known], normal))) < 2.5
    nothing = depth_needles(np.zeros_like(z), PINHOLE, 0.3)
    assert not nothing.known.any()


@pytest.mark.parametrize("radius", [1, 4])
def test_sums_that_go_from_window_to_window_are_those_of_each_alone(radius):
    """Over more rows than are walked down at once, with unknown pixels, and at the rim."""
    rng = np.random.default_rng(radius)
    value, known = rng.normal(size=(75, 41)), rng.random((75, 41)) < 0.9
    on_device = wp.array(value, dtype=wp.float64, device="cpu"), wp.array(known, dtype=wp.bool, device="cpu")
    sums = window_sums(*on_device, radius).numpy()
    assert sums.shape == (75, 41, 8)
    for i, j in ((0, 0), (10, 40), (31, 20), (32, 20), (33, 20), (74, 0), (50, 3)):
        v, u = (a.ravel() for a in np.mgrid[-radius : radius + 1, -radius : radius + 1])
        inside = (i + v >= 0) & (i + v < 75) & (j + u >= 0) & (j + u < 41)
        v, u = v[inside], u[inside]
        there = known[i + v, j + u]
        v, u, f = v[there], u[there], value[i + v, j + u][there]
        alone = [f.sum(), (f * u).sum(), (f * v).sum(), (f * u * v).sum(), (f * u**2).sum(), (f * v**2).sum(),
                 (f**2).sum(), len(f)]
        np.testing.assert_allclose(sums[i, j], alone, atol=1e-10)


def test_the_fits_of_a_window_are_least_squares():
    rng = np.random.default_rng(0)
    value = rng.normal(size=(11, 13))
    fit = window_fits(value, np.ones_like(value, bool), 2)
    v, u = np.mgrid[-2:3, -2:3]
    terms = np.stack([np.ones(25), *(a.ravel() for a in (u, v, u * u / 2, u * v, v * v / 2))], axis=-1)
    around = value[3:8, 4:9].ravel()
    quadric, planar = (np.linalg.lstsq(terms[:, :k], around, rcond=None) for k in (6, 3))
    np.testing.assert_allclose(fit.middle(np.array([5 * fit.mean.shape[1] + 6])), quadric[0][0])
    np.testing.assert_allclose(fit.slope[5, 6], quadric[0][1:3])
    np.testing.assert_allclose(fit.slope[5, 6], planar[0][1:])
    np.testing.assert_allclose(fit.bend[5, 6], quadric[0][3:])
    np.testing.assert_allclose(fit.planar[5, 6], planar[1][0])
    np.testing.assert_allclose(fit.planar[5, 6] - fit.curved[5, 6], quadric[1][0])
    assert fit.full.sum() == 7 * 9


@pytest.mark.parametrize("slope", [0.0, 0.3, 0.8])
def test_the_third_order_of_a_sphere(slope):
    """z = -sqrt(r^2 - x^2 - y^2), seen straight on: third derivatives in closed form along its meridian."""
    r = 40.0
    x = r * slope / np.sqrt(1.0 + slope**2)
    h = np.sqrt(r**2 - x**2)
    f_xx, f_yy = r**2 / h**3, 1.0 / h
    f_xxx, f_xyy = 3.0 * r**2 * x / h**5, x / h**3
    m2, m4 = 20.0 / 3.0, 236.0 / 3.0  # over -4..4
    found = added_by_third_order(
        4, np.array([[slope + f_xxx * m4 / (6 * m2) + f_xyy * m2 / 2, 0.0]]),
        np.array([[f_xx, 0.0, f_yy]]), np.ones(1), np.zeros((1, 2)),
    )
    np.testing.assert_allclose(found, [[f_xxx * m4 / (6 * m2) + f_xyy * m2 / 2, 0.0]], rtol=0.1, atol=1e-12)


def creased_and_round(camera: Camera) -> np.ndarray:
    """Two planes that meet in a crease, a cylinder before them, a step, and holes."""
    z = np.minimum(plane(camera, tilted(0.7, 0.3)), plane(camera, tilted(0.6, 2.9)))
    nearer, _ = cylinder(camera, 4.0, np.array([0.3, 1.0, 0.1]))
    z = np.where(nearer > 0.0, nearer - 6.0, z)
    z[:, :11] += 30.0
    z[20:23, 50:53] = z[40:48, 60:75] = 0.0
    return noisy(z, 0.2, 5)


@CAMERAS
@pytest.mark.parametrize("radius", [4, 2, 1])
def test_windows_compete_as_their_twins_do(camera, radius):
    """Around a pixel and beside it, large ones and small ones."""
    z = creased_and_round(camera)
    found, twin = depth_needles(z, camera, 0.2, radius), depth_needles_twin(z, camera, 0.2, radius)
    np.testing.assert_array_equal(found.known, twin.known)
    np.testing.assert_allclose(found.normals, twin.normals, atol=1e-6)
    np.testing.assert_allclose(found.normal_std, twin.normal_std, rtol=1e-5)
    assert [array.dtype for array in found] == [array.dtype for array in twin]
    assert 0.3 < found.known.mean() < 1.0
