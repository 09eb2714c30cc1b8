"""Branches: figure 3 of the paper, and the proof of section 2.1.2 as properties of random label tables."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from itree_jax.tree.branches import (
    ROOT,
    Branches,
    branches,
    classification_part,
    division_tests,
    level_partitions,
    tie_classes,
)

PAPER_AREAS = np.array([1738.0, 1654.0, 1117.0, 922.0, 489.0, 489.0, 414.0, 414.0])
PAPER_LABELS = ("11100000", "11000000", "11000010", "11000001", "00001100", "00010000", "00000000")


def bits(labels: tuple[str, ...]) -> np.ndarray:
    return np.array([[digit == "1" for digit in label] for label in labels])


@pytest.fixture(scope="module")
def paper() -> Branches:
    pruned = np.array([False] * 5 + [True] * 2)
    return branches(bits(PAPER_LABELS), PAPER_AREAS, pruned)


def members(row: np.ndarray) -> set[str]:
    return {("S1", "S2", "S3", "S4", "S5", "G6", "G7")[k] for k in np.flatnonzero(row)}


def test_the_paper_part_has_the_branches_of_figure_3(paper: Branches) -> None:
    found = [
        (name, (np.flatnonzero(tested) + 1).tolist(), members(visible), members(hidden))
        for name, tested, visible, hidden in zip(paper.names, paper.tested, paper.visible, paper.hidden, strict=True)
    ]
    assert found == [
        ("B0", [1, 2], {"S1", "S2", "S3", "S4"}, {"S5", "G6", "G7"}),
        ("B1", [3], {"S1"}, {"S2", "S3", "S4"}),
        ("B2", [4], {"G6"}, {"S5", "G7"}),
        ("B3", [5, 6], {"S5"}, {"G7"}),
        ("B4", [7, 8], {"S3", "S4"}, {"S2"}),
        ("B5", [7], {"S3"}, {"S4"}),
    ]
    assert paper.parent.tolist() == [ROOT, 0, 0, 2, 1, 4]
    assert paper.on_visible_side.tolist() == [False, True, False, False, False, True]


def test_B2_and_B3_are_pruned_since_they_lead_to_nondetectable_groups(paper: Branches) -> None:
    assert [name for name, pruned in zip(paper.names, paper.pruned, strict=True) if pruned] == ["B2", "B3"]
    part = classification_part(paper)
    assert part.names == ("B0", "B1", "B4", "B5")
    assert part.parent.tolist() == [ROOT, 0, 1, 2]
    assert part.on_visible_side.tolist() == [False, True, False, True]


def test_what_hangs_below_a_pruned_branch_moves_up_to_the_side_it_came_from() -> None:
    # Faces 1, 2, 3 of falling area; the group of face 1 alone is pruned, the others are told apart by face 2.
    tree = branches(bits(("100", "011", "001")), np.array([9.0, 5.0, 2.0]), np.array([True, False, False]))
    assert tree.pruned.tolist() == [True, False]
    part = classification_part(tree)
    assert part.names == ("B1",)
    assert part.parent.tolist() == [ROOT]


def test_areas_within_5_percent_of_the_largest_are_a_tie() -> None:
    assert tie_classes(PAPER_AREAS) == [[0, 1], [2], [3], [4, 5], [6, 7]]
    assert tie_classes(np.array([100.0, 96.0, 92.0])) == [[0, 1], [2]]  # not a chain
    tests = [np.flatnonzero(test).tolist() for test in division_tests(np.array([100.0, 96.0, 50.0]))]
    assert tests == [[0, 1], [2], [0], [1]]


def test_one_group_needs_no_branch() -> None:
    tree = branches(bits(("101",)), np.array([3.0, 2.0, 1.0]), np.array([False]))
    assert tree.branch_count == 0
    assert tree.visible.shape == (0, 1)
    assert classification_part(tree).branch_count == 0


@st.composite
def label_tables(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    digits = draw(st.integers(1, 7))
    numbers = draw(st.lists(st.integers(0, 2**digits - 1), min_size=1, max_size=20, unique=True))
    labels = np.array([[number >> k & 1 for k in range(digits)] for number in numbers], dtype=bool)
    areas = draw(st.lists(st.sampled_from([100.0, 98.0, 96.0, 60.0, 40.0, 39.0]), min_size=digits, max_size=digits))
    pruned = draw(st.lists(st.booleans(), min_size=len(numbers), max_size=len(numbers)))
    return labels, np.sort(areas)[::-1], np.array(pruned)


@settings(max_examples=150, deadline=None)
@given(table=label_tables())
def test_every_level_only_refines_the_one_above_down_to_single_groups(table) -> None:
    labels, areas, _ = table
    levels = level_partitions(labels, areas)
    for above, below in itertools.pairwise(levels):
        for block in np.unique(below):
            assert len(np.unique(above[below == block])) == 1
    assert len(np.unique(levels[0])) == 1
    assert len(np.unique(levels[-1])) == len(labels)


@settings(max_examples=150, deadline=None)
@given(table=label_tables())
def test_every_group_is_the_end_of_exactly_one_way_down(table) -> None:
    labels, areas, pruned = table
    tree = branches(labels, areas, pruned)
    assert tree.branch_count == len(labels) - 1  # a binary tree whose leaves are the groups
    for k in range(tree.branch_count):
        reaching = tree.visible[k] | tree.hidden[k]
        above = tree.parent[k]
        side = np.ones(len(labels), dtype=bool)
        if above != ROOT:
            side = tree.visible[above] if tree.on_visible_side[k] else tree.hidden[above]
        np.testing.assert_array_equal(reaching, side)
        np.testing.assert_array_equal(tree.visible[k], side & labels[:, tree.tested[k]].any(axis=1))
        assert tree.visible[k].any()
        assert tree.hidden[k].any()


@settings(max_examples=150, deadline=None)
@given(table=label_tables())
def test_the_classification_part_is_the_tree_of_the_groups_that_are_kept(table) -> None:
    labels, areas, pruned = table
    part = classification_part(branches(labels, areas, pruned))
    alone = branches(labels[~pruned], areas, np.zeros(np.count_nonzero(~pruned), dtype=bool))
    np.testing.assert_array_equal(part.tested, alone.tested)
    np.testing.assert_array_equal(part.parent, alone.parent)
    np.testing.assert_array_equal(part.on_visible_side, alone.on_visible_side)
    np.testing.assert_array_equal(part.visible[:, ~pruned], alone.visible)
    np.testing.assert_array_equal(part.hidden[:, ~pruned], alone.hidden)
