"""Many-way nodes: consecutive branches of one rule, whose sides divide the groups, and Bayes on all sides at once."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from itree_jax.tree.branches import ROOT, branches
from itree_jax.tree.classification_rules import rules_in
from itree_jax.tree.error_rates import whole_and_cut
from itree_jax.tree.joining import joined_nodes, many_way_nodes, many_way_sides, side_said, sides_of, tops
from itree_jax.tree.tree import PRUNED

from .crafted import four_groups, nodes_of, random_told, told

PRIOR = np.array([0.4, 0.3, 0.2, 0.1])
KEPT = np.ones(4, bool)
RULES = st.sampled_from(["L1", "L2", "L1+L2", PRUNED])


def test_the_paper_joins_b0_and_b1_and_passes_b2_and_b3_over():
    """Figure 4: a chain with B2, B3 pruned; what follows them has another rule."""
    parent = np.array([ROOT, 0, 0, 2, 1, 4])
    rules = ("L1", "L1", PRUNED, PRUNED, "L6", "L7")
    np.testing.assert_array_equal(tops(parent, rules), [0, 0, 2, 3, 4, 5])


@pytest.mark.parametrize(
    ("rules", "expected"),
    [
        (("L1", "L1", "L1"), [0, 0, 0]),
        (("L1", PRUNED, "L1"), [0, 1, 0]),  # B2 follows B0, B1 lies between
        (("L1", "L6", "L1"), [0, 1, 2]),
        ((PRUNED, "L1", "L1"), [0, 1, 1]),
        (("L1+L6", "L1+L6", "L1"), [0, 0, 2]),  # a pair is a rule of its own
        ((PRUNED, PRUNED, PRUNED), [0, 1, 2]),
    ],
)
def test_a_chain_is_joined_where_one_rule_follows_itself(rules, expected):
    np.testing.assert_array_equal(tops(np.array([ROOT, 0, 1]), rules), expected)


@given(st.lists(st.tuples(st.floats(0, 1), RULES), min_size=1, max_size=9))
def test_the_members_of_a_node_have_one_rule_and_hang_together(drawn):
    parent = np.array([ROOT if k == 0 else int(share * k * 0.999) for k, (share, _) in enumerate(drawn)])
    rules = tuple(rule for _, rule in drawn)
    top = tops(parent, rules)
    for k in range(len(rules)):
        assert rules[top[k]] == rules[k]
        assert top[top[k]] == top[k]
        above = parent[k]
        while above != ROOT and rules[above] == PRUNED:
            above = parent[above]
        joins = above != ROOT and rules[k] == rules[above] != PRUNED
        assert top[k] == (top[above] if joins else k)


@pytest.mark.parametrize(
    ("rules", "node", "expected"),
    [
        (("L1", "L1", "L1"), 0, [0, 1, 2, 3]),
        (("L1", "L6", "L1"), 0, [0, 0, 1, 2]),
        (("L1", "L1", "L6"), 0, [0, 1, 2, 2]),
        (("L1", "L6", "L7"), 0, [0, 0, 1, 1]),
        (("L1", "L6", "L7"), 1, [0, 1, -1, -1]),
        (("L1", "L6", "L1"), 1, [0, 1, -1, -1]),
    ],
)
def test_sides_come_visible_before_hidden(rules, node, expected):
    """Groups 0, 1 are on B0's visible side, which B1 divides; 2, 3 on the hidden one, which B2 divides."""
    tree = four_groups()
    np.testing.assert_array_equal(tree.parent, [ROOT, 0, 0])
    np.testing.assert_array_equal(sides_of(tree.visible, tree.hidden, tops(tree.parent, rules), node), expected)


labels = st.lists(st.lists(st.booleans(), min_size=4, max_size=4), min_size=2, max_size=9, unique_by=tuple)


