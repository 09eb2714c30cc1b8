"""The numbers of a node: its rule's own, of both rules of a pair, of a relation one per group that is told apart."""

from dataclasses import replace

import numpy as np
import pytest

from itree_jax.tree.classification_rules import CLASSIFICATION_RULES, RULE_NAMES
from itree_jax.tree.node_quantities import NodeQuantity, node_quantities, side_samples
from itree_jax.tree.tree import PRUNED


def with_rule(tree, node: int, rule: str):
    rules = tuple(rule if k == node else r for k, r in enumerate(tree.nodes.rule))
    return replace(tree, nodes=replace(tree.nodes, rule=rules))


@pytest.mark.parametrize("rule", RULE_NAMES[:5])
def test_a_distribution_has_the_rules_own_numbers(paper_tree, rule):
    k = RULE_NAMES.index(rule)
    names = CLASSIFICATION_RULES[k].quantity_names
    found = node_quantities(with_rule(paper_tree, 0, rule), 0)
    assert found == [NodeQuantity(name, k, column) for column, name in enumerate(names)]


@pytest.mark.parametrize("node", [0, 4, 5])
def test_a_relation_has_one_agreement_per_kept_group_of_the_node(paper_tree, node):
    groups, nodes = paper_tree.groups, paper_tree.nodes
    found = node_quantities(with_rule(paper_tree, node, "L6"), node)
    here = np.flatnonzero((nodes.visible[node] | nodes.hidden[node]) & ~groups.pruned)
    assert found == [NodeQuantity(f"agreement with {groups.label_strings[g]}", 5, g) for g in here]


def test_the_numbers_of_a_pair_say_whose_they_are(paper_tree):
    found = node_quantities(with_rule(paper_tree, 5, "L1+L7"), 5)
    assert [q.rule for q in found] == [0, 0, 6, 6]
    assert all(q.name.startswith(("L1 ", "L7 ")[q.rule // 6]) for q in found)
    assert len({q.name for q in found}) == 4


def test_a_pruned_node_compares_nothing(paper_tree):
    pruned = paper_tree.nodes.rule.index(PRUNED)
    assert node_quantities(paper_tree, pruned) == []
    assert side_samples(paper_tree, pruned, paper_tree.nodes.visible[pruned]).shape == (0, 0)


@pytest.mark.parametrize("rule", ["L2", "L7", "L3+L6"])
def test_samples_are_those_of_the_sides_draws(paper_tree, rule):
    tree, node = with_rule(paper_tree, 0, rule), 0
    nodes, kept = tree.nodes, ~tree.groups.pruned
    asked = node_quantities(tree, node)
    for members in (nodes.visible[node], nodes.hidden[node]):
        rows = side_samples(tree, node, members)
        first = tree.distributions.samples[asked[0].rule][members & kept]
        assert rows.shape == (int((~np.isnan(first[..., 0])).sum()), len(asked))
        assert np.isfinite(rows).all()
        for column, q in enumerate(asked):
            values = tree.distributions.samples[q.rule][members & kept][..., q.column]
            np.testing.assert_array_equal(np.sort(rows[:, column]), np.sort(values[~np.isnan(values)]))
