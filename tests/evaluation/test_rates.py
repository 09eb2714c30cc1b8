"""Matching and rates."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from itree_jax.evaluation import Rate, match, wilson_interval


def test_a_second_answer_for_one_instance_is_wrong():
    errors = np.array([[1.0, 9.0], [0.5, 9.0]])
    np.testing.assert_array_equal(match(errors, np.array([0.9, 0.8]), 2.0), [0, -1])
    np.testing.assert_array_equal(match(errors, np.array([0.8, 0.9]), 2.0), [-1, 0])
    np.testing.assert_array_equal(match(errors, np.array([0.8, 0.9]), 10.0), [1, 0])


def test_equal_scores_keep_their_order():
    np.testing.assert_array_equal(match(np.zeros((3, 1)), np.ones(3), 1.0), [0, -1, -1])


def test_the_limit_is_not_right_itself():
    np.testing.assert_array_equal(match(np.array([[1.0]]), np.ones(1), 1.0), [-1])


def test_only_valid_instances_are_found():
    np.testing.assert_array_equal(match(np.array([[0.1, 0.2]]), np.ones(1), 1.0, np.array([False, True])), [1])


@pytest.mark.parametrize("shape", [(0, 3), (3, 0), (0, 0)])
def test_nothing_matches_nothing(shape):
    np.testing.assert_array_equal(match(np.zeros(shape), np.zeros(shape[0]), 1.0), np.full(shape[0], -1))


@given(st.integers(1, 400).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilson_equals_scipy(counts):
    count, total = counts
    reference = binomtest(count, total).proportion_ci(0.95, method="wilson")
    assert wilson_interval(count, total) == pytest.approx((reference.low, reference.high), abs=1e-12)


def test_no_trials_say_nothing():
    assert (Rate(0, 0).fraction, Rate(0, 0).interval) == (None, (0.0, 1.0))