@given(labels, st.data())
def test_sides_divide_the_groups_that_reach_a_node_and_all_nodes_together_tell_every_group(rows, data):
    group_labels = np.array(rows)
    pruned = np.array(data.draw(st.lists(st.booleans(), min_size=len(rows), max_size=len(rows))))
    tree = branches(group_labels, np.array([400.0, 300.0, 200.0, 100.0]), pruned)
    rule = tuple(data.draw(st.sampled_from(["L1", "L2"])) for _ in range(tree.branch_count))
    nodes, kept = nodes_of(tree, rule), ~pruned
    apart = np.zeros((len(rows), len(rows)), bool)
    for node in many_way_nodes(nodes):
        side = many_way_sides(nodes, kept, node)
        np.testing.assert_array_equal(side >= 0, (nodes.visible[node] | nodes.hidden[node]) & kept)
        assert set(side[side >= 0].tolist()) == set(range(side.max() + 1))
        assert side.max() >= 1
        apart |= (side[:, None] != side[None]) & (side >= 0)[:, None] & (side >= 0)[None]
    different = kept[:, None] & kept[None] & ~np.eye(len(rows), dtype=bool)
    np.testing.assert_array_equal(apart, different)


@given(st.integers(0, 1000))
def test_by_bayes_a_sides_probability_is_the_product_of_what_the_branches_give_it(seed):
    at, tree = random_told(seed), four_groups()
    rule = "L2"
    weight = PRIOR * np.exp(at.log_likelihood[list(rules_in(rule))].sum(axis=0))
    product = np.ones((len(at.group), 4))
    for visible, hidden in zip(tree.visible, tree.hidden, strict=True):
        p = weight[:, visible].sum(axis=1) / weight[:, visible | hidden].sum(axis=1)
        product[:, visible] *= p[:, None]
        product[:, hidden] *= 1 - p[:, None]
    np.testing.assert_allclose(product, weight / weight.sum(axis=1, keepdims=True))
    said = side_said(at, rule, PRIOR, np.arange(4))
    np.testing.assert_array_equal(said, product.argmax(axis=1))
    # one after the other decides the same wherever a side has more than half
    first = product[:, :2].sum(axis=1) > 0.5
    one_by_one = np.where(first, np.where(product[:, 0] > product[:, 1], 0, 1),
                          np.where(product[:, 2] > product[:, 3], 2, 3))  # fmt: skip
    sure = product.max(axis=1) > 0.5
    np.testing.assert_array_equal(said[sure], one_by_one[sure])


def test_a_node_of_two_sides_errs_as_its_branch_does():
    at, tree = random_told(3), four_groups()
    top, error = joined_nodes(tree, ("L1", "L6", "L7"), at, PRIOR, KEPT)
    np.testing.assert_array_equal(top, [0, 1, 2])
    for k, r in enumerate((0, 5, 6)):
        here = at.take(np.flatnonzero((tree.visible[k] | tree.hidden[k])[at.group]))
        np.testing.assert_allclose(error[k], whole_and_cut(here, (r,), PRIOR, tree.visible[k], tree.hidden[k]))


def test_a_many_way_node_errs_where_any_side_is_mistaken():
    """L1 mistakes a quarter of group 3 for group 0; of the cut draws half of it."""
    group, cut = np.repeat(np.arange(4), 8), np.tile([False] * 4 + [True] * 4, 4)
    at = told({"L1": np.full(32, 5.0)}, group, cut, groups=4)
    for k in (24, 28, 29):  # one of four whole ones, two of four cut ones
        at.log_likelihood[0, k, [0, 3]] = [9.0, 0.0]
    top, error = joined_nodes(four_groups(), ("L1", "L1", "L1"), at, PRIOR, KEPT)
    np.testing.assert_array_equal(top, 0)
    np.testing.assert_allclose(error[0], [0.1 / 4, 0.1 / 2], atol=1e-6)
    np.testing.assert_array_equal(error[1:], 0.0)  # at the tops alone


def test_pruned_groups_are_on_no_side():
    pruned = (False, True, False, False)
    nodes = nodes_of(four_groups(pruned), ("L1", "L1", "L1"))
    assert nodes.rule == ("L1", PRUNED, "L1")
    assert many_way_nodes(nodes) == [0]
    np.testing.assert_array_equal(many_way_sides(nodes, ~np.array(pruned), 0), [0, -1, 1, 2])
