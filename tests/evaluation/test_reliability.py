"""Reliability of scores: laws of the bins, and what leaving out low scores changes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from itree_jax.evaluation.judged import ScoredAnswers, judge_answers, scored_answers
from itree_jax.evaluation.matching import match
from itree_jax.evaluation.reliability import calibration_error, equal_bins, equal_count_bins, score_thresholds

SCORED = st.lists(st.tuples(st.floats(0.0, 1.0), st.booleans()), max_size=60)


def arrays(scored):
    return np.array([s for s, _ in scored], float), np.array([r for _, r in scored], bool)


@given(SCORED, st.sampled_from([equal_bins, equal_count_bins]))
def test_bins_partition_the_answers(scored, bins_of):
    score, right = arrays(scored)
    bins = bins_of(score, right)
    assert sum(b.right.total for b in bins) == len(score)
    assert sum(b.right.count for b in bins) == right.sum()
    assert all(b.mean_score is None or b.low - 1e-12 <= b.mean_score <= b.high + 1e-12 for b in bins)


@given(SCORED)
def test_equal_counts_differ_by_one_answer_at_most(scored):
    totals = [b.right.total for b in equal_count_bins(*arrays(scored))]
    assert not totals or max(totals) - min(totals) <= 1


def test_an_edge_belongs_to_the_bin_above_it_and_one_to_the_last():
    bins = equal_bins(np.array([0.0, 0.3, 0.7, 1.0]), np.ones(4, bool))
    assert [k for k, b in enumerate(bins) if b.right.total] == [0, 3, 7, 9]


def test_calibrated_scores_have_no_error_and_sure_ones_err_by_their_share_of_wrong():
    score, right = np.repeat([0.25, 0.75], 4), np.array([1, 0, 0, 0, 1, 1, 1, 0], bool)
    assert calibration_error(equal_bins(score, right)) == pytest.approx(0.0)
    assert calibration_error(equal_bins(np.ones(8), right)) == pytest.approx(0.5)
    assert calibration_error(equal_bins(np.zeros(0), np.zeros(0, bool))) is None


def test_thresholds_count_answers_and_visible_instances():
    answers = ScoredAnswers(
        np.array([0.9, 0.8, 0.2]), np.array([True, False, True]), np.array([True, False, False]), 4
    )
    half, all_of_them = score_thresholds(answers, (0.5, 0.2))
    assert (half.precision.count, half.precision.total, half.recall.count, half.recall.total) == (1, 2, 1, 4)
    assert (all_of_them.precision.count, all_of_them.precision.total, all_of_them.recall.count) == (2, 3, 1)


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 1.0))
def test_leaving_out_low_scores_changes_no_other_match(seed, threshold):
    rng = np.random.default_rng(seed)
    errors, score = rng.uniform(0, 2, (6, 4)), rng.uniform(0, 1, 6)
    left = score >= threshold
    np.testing.assert_array_equal(match(errors[left], score[left], 1.0), match(errors, score, 1.0)[left])


def test_answers_are_judged_as_evaluate_does(dataset, truth, csv_of):
    turned = Rotation.from_euler("x", 90, degrees=True).as_matrix()
    poses = [truth[0], truth[0], (truth[1][0], truth[1][1] @ turned, truth[1][2]), truth[3]]
    (scene,) = judge_answers(dataset, csv_of(poses))
    np.testing.assert_array_equal(scene.found, [0, -1, -1, 3])
    np.testing.assert_array_equal(scene.missed, [1, 2])  # the fourth is visible by half only
    np.testing.assert_array_equal(scene.found_visible, [True, False, False, False])
    scored = scored_answers([scene, scene])
    assert (scored.visible, len(scored.score), scored.right.sum()) == (6, 8, 4)
    assert np.isinf(scene.errors.mssd[0, 3])  # another object
