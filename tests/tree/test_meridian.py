"""Views of a part of revolution: one per ring of directions."""

import numpy as np
import pytest

from itree_jax.tree.dome import camera_rotation, dome
from itree_jax.tree.meridian import meridian_views

AXES = [np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), np.array([1.0, -2.0, 2.0]) / 3.0]


@pytest.mark.parametrize("axis", AXES, ids=["z", "x", "tilted"])
@pytest.mark.parametrize("frequency", [1, 2])
def test_cameras_look_along_the_directions_with_the_axis_up(axis: np.ndarray, frequency: int) -> None:
    directions = dome(frequency).directions
    R_cam_obj, R_ring, ring = meridian_views(directions, [axis])
    identity = np.tile(np.eye(3), (len(ring), 1, 1))
    np.testing.assert_allclose(R_cam_obj @ R_cam_obj.transpose(0, 2, 1), identity, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(R_cam_obj), 1.0)
    np.testing.assert_allclose(-R_cam_obj[:, 2], directions, atol=1e-12)
    up = R_cam_obj @ axis
    np.testing.assert_allclose(up[:, 0], 0.0, atol=1e-12)
    assert (up[:, 1] <= 1e-12).all()  # image up is -y
    np.testing.assert_allclose((R_ring @ axis)[ring], up, atol=2e-6)  # the part turned about its axis: the same image


@pytest.mark.parametrize("axis", AXES, ids=["z", "x", "tilted"])
def test_a_ring_is_a_polar_angle(axis: np.ndarray) -> None:
    directions = dome(2).directions
    ring = meridian_views(directions, [axis])[2]
    height = directions @ axis
    together = ring[:, None] == ring[None]
    np.testing.assert_array_equal(together, np.abs(height[:, None] - height[None]) < 1e-6)


def test_the_rings_of_the_papers_dome_about_z() -> None:
    assert len(meridian_views(dome(1).directions, [AXES[0]])[1]) < 20


def test_views_along_the_axis_have_cameras_too() -> None:
    poles = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    R_cam_obj, R_ring, ring = meridian_views(poles, [AXES[0]])
    np.testing.assert_allclose(R_cam_obj[:, 2], -poles, atol=1e-12)
    assert len(R_ring) == len(set(ring.tolist())) == 2


def test_a_sphere_is_seen_once() -> None:
    directions = dome(1).directions
    R_cam_obj, R_ring, ring = meridian_views(directions, list(np.eye(3)))
    np.testing.assert_array_equal(R_cam_obj, camera_rotation(directions))
    assert len(R_ring) == 1
    assert not ring.any()
