"""Poses at a glance: points of a view against what a scene shows, without a ray."""

import numpy as np
import pytest
from itree_kernels.agreement import limits_of
from itree_kernels.camera import Camera
from itree_kernels.glance import glance
from itree_kernels.warp_start import warp_device

from itree_jax.refinement.observed import observe, seen_by

CAMERA = Camera("pinhole", 800.0, 800.0, 40.0, 30.0, 80, 60)
Z = 700.0
LIMITS = limits_of(6.0, np.radians(30.0), 20.0, 0.0)
AGREEING, CLOSENESS, NEEDLES, CONTRADICTING, HIDDEN = range(5)
SQUARE = np.stack([*np.meshgrid(np.linspace(-10, 10, 6), np.linspace(-10, 10, 6)), np.zeros((6, 6))], -1).reshape(-1, 3)
FRONT = np.tile([0.0, 0.0, -1.0], (len(SQUARE), 1))


def wall(needles=True, depth=Z):
    """A plane across the line of sight."""
    shape = (CAMERA.height, CAMERA.width)
    normals = np.tile(np.array([0.0, 0.0, -1.0], np.float32), (*shape, 1))
    weight = np.full(shape, 1.0 if needles else 0.0, np.float32)
    return seen_by(observe(normals, weight, np.broadcast_to(np.float32(depth), shape).copy(), 20.0), CAMERA)


def counts(scene, R=None, t=(0.0, 0.0, Z), points=SQUARE, normals=FRONT):
    """Of one pose, by the only view."""
    R = np.eye(3) if R is None else R
    view = np.zeros(1, int)
    return glance(R[None], np.array([t]), view, points[None], normals[None], scene, LIMITS, warp_device())[0]


def test_a_pose_on_the_surface_agrees_in_all_its_points():
    found = counts(wall())
    assert found.tolist() == [36, 36, 36, 0, 0]
    assert counts(wall(needles=False)).tolist() == [36, 36 * 0.75, 0, 0, 0]


@pytest.mark.parametrize("off", [-5.0, 3.0])
def test_it_is_moved_to_where_the_surface_is(off):
    np.testing.assert_allclose(counts(wall(), t=(0.0, 0.0, Z + off)), counts(wall()), atol=1e-3)


def test_what_is_nearer_hides_and_what_is_farther_contradicts():
    half = np.where(np.arange(CAMERA.width) < CAMERA.width / 2, 1.0, 0.0)
    nearer, farther = wall(depth=Z - 50.0 * half), wall(depth=Z + 50.0 * half)
    assert counts(nearer)[[AGREEING, CONTRADICTING, HIDDEN]].tolist() == [18, 0, 18]
    assert counts(farther)[[AGREEING, CONTRADICTING, HIDDEN]].tolist() == [18, 18, 0]


def test_needles_that_point_elsewhere_contradict():
    tilted = np.tile([0.0, np.sin(np.radians(40.0)), -np.cos(np.radians(40.0))], (len(SQUARE), 1))
    assert counts(wall(), normals=tilted)[[AGREEING, CONTRADICTING]].tolist() == [0, 36]
    assert counts(wall(needles=False), normals=tilted)[[AGREEING, CONTRADICTING]].tolist() == [36, 0]


def test_points_outside_of_the_image_say_nothing():
    assert counts(wall(), t=(200.0, 0.0, Z)).tolist() == [0, 0, 0, 0, 0]


def test_each_pose_is_read_by_its_own_view():
    """Many poses in one call come out as each does alone."""
    rng = np.random.default_rng(3)
    points = np.stack([SQUARE, SQUARE + np.array([3.0, 0.0, 2.0])])
    normals = np.stack([FRONT, FRONT])
    view = rng.integers(0, 2, 500)
    t = np.array([0.0, 0.0, Z]) + rng.uniform(-12.0, 12.0, (500, 3))
    R = np.tile(np.eye(3), (500, 1, 1))
    scene = wall()
    together = glance(R, t, view, points, normals, scene, LIMITS, warp_device())
    for k in (0, 77, 499):
        np.testing.assert_array_equal(together[k], counts(scene, t=t[k], points=points[view[k]], normals=FRONT))
