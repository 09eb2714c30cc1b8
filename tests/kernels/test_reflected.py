"""Interreflections: closed forms at a wall above a floor, nothing where nothing is seen, the seed decides."""

import numpy as np
import pytest
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError
from itree_kernels.instances import Material
from itree_kernels.mesh import ray_mesh
from itree_kernels.reflected import reflected_light

CAMERA = Camera("orthographic", 1.0, 1.0, 3.5, 3.5, 8, 8)
FLOOR_Y, WALL_Z = 8.0, 100.0  # [mm]; the image reaches from y = -3.5 to 4.5
FAR = 4000.0  # [mm]
UP = np.array([[0.0, -1.0, 0.0]])


def rectangle(corners) -> object:
    return ray_mesh(np.array(corners, float), np.array([[0, 1, 2], [0, 2, 3]]), np.zeros(2, int), device="cpu")


def wall():
    """Faces the camera."""
    return rectangle([[-FAR, -FAR, WALL_Z], [-FAR, FLOOR_Y, WALL_Z], [FAR, FLOOR_Y, WALL_Z], [FAR, -FAR, WALL_Z]])


def floor():
    """Faces up, from the wall toward the camera and beyond it."""
    y = FLOOR_Y
    return rectangle([[-FAR, y, WALL_Z], [-FAR, y, WALL_Z - FAR], [FAR, y, WALL_Z - FAR], [FAR, y, WALL_Z]])


def traced(meshes, albedo, samples=400, lights=UP, intensities=None, seed=0):
    count = len(meshes)
    e = np.ones(len(lights)) if intensities is None else intensities
    R, t = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
    return reflected_light(meshes, range(count), R, t, CAMERA, lights, e, Material(np.array(albedo)), samples, seed)


def test_a_wall_sees_the_floor_in_half_of_its_directions():
    added = traced([wall(), floor()], [0.5, 0.8])
    # the light grazes the wall: what the floor sends back has come from it once
    assert added.mean() == pytest.approx(0.5 * 0.8 * 0.5, rel=0.03)
    assert added.std() < 0.03


def test_reflected_light_is_linear_in_intensity_and_in_each_albedo():
    one = traced([wall(), floor()], [0.5, 0.8], samples=20)
    twice = traced([wall(), floor()], [0.5, 0.8], 20, intensities=np.array([2.0]))
    np.testing.assert_allclose(twice, 2 * one, rtol=1e-5)
    np.testing.assert_allclose(traced([wall(), floor()], [0.25, 0.8], 20), 0.5 * one, rtol=1e-5)
    np.testing.assert_allclose(traced([wall(), floor()], [0.5, 0.4], 20), 0.5 * one, rtol=1e-5)


def test_two_lights_share_the_paths():
    both = traced([wall(), floor()], [0.5, 0.8], 20, np.array([UP[0], [0.6, -0.8, 0.0]]))
    np.testing.assert_allclose(both[1], 0.8 * both[0], rtol=1e-5)


def test_a_wall_alone_gets_nothing():
    assert not traced([wall()], [0.9], samples=50).any()


def test_the_seed_decides():
    same, again, other = (traced([wall(), floor()], [0.5, 0.8], 8, seed=s) for s in (3, 3, 4))
    np.testing.assert_array_equal(same, again)
    assert (same != other).any()


def test_errors():
    with pytest.raises(ItreeError, match="at least one sample, not 0"):
        traced([wall()], [0.5], samples=0)
    with pytest.raises(ItreeError, match="as many intensities"):
        traced([wall()], [0.5], intensities=np.ones(2))
