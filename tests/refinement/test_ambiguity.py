"""Rivals: poses of one place that the scene cannot tell apart, modulo the part's own symmetries."""

import numpy as np
import pytest
from itree_cad.symmetry import Symmetries
from scipy.spatial.transform import Rotation

from itree_jax.detections import STRONG_ODDS, Alternative, Detection, count_of_poses
from itree_jax.refinement.ambiguity import rivals, same_place
from itree_jax.refinement.likelihood import Support
from itree_jax.refinement.pose_distance import same_part_distance
from itree_jax.refinement.select import likelihood_ratio

DIAMETER = 60.0
NATS = 20.0
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


def apart(R_a, t_a, symmetries: Symmetries) -> float:
    """From the pose (R, T)."""
    return same_part_distance(R_a[None], t_a[None], R, T, symmetries, DIAMETER).item()


def test_a_shift_is_its_length_and_a_turn_carries_the_rim():
    assert apart(R, T + np.array([0, 3, 4]), NONE) == pytest.approx(5.0, abs=1e-6)
    assert apart(*turned(30.0), NONE) == pytest.approx(np.radians(30) * DIAMETER / 2)


def test_symmetric_poses_are_one():
    assert apart(*turned(180.0), TWO_FOLD) == pytest.approx(0.0, abs=1e-6)
    assert apart(*turned(180.0), NONE) > DIAMETER
    for angle in (10.0, 77.0, 180.0):
        assert apart(*turned(angle, offset=(3.0, 0.0, 0.0)), REVOLVED) < 1e-9
    assert apart(*turned(90.0, "x", (3.0, 0.0, 0.0)), REVOLVED) > DIAMETER / 2


def beside(poses, *margins: float, symmetries=NONE):
    """Rivals of pose 0 among the others, which it beats by so many nats."""
    R_all, t_all = (np.stack(values) for values in zip(*poses, strict=True))
    return rivals(np.arange(1, len(poses)), np.array(margins), R_all, t_all, symmetries, DIAMETER, NATS)


def test_an_equal_pose_takes_half_of_the_belief():
    found, share = beside([(R, T), turned(180.0)], 0.0)
    assert found.tolist() == [1]
    assert share.sum() == pytest.approx(0.5)


def test_a_clearly_worse_pose_is_no_rival():
    found, share = beside([(R, T), turned(180.0)], 1000.0)
    assert (len(found), share.sum()) == (0, 0.0)


def test_rivals_come_likeliest_first_each_once_and_share_in_the_ratio_of_the_likelihoods():
    poses = [turned(angle) for angle in (0.0, 90.0, 180.0, 270.0, 181.0)]
    found, share = beside(poses, *(NATS * np.array([2.0, 1.0, 7.0, 1.5])))
    assert found.tolist() == [2, 1]
    np.testing.assert_allclose(share / (1.0 - share.sum()), np.exp([-1.0, -2.0]))
    assert beside(poses[:2] + poses[2:3], 0.0, 0.0, symmetries=TWO_FOLD)[0].tolist() == [1, 2]


def test_only_other_poses_of_one_place_are_rivals():
    """Not the same pose of the part, nor one elsewhere."""
    poses = [(R, T), turned(180.0), turned(2.0), (R, T + np.array([40.0, 0.0, 0.0]))]
    R_all, t_all = (np.stack(values) for values in zip(*poses, strict=True))
    assert same_place(R_all, t_all, NONE, DIAMETER)[0].tolist() == [False, True, False, False]
    assert not same_place(R_all, t_all, TWO_FOLD, DIAMETER)[0].any()


@pytest.mark.parametrize(("seen", "poses_left"), [(True, 1), (False, 2)])
def test_a_near_symmetric_part_is_decided_by_its_telling_feature(seen, poses_left):
    """The pose and its half turn agree everywhere but in 40 pixels. Where these are seen, one pose agrees there by 6
    nats a pixel and the other contradicts by 5; where they are hidden, neither says anything."""
    pixels = np.full((2, 40, 40), 6.0, np.float16)
    pixels[:, :4, :10] = [[[6.0]], [[-5.0]]] if seen else 0.0
    nothing = np.zeros((2, 40, 40), bool)
    one = Support(pixels, 0.0 * pixels, nothing, np.zeros(2), np.zeros(2), np.zeros((2, 2)), 1)
    found, share = beside([(R, T), turned(180.0)], likelihood_ratio(one, 0, 1))
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
