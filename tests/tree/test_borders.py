"""Borders of groups: who stands, who joins whom."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.tree.borders import labels_of_groups, nearest_label, uncertain_band
from itree_jax.tree.same_label import group_by_label

SENSOR = bundled_sensor("ikeuchi-1987")
SMALLEST = 60.0
CONVEX = np.zeros(3)
IDENTITY = np.arange(3)[None]


def groups_of(area: np.ndarray, band: float, least_views: int, blocking: np.ndarray = CONVEX) -> list[str]:
    labels = labels_of_groups(area, IDENTITY, SMALLEST, blocking, band, least_views)
    return ["".join("01"[int(digit)] for digit in label) for label in labels]


def rows(*counted: tuple[int, tuple[float, float, float]]) -> np.ndarray:
    return np.array([area for count, area in counted for _ in range(count)])


def test_the_band_of_the_papers_setting() -> None:
    rim, cell = np.sqrt(np.pi * 0.25 / 60.0), np.tan(np.radians(42.0)) * np.sqrt(1.0 / 30.0)
    assert uncertain_band(SENSOR, 1, 0.5) == pytest.approx(np.hypot(rim, cell))
    assert uncertain_band(SENSOR, 1, 0.5) == pytest.approx(0.20, abs=0.005)
    assert uncertain_band(SENSOR, 100, 0.5) == pytest.approx(rim, rel=1e-3)
    assert uncertain_band(SENSOR, 2, 1e-9) == pytest.approx(cell / 2.0)
    wide = dataclasses.replace(SENSOR, slant_limit=float(np.radians(89.9)))
    assert uncertain_band(wide, 1, 1e-9) == pytest.approx(np.tan(np.radians(60.0)) * np.sqrt(1.0 / 30.0))


def test_a_label_that_is_uncertain_in_all_its_views_joins_the_larger_one() -> None:
    area = rows((5, (400.0, 0.0, 0.0)), (3, (400.0, 66.0, 0.0)))
    assert groups_of(area, 0.2, 1) == ["100"]
    assert groups_of(area, 0.05, 1) == ["110", "100"]


def test_one_certain_view_keeps_a_label() -> None:
    area = rows((5, (400.0, 0.0, 0.0)), (3, (400.0, 66.0, 0.0)), (1, (400.0, 90.0, 0.0)))
    assert groups_of(area, 0.2, 1) == ["110", "100"]


def test_the_larger_of_two_uncertain_labels_stands_and_of_equal_ones_the_greater_number() -> None:
    assert groups_of(rows((2, (400.0, 63.0, 0.0)), (3, (400.0, 57.0, 0.0))), 0.2, 1) == ["100"]
    assert groups_of(rows((2, (400.0, 63.0, 0.0)), (2, (400.0, 57.0, 0.0))), 0.2, 1) == ["110"]


def test_a_label_under_a_cell_of_the_papers_dome_joins_the_cheapest() -> None:
    area = rows((8, (400.0, 0.0, 0.0)), (8, (0.0, 400.0, 0.0)), (3, (300.0, 90.0, 0.0)))
    assert groups_of(area, 0.1, 4) == ["100", "010"]
    assert groups_of(area, 0.1, 3) == ["110", "100", "010"]
    group, membership = nearest_label(area, np.array([[1, 0, 0], [0, 1, 0]], bool), IDENTITY, SMALLEST, CONVEX)
    np.testing.assert_array_equal(group, [0] * 8 + [1] * 8 + [0] * 3)
    np.testing.assert_allclose(membership[-3:], 60.0 / 90.0)
    np.testing.assert_array_equal(membership[:-3], 1.0)


def test_small_labels_that_are_alike_make_a_group_together() -> None:
    """Far from every large label, three labels of two views become one of six."""
    small = [(2, (0.0, 900.0, 900.0)), (2, (0.0, 900.0, 0.0)), (2, (70.0, 900.0, 0.0))]
    area = rows((20, (900.0, 0.0, 900.0)), *small)
    assert len(groups_of(area, 0.01, 5)) == 2


def test_what_can_be_told_does_not_join_what_cannot() -> None:
    area = rows((9, (0.0, 0.0, 0.0)), (9, (0.0, 900.0, 900.0)), (1, (61.0, 0.0, 0.0)))
    assert groups_of(area, 0.2, 4) == ["011", "000"]
    labels = np.array([[0, 1, 1], [0, 0, 0]], bool)
    assert nearest_label(area[-1:], labels, IDENTITY, SMALLEST, CONVEX)[0] == [0]
    hole = np.array([0.6, 0.0, 0.0])  # digit 0 is one: the view shows nothing that can be told
    assert nearest_label(area[-1:], labels, IDENTITY, SMALLEST, hole)[0] == [1]
    assert groups_of(rows((9, (0.0, 0.0, 0.0)), (1, (61.0, 0.0, 0.0))), 0.2, 4) == ["100", "000"]


area_row = st.lists(st.sampled_from([0.0, 20.0, 55.0, 61.0, 90.0, 500.0]), min_size=3, max_size=3)
areas = st.lists(area_row, min_size=1, max_size=40)


@settings(max_examples=60, deadline=None)
@given(areas, st.floats(0.0, 0.5), st.integers(1, 9), st.booleans())
def test_groups_are_labels_of_views_and_every_one_is_large_enough(listed, band, least_views, symmetric) -> None:
    area = np.array(listed)
    same = np.array([[0, 1, 2], [1, 0, 2]]) if symmetric else IDENTITY
    labels = labels_of_groups(area, same, SMALLEST, CONVEX, band, least_views)
    exact = group_by_label(area > SMALLEST, same)[0]
    assert {label.tobytes() for label in labels} <= {label.tobytes() for label in exact}
    numbers = [int("".join("01"[int(digit)] for digit in label), 2) for label in labels]
    assert numbers == sorted(set(numbers), reverse=True)
    group, membership = nearest_label(area, labels, same, SMALLEST, CONVEX)
    count = np.bincount(group, minlength=len(labels))
    assert count.min() >= 1
    told = labels.any(axis=1)  # nothing goes over to the label of nothing: the last one that shows something stays
    assert (count[told] >= least_views).all() or told.sum() == 1
    exactly = [(label[same][:, None] == labels).all(axis=-1).any() for label in area > SMALLEST]
    np.testing.assert_array_equal(membership == 1.0, exactly)
    if band == 0.0 and least_views == 1:
        assert len(labels) == len(exact)


@settings(max_examples=30, deadline=None)
@given(areas, st.integers(0, 2**16))
def test_the_order_of_the_views_does_not_matter(listed, seed) -> None:
    area = np.array(listed)
    shuffled = area[np.random.default_rng(seed).permutation(len(area))]
    assert groups_of(area, 0.2, 4) == groups_of(shuffled, 0.2, 4)
