"""The path of an answer: from the root to its group without a gap, with margins toward the sides it took."""

from itertools import pairwise

import numpy as np
import pytest

from itree_jax.decision_path import decision_path, path_to
from itree_jax.tree.classification_rules import CLASSIFICATION_RULES
from itree_jax.tree.classify import Classification
from itree_jax.tree.tree import PRUNED, ROOT


def said_of(tree, regions: int, seed: int) -> Classification:
    """What a classification could have said of some regions."""
    rng = np.random.default_rng(seed)
    quantities = tuple(rng.normal(size=(regions, len(rule.quantity_names))) for rule in CLASSIFICATION_RULES)
    groups, nodes = len(tree.groups.label_strings), len(tree.nodes.branch)
    return Classification(np.zeros((regions, groups)), rng.normal(size=(regions, nodes)) * 5.0, quantities)


def row_of(tree, group: int) -> int | None:
    """An appearance of the group."""
    of_row = tree.groups.group_of_view[tree.appearances.view[tree.appearances.attitude]]
    rows = np.flatnonzero(of_row == group)
    return int(rows[0]) if len(rows) else None


def kept_groups(tree) -> list[int]:
    return [g for g in np.flatnonzero(~tree.groups.pruned).tolist() if row_of(tree, g) is not None]


def test_nodes_lead_from_the_root_to_the_group(paper_tree):
    nodes = paper_tree.nodes
    paths = {g: path_to(paper_tree, g) for g in kept_groups(paper_tree)}
    assert len(paths) >= 5
    for group, path in paths.items():
        assert nodes.parent[path[0]] == ROOT
        for above, below in pairwise(path):
            assert nodes.parent[below] == above
            side = nodes.visible if nodes.on_visible_side[below] else nodes.hidden
            assert side[above, group]
        # nothing divides the group's side any further
        last = path[-1]
        side = nodes.visible[last] if nodes.visible[last, group] else nodes.hidden[last]
        assert side[group]
        assert not any(nodes.parent[k] == last and (nodes.visible[k] | nodes.hidden[k])[group]
                       for k in range(len(nodes.branch)))  # fmt: skip
    assert len(set(map(tuple, paths.values()))) > 1


@pytest.mark.parametrize("region", [0, 2])
def test_every_step_says_what_was_measured_and_by_how_much_it_decided(paper_tree, region):
    """A margin is positive where the side taken was the likelier one."""
    nodes, labels = paper_tree.nodes, paper_tree.groups.label_strings
    said = said_of(paper_tree, 3, seed=0)
    rule_of = {rule.name: k for k, rule in enumerate(CLASSIFICATION_RULES)}
    signs = set()
    for group in kept_groups(paper_tree):
        path = decision_path(paper_tree, said, region, row_of(paper_tree, group))
        steps = [step for step in path if step.rule in rule_of]
        assert list(path[: len(steps)]) == steps  # determination comes after classification
        assert [s.node for s in steps] == [k for k in path_to(paper_tree, group) if nodes.rule[k] != PRUNED]
        for step in steps:
            k = rule_of[step.rule]
            assert step.rule == nodes.rule[step.node]
            names = CLASSIFICATION_RULES[k].quantity_names
            np.testing.assert_allclose([step.measured[n] for n in names], said.quantities[k][region], atol=1e-4)
            taken = step.compared_with["taken"]
            assert labels[group] in step.compared_with[taken]["groups"]
            other = {"visible": "hidden", "hidden": "visible"}[taken]
            assert labels[group] not in step.compared_with[other]["groups"]
            toward_visible = said.node_margin[region, step.node]
            assert step.margin == pytest.approx(toward_visible if taken == "visible" else -toward_visible, abs=1e-3)
            signs.add((taken, step.margin > 0))
    assert len(signs) > 2  # either side, and with either sign, occurred


def test_freedom_falls_along_the_path(paper_tree):
    """Each step starts with what the one before has left."""
    said = said_of(paper_tree, 1, seed=1)
    for group in kept_groups(paper_tree):
        path = decision_path(paper_tree, said, 0, row_of(paper_tree, group))
        steps = [step for step in path if step.freedom_before.split()[0].isdigit()]
        left = [int(step.freedom_before.split()[0]) for step in steps]
        after = [int(step.freedom_after.split()[0]) for step in steps]
        assert all(a < b for a, b in zip(after, left, strict=True))
        assert after[:-1] == left[1:]
        assert left[0] == (~paper_tree.groups.pruned).sum()
