"""The peers' foreground of planes and boxes, and their selection of poses, by closed forms; neither peer is needed."""

from dataclasses import replace

import numpy as np
import pytest
from peers.foreground import fitted_plane, foreground, neighbours
from peers.scenes import DepthScene
from peers.selection import Verified, agreement, angle_between, contenders, selected

K = np.array([[200.0, 0.0, 79.5], [0.0, 200.0, 59.5], [0.0, 0.0, 1.0]])
FLOOR, DIAMETER = 200.0, 40.0  # [mm]; one pixel is 1 mm there


def scene_of(depth: np.ndarray) -> DepthScene:
    return DepthScene(1, (1,), depth, K, np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, FLOOR]))


def bin_depth() -> np.ndarray:
    """A floor, a rim 30 mm above it longer than any part, and the top of a box of 20 x 20 pixels, 12 mm above it."""
    depth = np.full((120, 160), FLOOR)
    depth[:10] = FLOOR - 30.0
    depth[50:70, 60:80] = FLOOR - 12.0
    return depth


def test_foreground_is_the_part_without_floor_and_rim() -> None:
    scene = scene_of(bin_depth())
    normals = np.broadcast_to([0.0, 0.0, -1.0], (*scene.depth.shape, 3))
    expected = scene.depth == FLOOR - 12.0
    np.testing.assert_array_equal(foreground(scene, scene.points, normals, DIAMETER), expected)


def test_plane_as_long_as_a_part_is_kept() -> None:
    scene = scene_of(bin_depth())
    normals = np.broadcast_to([0.0, 0.0, -1.0], (*scene.depth.shape, 3))
    assert foreground(scene, scene.points, normals, 200.0).sum() == (scene.depth < FLOOR).sum()


def test_wall_has_few_neighbours_and_a_corner_enough() -> None:
    depth = np.full((40, 40), FLOOR)
    depth[:, 20:] += 6.0 * np.arange(20)  # 6 mm of depth per pixel: a wall under 80 degrees
    depth[:20, :20] -= 50.0  # its corner is a part's
    count = neighbours(depth)
    assert count[30, 30] == 7
    assert count[19, 19] == 16
    assert count[10, 10] == 49


def test_plane_is_fitted_and_looks_at_the_camera() -> None:
    rng = np.random.default_rng(0)
    normal = np.array([0.36, 0.48, -0.8])
    sides = np.linalg.svd(normal[None])[2][1:]
    points = rng.normal(size=(50, 2)) @ sides * 20 - 300.0 * normal
    found, offset = fitted_plane(points)
    np.testing.assert_allclose(found, normal, atol=1e-9)
    assert offset == pytest.approx(-300.0)


def verified(pixels: range, predicted: int, contradicted: int = 0) -> Verified:
    return Verified(np.eye(4), np.arange(pixels.start, pixels.stop), np.ones(len(pixels)), predicted, contradicted)


def test_each_pixel_belongs_to_the_pose_that_explains_itself_best() -> None:
    best, twin, other = verified(range(100), 100), verified(range(5, 100), 100), verified(range(90, 180), 100)
    chosen = selected([twin, other, best])
    assert [pose for pose, _ in chosen] == [best, other]
    assert [score for _, score in chosen] == [1.0, 0.8]  # ten pixels of the other were taken


def test_pose_before_nothing_is_refused() -> None:
    assert selected([verified(range(80), 100, contradicted=20)]) == []
    assert selected([verified(range(49), 100)]) == []


def test_agreement_tells_explained_hidden_and_contradicted() -> None:
    normal = np.tile([0.0, 0.0, -1.0], (5, 1))
    seen = normal.copy()
    seen[4] = [1.0, 0.0, 0.0]
    z = np.array([100.75, 90.0, 110.0, 0.0, 100.0])  # agrees, something in front, seen through, no depth, another face
    weight, contradicted = agreement(np.full(5, 100.0), normal, z, seen, 1.5)
    assert weight.tolist() == [0.75, 0.0, 0.0, 0.0, 0.0]
    assert contradicted.tolist() == [False, False, True, False, False]


def test_rivals_claim_the_same_pixels_in_another_attitude() -> None:
    best, elsewhere = verified(range(100), 100), verified(range(200, 300), 100)
    quarter, near = np.eye(4), np.eye(4)
    quarter[:2, :2] = [[0.0, -1.0], [1.0, 0.0]]
    near[:2, :2] = [[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]]
    turned = replace(best, T_cam_obj=quarter)
    assert angle_between(best.T_cam_obj, quarter) == pytest.approx(90.0)
    assert contenders([best, replace(best, T_cam_obj=near), turned, elsewhere], [best]) == [best, turned]
