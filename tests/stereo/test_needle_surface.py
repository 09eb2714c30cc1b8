"""The surface of needles and matched points: exact needles and a few points give it, what is wrong gives in."""

import numpy as np
import pytest
import trimesh
from itree_kernels.instances import Material
from itree_kernels.lit_scene import render_scene

from itree_jax.stereo.needle_surface import needle_slopes, surface

from .two_views import CAMERA, as_mesh, plane_depth, rays

TILTED = np.array([0.45, -0.3, -1.0]) / np.linalg.norm([0.45, -0.3, -1.0])
LEVEL = np.array([0.0, 0.0, -1.0])
POINT = np.array([5.0, -8.0, 890.0])
SHAPE = (CAMERA.height, CAMERA.width)
COARSE, FINE = 1.5, 0.2  # [mm] deviations of matched points


def sphere(radius: float = 150.0, distance: float = 1000.0) -> tuple[np.ndarray, np.ndarray]:
    """Depth and needles of a sphere that fills the image, by closed form."""
    ray, centre = rays(CAMERA), np.array([10.0, -5.0, distance])
    along, square = ray @ centre, (ray**2).sum(-1)
    z = (along - np.sqrt(along**2 - square * (centre @ centre - radius**2))) / square
    return z, (z[..., None] * ray - centre) / radius


def tilted() -> tuple[np.ndarray, np.ndarray]:
    return plane_depth(CAMERA, TILTED, POINT), np.broadcast_to(TILTED, (*SHAPE, 3))


def one_in_a_hundred(z: np.ndarray) -> np.ndarray:
    matched = np.zeros(SHAPE)
    matched[4::10, 4::10] = z[4::10, 4::10]
    return matched


@pytest.mark.parametrize("solid", ["box", "ball"])
def test_slopes_are_differences_of_log_depth(solid):
    """Of what the renderer shows."""
    mesh = as_mesh(
        trimesh.creation.box((300, 300, 20)) if solid == "box" else trimesh.creation.icosphere(6, radius=70.0)
    )
    axis = np.cross(LEVEL, TILTED)
    angle = np.arcsin(np.linalg.norm(axis))
    R = trimesh.transformations.rotation_matrix(angle, axis)[:3, :3] if solid == "box" else np.eye(3)
    light = np.array([[0.0, 0.0, -1.0]])
    t = np.array([[3.0, 2.0, 900.0]])
    lit = render_scene([mesh], [0], R[None], t, CAMERA, light, np.ones(1), Material())
    there = lit.normal[..., 2] < -0.6
    slopes = needle_slopes(lit.normal.astype(float), there.astype(float), CAMERA)
    log_z = np.log(np.where(there, lit.depth, 1.0).astype(float))
    for said, weight, axis in ((slopes.right, slopes.weight_right, 1), (slopes.down, slopes.weight_down, 0)):
        between = weight > 0.0
        assert between.mean() > 0.6
        off = 900.0 * (said - np.diff(log_z, axis=axis))[between]  # [mm]
        assert np.abs(off).max() < (1e-3 if solid == "box" else 0.02)  # float32 depth; facets of the ball
        assert np.abs(off).mean() < 2e-3
        assert np.abs(said[between]).max() * 900.0 > 0.1


def test_pixels_without_a_needle_have_no_slope():
    weight = np.ones(SHAPE)
    weight[10:20, 30:40] = 0.0
    slopes = needle_slopes(np.broadcast_to(TILTED, (*SHAPE, 3)), weight, CAMERA)
    assert not slopes.weight_right[10:20, 29:40].any()
    assert not slopes.right[10:20, 29:40].any()
    assert not slopes.weight_down[9:20, 30:40].any()
    assert (slopes.weight_right == 0).sum() == 10 * 11
    away = needle_slopes(np.broadcast_to(-TILTED, (*SHAPE, 3)), np.ones(SHAPE), CAMERA)
    assert not away.weight_right.any()


@pytest.mark.parametrize("shape", [tilted, sphere])
def test_needles_and_one_matched_point_in_a_hundred_give_the_surface(shape):
    z, normals = shape()
    slopes = needle_slopes(normals, np.ones(SHAPE), CAMERA)
    assert np.ptp(z) > 15.0
    found = surface(slopes, one_in_a_hundred(z), np.full(SHAPE, FINE), CAMERA)
    assert np.abs(found - z).max() < 0.05
    found = surface(slopes, one_in_a_hundred(z), np.full(SHAPE, FINE), CAMERA, rounds=12)
    assert np.abs(found - z).max() < 0.01


def test_a_wrong_match_gives_in():
    z, normals = tilted()
    slopes = needle_slopes(normals, np.ones(SHAPE), CAMERA)
    matched = z.copy()
    matched[84:86, 104:107] -= 30.0
    found = surface(slopes, matched, np.full(SHAPE, COARSE), CAMERA)
    assert np.abs(found - z).max() < 0.05


def test_a_step_between_two_planes_is_not_smeared():
    rng = np.random.default_rng(0)
    left = np.arange(CAMERA.width) < 90
    z = np.where(left, plane_depth(CAMERA, LEVEL, POINT), plane_depth(CAMERA, TILTED, POINT - [0, 0, 40.0]))
    normals = np.where(left[:, None], LEVEL, TILTED) * np.ones((*SHAPE, 1))
    slopes = needle_slopes(normals, np.ones(SHAPE), CAMERA)
    found = surface(slopes, z + rng.normal(0.0, 1.0, SHAPE), np.full(SHAPE, COARSE), CAMERA)
    assert np.abs(np.diff(z, axis=1)[:, 89]).min() > 5.0
    assert np.abs(found - z).max() < 1.0
    assert np.abs(found - z)[:, 85:95].mean() < 0.2


def test_noise_of_matched_points_averages_along_the_needles():
    rng = np.random.default_rng(1)
    z, normals = tilted()
    slopes = needle_slopes(normals, np.ones(SHAPE), CAMERA)
    found = surface(slopes, z + rng.normal(0.0, COARSE, SHAPE), np.full(SHAPE, COARSE), CAMERA)
    assert np.sqrt(np.mean((found - z) ** 2)) < COARSE / 10


def test_without_needles_depth_goes_on_as_it_is():
    matched = np.zeros(SHAPE)
    matched[:, :20] = 870.0
    nothing = needle_slopes(np.zeros((*SHAPE, 3)), np.zeros(SHAPE), CAMERA)
    np.testing.assert_allclose(surface(nothing, matched, np.full(SHAPE, COARSE), CAMERA), 870.0, atol=0.05)
