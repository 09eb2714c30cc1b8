"""Rendered poses and their residuals: the same pixels as the scene's renderer, thresholds in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from itree_kernels.camera import Camera
from itree_kernels.lit_scene import Material, render_scene

from itree_jax.report.pose_pictures import runs, silhouettes
from itree_jax.report.pose_render import RenderedPose, render_pose
from itree_jax.report.residuals import (
    AGREES,
    CONTRADICTS,
    IS_HIDDEN,
    NOTHING,
    Allowed,
    combined,
    explained_regions,
    residual_codes,
)
from itree_jax.report.scene_view import part_mesh, scene_view
from itree_jax.sensing.needle import NeedleMap

ORTHOGRAPHIC = Camera("orthographic", 1.5, 1.5, 119.5, 89.5, 240, 180)
PINHOLE = Camera("pinhole", 700.0, 720.0, 115.0, 92.0, 240, 180)


@pytest.mark.parametrize("camera", [ORTHOGRAPHIC, PINHOLE])
def test_a_pose_is_what_the_scene_renderer_sees(tree, poses, camera):
    mesh, R, t = part_mesh(tree), poses[0][1], poses[1][1]
    lit = render_scene([mesh], [0], R[None], t[None], camera, np.array([[0.0, 0.0, -1.0]]), np.ones(1), Material())
    pose = render_pose(mesh, R, t, camera)
    assert pose is not None
    depth = np.zeros((180, 240))
    depth[pose.window] = pose.depth
    flips = (depth > 0) != (lit.depth > 0)
    assert flips.sum() <= 4  # of some 600 silhouette pixels: rays that graze it
    both = (depth > 0) & (lit.depth > 0)
    assert np.sum(np.abs(depth - lit.depth)[both] > 1e-2) <= 4
    np.testing.assert_array_equal(pose.hit, pose.depth > 0)


@pytest.mark.parametrize("camera", [ORTHOGRAPHIC, PINHOLE])
def test_magnified_three_times_every_third_pixel_is_the_same(tree, poses, camera):
    mesh, R, t = part_mesh(tree), poses[0][0], poses[1][0]
    one, three = render_pose(mesh, R, t, camera), render_pose(mesh, R, t, camera, 3.0)
    assert one is not None
    assert three is not None
    maps = []
    for pose, scale in ((one, 1), (three, 3)):
        depth = np.zeros((180 * scale, 240 * scale))
        depth[pose.window] = pose.depth
        maps.append(depth)
    flips = (maps[0] > 0) != (maps[1][1::3, 1::3] > 0)
    assert flips.sum() <= 4


@pytest.mark.parametrize("t", [[900.0, 0.0, 500.0], [0.0, -900.0, 500.0], [0.0, 0.0, -500.0]])
def test_a_pose_outside_of_the_image_is_none(tree, t):
    assert render_pose(part_mesh(tree), np.eye(3), np.array(t), PINHOLE) is None


def test_a_pose_over_the_rim_is_cut(tree):
    pose = render_pose(part_mesh(tree), np.eye(3), np.array([80.0, 0.0, 500.0]), ORTHOGRAPHIC)
    assert pose is not None
    assert pose.window[1].stop == 240
    assert pose.hit[:, -1].any()


def flat(normal=(0.0, 0.0, -1.0)) -> tuple[RenderedPose, NeedleMap]:
    """A plane at 100 mm that fills one row of seven pixels, and a needle map that agrees."""
    n = np.array(normal) / np.linalg.norm(normal)
    normals = np.broadcast_to(n, (1, 7, 3)).copy()
    pose = RenderedPose(0, 0, 1.0, np.zeros((1, 7), int), np.full((1, 7), 100.0), normals)
    zero, one = np.zeros((1, 7)), np.ones((1, 7), bool)
    none = one[None] & False
    return pose, NeedleMap(normals.copy(), zero + 0.5, one, none, none, zero + 1, zero, zero, zero[None], none)


@pytest.mark.parametrize("normal", [(0, 0, -1), (1, 0, -1), (3, 0, -0.1)])
def test_the_codes_of_a_plane_are_known(normal):
    """Differences count along the normal, down to a cosine of 0.2; no depth says nothing."""
    pose, needle = flat(normal)
    cosine = max(0.2, abs(normal[2]) / np.linalg.norm(normal))
    gap = np.array([[0.0, 0.99, 1.01, -0.99, -1.01, 50.0, 0.0]]) * 2.0 / cosine
    depth = 100.0 + gap
    depth[0, 6] = 0.0
    codes = residual_codes(pose, needle, depth, Allowed(2.0, np.radians(20.0)))
    assert codes.tolist() == [[AGREES, AGREES, CONTRADICTS, AGREES, IS_HIDDEN, CONTRADICTS, NOTHING]]


def test_a_needle_contradicts_beyond_its_tolerance_only_where_it_is_believed():
    pose, needle = flat()
    turn = np.radians([0.0, 19.0, 21.0, 21.0, 90.0, 21.0, 0.0])
    normals = np.stack([np.sin(turn), np.zeros(7), -np.cos(turn)], axis=-1)[None]
    believed = np.array([[True, True, True, False, True, True, False]])
    needle = needle._replace(normals=normals, interpretable=believed)
    depth = np.full((1, 7), 100.0)
    depth[0, 5] = 90.0
    limit = Allowed(2.0, np.radians(20.0))
    codes = residual_codes(pose, needle, depth, limit)
    assert codes.tolist() == [[AGREES, AGREES, CONTRADICTS, AGREES, CONTRADICTS, IS_HIDDEN, AGREES]]
    without = residual_codes(pose, needle, None, limit)
    assert without.tolist() == [[AGREES, AGREES, CONTRADICTS, NOTHING, CONTRADICTS, CONTRADICTS, NOTHING]]


def test_the_nearest_pose_speaks():
    far, _ = flat()
    near = replace(far, depth=far.depth - 1.0)
    a = np.array([[1, 1, 1, 0, 2, 3, 0]], np.uint8)
    b = np.array([[2, 0, 3, 1, 0, 1, 0]], np.uint8)
    for poses, codes, ranks in (((far, near), (a, b), (0, 1)), ((near, far), (b, a), (1, 0))):
        both = combined((1, 7), [*poses, None], [*codes, None])
        assert both.codes.tolist() == [[2, 1, 3, 1, 2, 1, 0]]
        expected = [ranks[1], ranks[0], ranks[1], ranks[1], ranks[0], ranks[1], -1]
        assert both.pose.tolist() == [expected]


def test_a_region_is_explained_by_the_pose_that_agrees_with_half_of_it():
    one, _ = flat()
    residuals = combined((1, 7), [one], [np.array([[1, 1, 2, 1, 3, 0, 1]], np.uint8)])
    labels = np.array([[0, 0, 0, 1, 1, 1, -1]])
    pose, share = explained_regions(labels, residuals, 3)
    assert pose.tolist() == [0, -1, -1]
    np.testing.assert_allclose(share, [2 / 3, 1 / 3, 0.0])


def test_true_poses_agree_and_displaced_ones_do_not(scene, detections, tree):
    view = scene_view(scene, detections, [tree])
    share = [(view.residuals.codes == code).sum() / (view.residuals.codes > 0).sum() for code in (1, 2, 3)]
    assert share[0] > 0.97  # the rest grazes an edge
    assert view.region_pose.min() >= 0
    for shift, code in ((-20.0, CONTRADICTS), (20.0, IS_HIDDEN)):
        moved = tuple(replace(d, t_cam_obj=d.t_cam_obj + np.array([0.0, 0.0, shift])) for d in detections)
        codes = scene_view(scene, replace(detections, detections=moved), [tree]).residuals.codes
        assert (codes == code).sum() > 0.97 * (codes > 0).sum()


def test_answers_are_shown_in_the_order_for_picking(scene, detections, tree):
    view = scene_view(scene, detections, [tree])
    assert [p.detection.offer_rank for p in view.poses] == [0, 1]


@given(st.lists(st.booleans(), min_size=1, max_size=40))
def test_runs_go_once_round_a_closed_line(flags):
    flag = np.array(flags)
    line = np.stack([np.arange(len(flag)), np.zeros(len(flag), int)], axis=-1)[:, None]
    pieces = runs(line, flag)
    inner = np.concatenate([piece[:-1, 0, 0] for piece, _ in pieces])
    np.testing.assert_array_equal(np.sort(inner), np.arange(len(flag)))
    for piece, is_set in pieces:
        assert (flag[piece[:-1, 0, 0]] == is_set).all()
    for (a, _), (b, _) in zip(pieces, pieces[1:] + pieces[:1], strict=True):
        assert a[-1, 0, 0] == b[0, 0, 0]


def test_silhouettes_lie_on_the_border(tree, poses):
    pose = render_pose(part_mesh(tree), poses[0][0], poses[1][0], ORTHOGRAPHIC)
    assert pose is not None
    everywhere = np.zeros((180, 240), bool)
    everywhere[pose.window] = pose.hit
    for line in silhouettes(pose):
        u, v = line[:, 0].T
        neighbours = np.stack([everywhere[v + i, u + j] for i in (-1, 0, 1) for j in (-1, 0, 1)])
        assert neighbours.any(axis=0).all()
        assert not neighbours.all(axis=0).any()
