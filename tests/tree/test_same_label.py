"""Labels up to symmetry: orbits of digits, one label for all that look alike, and the distance between labels."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from itree_jax.tree.same_label import digit_margin, digit_permutations, disagreement, group_by_label, whole_orbits

# A fourfold turn of faces 0 2 4 6 and of 1 3, face 5 on the axis.
TURN = np.array([2, 3, 4, 1, 6, 5, 0])
FOURFOLD = np.stack([np.arange(7), TURN, TURN[TURN], TURN[TURN[TURN]]])


def test_digits_are_whole_orbits_in_area_order() -> None:
    np.testing.assert_array_equal(whole_orbits(np.array([3]), FOURFOLD, None), [1, 3])
    np.testing.assert_array_equal(whole_orbits(np.array([5, 6]), FOURFOLD, None), [0, 2, 4, 5, 6])


def test_an_orbit_that_is_too_large_is_left_out_but_never_the_first() -> None:
    np.testing.assert_array_equal(whole_orbits(np.array([1, 2, 5]), FOURFOLD, 3), [1, 3, 5])
    np.testing.assert_array_equal(whole_orbits(np.array([0, 1, 5]), FOURFOLD, 3), [0, 2, 4, 6])


def test_permutations_of_faces_are_permutations_of_digits() -> None:
    faces = np.array([1, 3, 5])
    rows = digit_permutations(FOURFOLD, faces)
    np.testing.assert_array_equal(rows, [[0, 1, 2], [1, 0, 2]])


def test_labels_that_symmetries_carry_into_each_other_are_one() -> None:
    labels = np.array([[0, 1, 1], [1, 0, 1], [0, 1, 0], [0, 0, 1]], dtype=bool)
    group_labels, group = group_by_label(labels, np.array([[0, 1, 2], [1, 0, 2]]))
    np.testing.assert_array_equal(group_labels, [[1, 0, 1], [0, 1, 0], [0, 0, 1]])  # 010: no view shows 100
    np.testing.assert_array_equal(group, [0, 0, 1, 2])


label_rows = st.lists(st.lists(st.booleans(), min_size=7, max_size=7), min_size=1, max_size=12)


@settings(max_examples=50, deadline=None)
@given(label_rows)
def test_one_label_means_one_orbit(rows: list[list[bool]]) -> None:
    labels = np.array(rows)
    group_labels, group = group_by_label(labels, FOURFOLD)
    orbit = [min(label[row].tobytes() for row in FOURFOLD) for label in labels]
    for a in range(len(labels)):
        for b in range(len(labels)):
            assert (group[a] == group[b]) == (orbit[a] == orbit[b])
    distance = disagreement(labels, np.ones(labels.shape), group_labels, FOURFOLD)
    np.testing.assert_array_equal((distance == 0).argmax(axis=1), group)
    assert ((distance == 0).sum(axis=1) == 1).all()
    assert {label.tobytes() for label in group_labels} <= {label.tobytes() for label in labels}


@settings(max_examples=30, deadline=None)
@given(label_rows, st.integers(0, 2**16))
def test_a_symmetry_changes_no_distance(rows: list[list[bool]], seed: int) -> None:
    labels, rng = np.array(rows), np.random.default_rng(seed)
    weight, others = rng.random(labels.shape), rng.random((3, 7)) < 0.5
    plain = disagreement(labels, weight, others, FOURFOLD)
    for row in FOURFOLD:
        np.testing.assert_allclose(disagreement(labels[:, row], weight[:, row], others, FOURFOLD), plain)
        np.testing.assert_allclose(disagreement(labels, weight, others[:, row], FOURFOLD), plain)


def test_the_margin_is_the_log_ratio_to_the_smallest_region() -> None:
    margin = digit_margin(np.array([[0.0, 30.0, 60.0, 120.0, 6e4]]), 60.0)
    np.testing.assert_allclose(margin[0], [np.log(10.0), np.log(2.0), 0.0, np.log(2.0), np.log(10.0)], atol=1e-8)
    assert margin.min() > 0.0


def test_without_symmetry_the_distance_is_a_weighted_hamming_distance() -> None:
    rng = np.random.default_rng(4)
    labels, others, weight = rng.random((6, 5)) < 0.5, rng.random((4, 5)) < 0.5, rng.random((6, 5))
    expected = [[weight[i][labels[i] != other].sum() for other in others] for i in range(6)]
    np.testing.assert_allclose(disagreement(labels, weight, others, np.arange(5)[None]), expected)
    assert disagreement(labels, weight, labels, np.arange(5)[None]).diagonal() == pytest.approx(0.0, abs=0.0)
