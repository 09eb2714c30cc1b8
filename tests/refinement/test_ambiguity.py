"""Rivals: poses of one place that the scene cannot tell apart, modulo the part's own symmetries."""

import numpy as np
import pytest
from itree_cad.symmetry import Symmetries
from scipy.spatial.transform import Rotation

from itree_jax.detections import STRONG_ODDS, Alternative, Detection, count_of_poses
from itree_jax.refinement.ambiguity import rivals, same_part_distance

DIAMETER = 60.0
NONE = Symmetries(np.eye(4)[None], ())
HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])
TWO_FOLD = Symmetries(np.stack([np.eye(4), HALF_TURN]), ())
REVOLVED = Symmetries(np.eye(4)[None], ((np.array([0.0, 0.0, 1.0]), np.array([3.0, 0.0, 0.0])),))
R = Rotation.from_euler("xyz", [10, 40, -70], degrees=True).as_matrix()
T = np.array([5.0, -8.0, 700.0])


def turned(angle: float, axis: str = "z", offset: tuple[float, float, float] = (0.0, 0.0, 0.0)):
    """The pose after turning the part about a line through `offset`, in its own frame."""
    S, p = Rotation.from_euler(axis, angle, degrees=True).as_matrix(), np.array(offset)
    return R @ S, R @ (p - S @ p) + T


def test_a_shift_is_its_length_and_a_turn_carries_the_rim():
    assert same_part_distance(R, T + np.array([0, 3, 4]), R, T, NONE, DIAMETER) == pytest.approx(5.0)
    R_turned, t = turned(30.0)
    assert same_part_distance(R_turned, t, R, T, NONE, DIAMETER) == pytest.approx(np.radians(30) * DIAMETER / 2)


def test_symmetric_poses_are_one():
    assert same_part_distance(*turned(180.0), R, T, TWO_FOLD, DIAMETER) == pytest.approx(0.0, abs=1e-6)
    assert same_part_distance(*turned(180.0), R, T, NONE, DIAMETER) > DIAMETER
    for angle in (10.0, 77.0, 180.0):
        assert same_part_distance(*turned(angle, offset=(3.0, 0.0, 0.0)), R, T, REVOLVED, DIAMETER) < 1e-9
    assert same_part_distance(*turned(90.0, "x", (3.0, 0.0, 0.0)), R, T, REVOLVED, DIAMETER) > DIAMETER / 2


@pytest.mark.parametrize(("symmetries", "count"), [(NONE, 1), (TWO_FOLD, 0)])
def test_an_equal_pose_takes_half_of_the_belief_unless_it_is_the_same(symmetries, count):
    R_other, t_other = turned(180.0)
    found, share = rivals(
        0, np.array([900.0, 900.0]), np.array([1000.0, 1000.0]), np.stack([R, R_other]), np.stack([T, t_other]),
        symmetries, DIAMETER,
    )  # fmt: skip
    assert len(found) == count
    assert 1.0 - share.sum() == pytest.approx(1.0 / (1 + count))


def test_a_clearly_worse_pose_or_one_elsewhere_is_no_rival():
    R_other, t_other = turned(180.0)
    poses = np.stack([R, R_other, R_other]), np.stack([T, t_other, t_other + np.array([40.0, 0.0, 0.0])])
    found, share = rivals(0, np.array([900.0, 700.0, 900.0]), np.full(3, 1000.0), *poses, NONE, DIAMETER)
    assert (len(found), share.sum()) == (0, 0.0)


def test_an_answer_beside_is_no_rival():
    R_other, t_other = turned(180.0)
    poses, equal = (np.stack([R, R_other]), np.stack([T, t_other])), np.array([900.0, 900.0])
    assert len(rivals(0, equal, equal, *poses, NONE, DIAMETER, answered=[0, 1])[0]) == 0
    assert len(rivals(0, equal, equal, *poses, NONE, DIAMETER, answered=[0])[0]) == 1


def test_rivals_come_likeliest_first_and_their_shares_are_in_the_ratio_of_the_likelihoods():
    turns = [turned(angle) for angle in (0.0, 90.0, 180.0, 270.0)]
    poses = np.stack([R for R, _ in turns]), np.stack([t for _, t in turns])
    deviation = 0.15 * np.sqrt(1000.0)
    evidence = 900.0 - deviation * np.array([0.0, 2.0, 1.0, 7.0])
    found, share = rivals(0, evidence, np.full(4, 1000.0), *poses, NONE, DIAMETER)
    assert found.tolist() == [2, 1]
    np.testing.assert_allclose(share / (1.0 - share.sum()), np.exp([-1.0, -2.0]))


TELLING = 40  # pixels of a small feature


@pytest.mark.parametrize(("seen", "poses_left"), [(True, 1), (False, 2)])
def test_a_near_symmetric_part_is_decided_by_its_telling_feature(seen, poses_left):
    """The pose and its half turn agree in 1000 pixels. Where the feature is seen, the one agrees and the other, which
    shows plain surface there, contradicts; where it is hidden, neither says anything."""
    R_other, t_other = turned(180.0)
    evidence = np.array([940.0 + TELLING * seen, 940.0 - TELLING * seen])
    found, share = rivals(
        0, evidence, np.full(2, 1000.0), np.stack([R, R_other]), np.stack([T, t_other]), NONE, DIAMETER
    )
    alternatives = tuple(Alternative(np.eye(4), float(s)) for s in share)
    d = Detection(1, 0, 1, 0.9, R, T, alternatives=alternatives)
    assert len(found) == poses_left - 1
    assert d.ambiguous == (poses_left == 2)
    assert count_of_poses(alternatives) == poses_left


@pytest.mark.parametrize(("odds", "ambiguous"), [(1.0, True), (0.9 * STRONG_ODDS, True), (1.1 * STRONG_ODDS, False)])
def test_an_answer_is_ambiguous_where_the_odds_are_small(odds, ambiguous):
    share = 1.0 / (1.0 + odds)
    assert Detection(1, 0, 1, 0.9, R, T, alternatives=(Alternative(np.eye(4), share),)).ambiguous == ambiguous
    assert not Detection(1, 0, 1, 0.9, R, T).ambiguous
