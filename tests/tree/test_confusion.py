"""Expected errors: products along the way, pairs of groups, and a count on fresh draws that bears them out."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from itree_jax.tree.classification_rules import RULE_NAMES
from itree_jax.tree.confusion import AMBIGUOUS, counted, expected_confusion, inseparable, pair_errors, walked
from itree_jax.tree.error_rates import independent_draws, wilson_interval
from itree_jax.tree.joining import side_said

from .crafted import four_groups, nodes_of, random_told, told

PRIOR = np.array([0.4, 0.3, 0.2, 0.1])
KEPT = np.ones(4, bool)


def mistaken(rates: dict[str, tuple[float, float, float, float]], each: int = 20):
    """Whole and cut draws of four groups; of each, rule r mistakes these shares for all other groups."""
    group, cut = np.repeat(np.arange(4), 2 * each), np.tile(np.repeat([False, True], each), 4)
    place = np.tile(np.arange(each), 8)
    margins = {rule: np.where(place < np.array(rate)[group] * each - 1e-9, -9.0, 9.0) for rule, rate in rates.items()}
    return told(margins, group, cut, groups=4)


def test_the_expected_error_is_the_product_of_what_goes_right():
    """B0 by L1 errs in a tenth, B1 by L6 in a fifth, B2 by L7 in a half: of groups 0, 1 goes right .9 x .8, of 2, 3
    .9 x .5."""
    at = mistaken({"L1": (0.1,) * 4, "L6": (0.2, 0.2, 0, 0), "L7": (0, 0, 0.5, 0.5)})
    prior = np.array([0.2, 0.2, 0.3, 0.3])  # what speaks against a group speaks for the other side
    found = expected_confusion(nodes_of(four_groups(), ("L1", "L6", "L7")), at, prior, KEPT)
    np.testing.assert_allclose(found.group_error, np.repeat([[0.28], [0.28], [0.55], [0.55]], 2, axis=1), atol=1e-6)
    np.testing.assert_allclose(found.expected_error, 0.4 * 0.28 + 0.6 * 0.55, atol=1e-6)


def test_a_joined_node_is_passed_once():
    at = mistaken({"L1": (0.1, 0.2, 0.3, 0.4)})
    found = expected_confusion(nodes_of(four_groups(), ("L1", "L1", "L1")), at, PRIOR, KEPT)
    np.testing.assert_allclose(found.group_error[:, 0], [0.1, 0.2, 0.3, 0.4], atol=1e-6)


def test_groups_that_are_pruned_have_no_error_and_kinds_that_were_not_drawn_none_that_is_known():
    pruned = np.array([False, True, False, False])
    at = mistaken({"L1": (0.1,) * 4})
    at = at.take(np.flatnonzero(~at.cut & (at.group != 1)))
    prior = np.array([0.5, 0.0, 0.3, 0.2])
    found = expected_confusion(nodes_of(four_groups(tuple(pruned)), ("L1",) * 3), at, prior, ~pruned)
    np.testing.assert_array_equal(np.isnan(found.group_error), np.repeat(pruned[:, None], 2, axis=1))
    np.testing.assert_allclose(found.expected_error, [0.1, 0.0], atol=1e-6)
    assert np.isnan(found.pair_error[1]).all()


@given(st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_the_error_between_two_groups_is_that_of_the_best_rule_seen_equally_often(seed):
    at = random_told(seed)
    error, names = pair_errors(at, KEPT)
    np.testing.assert_array_equal(error, error.T)
    assert np.isnan(np.diagonal(error)).all()
    for g, h in ((0, 1), (2, 3), (0, 3)):
        rates = []
        for said in at.log_likelihood:
            wrong = [[np.mean(said[of, a] < said[of, b]) for cut in (False, True)
                      for of in [(at.group == a) & (at.cut == cut)]] for a, b in ((g, h), (h, g))]  # fmt: skip
            rates.append(np.mean(wrong))
        assert error[g, h] == pytest.approx(min(rates), abs=1e-6)
        assert names[g][h] == names[h][g]
        assert rates[RULE_NAMES.index(names[g][h])] == pytest.approx(min(rates), abs=1e-6)  # of equals, any
        assert names[g][g] == ""


def test_inseparable_are_those_that_every_rule_confuses_in_over_a_quarter(paper_tree):
    error = np.full_like(paper_tree.confusion.pair_error, np.nan)
    error[0, 1] = error[1, 0] = AMBIGUOUS
    error[0, 3] = error[3, 0] = AMBIGUOUS + 0.01
    tree = replace(paper_tree, confusion=replace(paper_tree.confusion, pair_error=error))
    assert inseparable(tree, 0) == [3]
    assert inseparable(tree, 3) == [0]
    assert inseparable(tree, 1) == []


@given(st.integers(0, 1000), st.sampled_from([("L1", "L1", "L1"), ("L1", "L6", "L7"), ("L2", "L1+L3", "L2")]))
@settings(max_examples=20, deadline=None)
def test_every_draw_ends_where_the_likelier_sides_lead(seed, rules):
    at, tree = random_told(seed), four_groups()
    nodes = nodes_of(tree, rules)
    leaf = walked(nodes, at, PRIOR, KEPT)
    if rules == ("L1", "L1", "L1"):  # one node: the likeliest group
        np.testing.assert_array_equal(leaf, (at.log_likelihood[0] + np.log(PRIOR)).argmax(axis=1))
        return
    if rules[2] == rules[0]:  # B0 and B2 are joined: 0 and 1, or 2, or 3
        first = side_said(at, rules[0], PRIOR, np.array([0, 0, 1, 2]))
        low = side_said(at, rules[1], PRIOR, np.array([0, 1, -1, -1]))
        np.testing.assert_array_equal(leaf, np.where(first == 0, low, first + 1))
        return
    first, low, high = (
        side_said(at, rule, PRIOR, np.array(side))
        for rule, side in zip(rules, ([0, 0, 1, 1], [0, 1, -1, -1], [-1, -1, 0, 1]), strict=True)
    )
    np.testing.assert_array_equal(leaf, np.where(first == 0, low, 2 + high))


def test_no_draw_ends_in_a_pruned_group():
    pruned = (False, True, False, False)
    nodes = nodes_of(four_groups(pruned), ("L1", "L1", "L6"))
    leaf = walked(nodes, random_told(0), PRIOR, ~np.array(pruned))
    assert set(leaf.tolist()) == {0, 2, 3}


def test_fresh_draws_of_the_papers_part_err_as_often_as_is_expected(paper_tree):
    """Within the sum of both 95 % intervals; what the expectation takes as independent errors need not be."""
    tree = paper_tree
    found = counted(tree, 16, seed=101)
    kept = ~tree.groups.pruned
    np.testing.assert_allclose(found.table[kept].sum(axis=1), 1.0)
    np.testing.assert_array_equal(found.table[:, ~kept], 0.0)
    prior = np.where(kept, tree.groups.view_count, 0) / tree.groups.view_count[kept].sum()
    per_group = int(tree.nodes.draws.max()) // (2 * kept.sum())  # of each kind
    measured_with = independent_draws(np.repeat(np.flatnonzero(kept), per_group), prior)
    for kind in range(2):
        low, high = wilson_interval(float(tree.confusion.expected_error[kind]) * measured_with, measured_with)
        assert found.interval[kind, 0] <= found.error[kind] <= found.interval[kind, 1]
        assert low <= found.interval[kind, 1]
        assert found.interval[kind, 0] <= high
