"""Poses moved along what is told least of them: which motions these are, how far they go; the right pose wins."""

from dataclasses import replace

import numpy as np
import pytest
from itree_cad.symmetry import Symmetries
from scipy.spatial.transform import Rotation

from itree_jax.answers import measured_by
from itree_jax.least_told import FAR, MOTIONS, least_told, moved_along_least_told, moved_poses
from itree_jax.prepared import prepare
from itree_jax.recognition import as_forest, read_scene

from .accepted import only

DIAMETER = 60.0
NO_SYMMETRY = Symmetries(np.eye(4)[None], ())
R = Rotation.from_euler("xyz", [20.0, -35.0, 50.0], degrees=True).as_matrix()


def known_but(*motions: np.ndarray) -> np.ndarray:
    """Information of a rim all of whose motions are known but these unit ones, the first least of all."""
    to_rim = np.diag(np.repeat([DIAMETER / 2.0, 1.0], 3))
    information = np.eye(6)
    for k, motion in enumerate(motions):
        information -= (0.999 - 0.1 * k) * np.outer(motion, motion)
    return to_rim @ information @ to_rim


def test_the_motions_that_are_told_least_are_found():
    slide, turn = np.array([0, 0, 0, 0.6, 0.8, 0.0]), np.array([0.0, 0.0, 1.0, 0, 0, 0])
    found = least_told(known_but(slide, turn), R, NO_SYMMETRY, DIAMETER)
    assert found.shape == (MOTIONS, 6)
    np.testing.assert_allclose(np.abs(found[0]), slide, atol=1e-9)
    np.testing.assert_allclose(np.abs(found[1]), turn * 2.0 / DIAMETER, atol=1e-9)


def test_turns_about_an_axis_of_revolution_are_no_motion():
    """They are told least of all, and change nothing."""
    axis = np.array([0.0, 0.0, 1.0])
    slide = np.array([0, 0, 0, 1.0, 0.0, 0.0])
    round_part = Symmetries(np.eye(4)[None], ((axis, np.zeros(3)),))
    about = np.concatenate([R @ axis, np.zeros(3)])
    found = least_told(known_but(about, slide), R, round_part, DIAMETER)
    np.testing.assert_allclose(np.abs(found[0]), slide, atol=1e-9)
    assert np.abs(found @ about).max() < 1e-9


def test_the_rim_moves_both_ways_and_so_far():
    t = np.array([3.0, -5.0, 900.0])
    twists = np.array([[0, 0, 0, 1.0, 0, 0], [2.0 / DIAMETER, 0, 0, 0, 0, 0]])
    poses = moved_poses(R, t, twists, DIAMETER)
    expected = DIAMETER * np.concatenate([FAR, np.negative(FAR)])
    slid, turned = slice(0, len(expected)), slice(len(expected), None)
    np.testing.assert_allclose(poses.t_cam_obj[slid] - t, expected[:, None] * [1.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(poses.t_cam_obj[turned], np.tile(t, (len(expected), 1)))
    turns = Rotation.from_matrix(poses.R_cam_obj[turned] @ R.T).as_rotvec()
    np.testing.assert_allclose(turns[:, 0] * DIAMETER / 2.0, expected)


@pytest.fixture(scope="module")
def read(paper_tree, paper_part_on_a_table):
    scene, _ = paper_part_on_a_table
    answers, sight = read_scene(as_forest(prepare(paper_tree)), scene.images, scene.sensor, scene.depth, scene.R_w2c)
    return answers[0], sight


@pytest.mark.parametrize("way", [0.1, -0.1, 0.04, -0.04])  # the last two: nearly the same pose, and yet another
def test_a_pose_that_was_moved_so_gives_way_to_the_right_one(read, way):
    answer, sight = read
    prepared, h = answer.prepared, answer.selection.accepted[0]
    diameter = prepared.tree.part.diameter
    right = [np.asarray(a[h], float) for a in answer.hypotheses.poses]
    twist = least_told(measured_by(answer, sight)[0][0], right[0], prepared.symmetries, diameter)[0] * way * diameter
    wrong = only(answer, sight, Rotation.from_rotvec(twist[:3]).as_matrix() @ right[0], right[1] + twist[3:])
    found = moved_along_least_told(wrong, sight)
    best = found.selection.accepted[0]
    R_found, t_found = (np.asarray(a[best], float) for a in found.hypotheses.poses)
    turned = Rotation.from_matrix(R_found @ right[0].T).magnitude()
    assert turned * diameter / 2.0 + np.linalg.norm(t_found - right[1]) < 0.02 * diameter
    assert found.judged.log_likelihood[best] > wrong.judged.log_likelihood[0]


def test_where_nothing_is_accepted_nothing_is_moved(read):
    answer, sight = read
    none = answer.selected(replace(answer.selection, accepted=np.zeros(0, int)))
    assert moved_along_least_told(none, sight) is none
