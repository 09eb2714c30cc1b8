"""Figures 3 and 4: every branch and group of the tree is drawn once, and the sides are those of the branches."""

import numpy as np
import pytest

from itree_jax.tree.chain import determination_chain, freedom_taken, left_open
from itree_jax.tree.drawing import (
    Drawing,
    branch_drawing,
    interpretation_drawing,
    leaf_names,
    node_error,
    node_name,
)
from itree_jax.tree.freedom import Freedom, freedom_along
from itree_jax.tree.joining import tops
from itree_jax.tree.tree import PRUNED, InterpretationTree

from .drawn_trees import random_tree, with_rules, with_steps


def assert_drawn(tree: InterpretationTree, drawing: Drawing, groups: np.ndarray) -> None:
    """Sides part the groups of their node, a node has the groups of the side above it, answers tell sides apart."""
    assert sorted(drawing.leaves) == groups.tolist()
    assert sum(node.above is None for node in drawing.nodes) == min(1, len(drawing.nodes))
    for k, node in enumerate(drawing.nodes):
        assert len(node.sides) >= 2
        assert len(set(node.groups)) == len(node.groups)
        assert len({side.answers for side in node.sides}) == len(node.sides)
        for side in node.sides:
            assert side.groups
            for branch, visible in side.answers:
                members = tree.nodes.visible[branch] if visible else tree.nodes.hidden[branch]
                assert members[list(side.groups)].all()
            if side.below is None:
                assert len(side.groups) == 1
            else:
                assert drawing.nodes[side.below].above == k < side.below
                assert sorted(drawing.nodes[side.below].groups) == sorted(side.groups)


@pytest.mark.parametrize("seed", range(8))
def test_figure_3_has_every_branch_and_group(paper_tree, seed):
    tree = random_tree(paper_tree, seed, 2 + 4 * seed)
    drawing = branch_drawing(tree)
    assert_drawn(tree, drawing, np.arange(tree.groups.group_count))
    assert [node.branches for node in drawing.nodes] == [(k,) for k in range(len(tree.nodes.branch))]


@pytest.mark.parametrize("seed", range(8))
def test_figure_4_has_what_decides_and_the_groups_that_are_kept(paper_tree, seed):
    tree = random_tree(paper_tree, seed, 2 + 4 * seed)
    drawing = interpretation_drawing(tree)
    assert_drawn(tree, drawing, np.flatnonzero(~tree.groups.pruned))
    deciding = [k for k, rule in enumerate(tree.nodes.rule) if rule != PRUNED]
    assert sorted(k for node in drawing.nodes for k in node.branches) == deciding
    for node in drawing.nodes:
        assert len({tree.nodes.rule[k] for k in node.branches}) == 1
        assert len(node.sides) == len(node.branches) + 1  # each branch more parts one side more
        name = node_name(tree, node)
        assert name.split("+") == [tree.nodes.branch[k] for k in node.branches]


def test_both_figures_have_the_leaves_in_one_order(paper_tree):
    tree = random_tree(paper_tree, 3, 20)
    kept = [g for g in branch_drawing(tree).leaves if not tree.groups.pruned[g]]
    names = leaf_names(tree)
    assert sorted(names) == sorted(kept)
    assert list(names.values()) == [f"S{k + 1}" for k in range(len(kept))]


def test_the_papers_b0_and_b1_are_one_node_of_three_sides(paper_tree):
    """Sec. 2.1.5: B0 and B1 go by L1, B4 by L6, B5 by L7; B2 and B3 are pruned."""
    tree = with_rules(paper_tree, ("L1", "L1", PRUNED, PRUNED, "L6", "L7"))
    first, second, third = interpretation_drawing(tree).nodes
    labels = tree.groups.label_strings
    assert [node.branches for node in (first, second, third)] == [(0, 1), (4,), (5,)]
    assert [[labels[g] for g in side.groups] for side in first.sides] == [
        ["11100000"], ["11000010", "11000001", "11000000"], ["00001100"],
    ]  # fmt: skip
    assert node_error(tree, first) == tuple(tree.nodes.joined_error[0].tolist())
    assert node_error(tree, second) == tuple(tree.nodes.whole_and_cut[4].tolist())
    np.testing.assert_array_equal(tree.nodes.joined, tops(tree.nodes.parent, tree.nodes.rule))


def test_a_chain_tells_the_freedom_that_each_rule_takes(paper_tree):
    """Sec. 2.2.2: A1 the viewer direction, A4 all rotations but two, A5 one of them."""
    tree = with_steps(paper_tree, 0, ("A1", "A4", "A5"), 1)
    assert determination_chain(tree, 0) == [
        ("A1", "direction 2 → 0"),
        ("A4", "rotation 360 → 2"),
        ("A5", "rotation 2 → 1"),
    ]
    assert left_open(tree, 0) == "unique"
    assert left_open(with_steps(paper_tree, 0, ("A1", "A4"), 2), 0) == "2 rotations open"
    assert left_open(with_steps(paper_tree, 0, (), 0), 0) == "direction, rotation open"
    assert determination_chain(with_steps(paper_tree, 0, (), 0), 0) == []
    assert freedom_taken(Freedom(2, 0), freedom_along(("A2",))[-1]) == "direction 2 → 0, rotation 360 → 1"
