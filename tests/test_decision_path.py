"""The path of an answer: from the root to its group without a gap, with margins toward the sides it took."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from itree_jax.decision_path import decision_path, determination_steps, path_to, verification_step
from itree_jax.detections import Alternative
from itree_jax.tree.classification_rules import CLASSIFICATION_RULES
from itree_jax.tree.classify import Classification
from itree_jax.tree.freedom import freedom_along
from itree_jax.tree.joining import tops
from itree_jax.tree.node_quantities import node_quantities, side_samples
from itree_jax.tree.tree import PRUNED, ROOT


def said_of(tree, regions: int, seed: int) -> Classification:
    """What a classification could have said of some regions."""
    rng = np.random.default_rng(seed)
    count = tree.groups.group_count
    quantities = tuple(rng.normal(size=(regions, len(rule.quantity_names) or count)) for rule in CLASSIFICATION_RULES)
    groups, nodes = len(tree.groups.label_strings), len(tree.nodes.branch)
    return Classification(np.zeros((regions, groups)), rng.normal(size=(regions, nodes)) * 5.0, quantities)


def row_of(tree, group: int) -> int | None:
    """An appearance of the group."""
    of_row = tree.appearances.group[tree.appearances.attitude]
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


def with_rules(tree, rule: tuple[str, ...]):
    """The same tree, its branches (B2 and B3 are pruned) decided by other rules."""
    nodes = tree.nodes
    assert [k for k, r in enumerate(nodes.rule) if r == PRUNED] == [k for k, r in enumerate(rule) if r == PRUNED]
    return replace(tree, nodes=replace(nodes, rule=rule, joined=tops(nodes.parent, rule)))


THE_PAPERS = ("L1", "L1", PRUNED, PRUNED, "L6", "L7")
WITH_PAIRS = ("L1+L6", "L2", PRUNED, PRUNED, "L4+L7", "L5")


@pytest.mark.parametrize("rules", [THE_PAPERS, WITH_PAIRS])
def test_every_step_says_what_was_measured_and_by_how_much_it_decided(paper_tree, rules):
    """A margin is positive where the side taken was the likelier one."""
    tree = with_rules(paper_tree, rules)
    nodes, labels = tree.nodes, tree.groups.label_strings
    said = said_of(tree, 3, seed=0)
    signs = set()
    for group, region in ((g, r) for g in kept_groups(tree) for r in (0, 2)):
        path = decision_path(tree, said, region, row_of(tree, group))
        steps = [step for step in path if step.rule[0] == "L"]
        assert list(path[: len(steps)]) == steps  # determination comes after classification
        assert [s.node for s in steps] == [k for k in path_to(tree, group) if nodes.rule[k] != PRUNED]
        for step in steps:
            assert step.rule == nodes.rule[step.node]
            asked = node_quantities(tree, step.node)
            assert list(step.measured) == [q.name for q in asked]
            expected = [said.quantities[q.rule][region, q.column] for q in asked]
            np.testing.assert_allclose(list(step.measured.values()), expected, atol=1e-4)
            taken = step.compared_with["taken"]
            assert labels[group] in step.compared_with[taken]["groups"]
            other = {"visible": "hidden", "hidden": "visible"}[taken]
            assert labels[group] not in step.compared_with[other]["groups"]
            for side, members in (("visible", nodes.visible), ("hidden", nodes.hidden)):
                means = side_samples(tree, step.node, members[step.node]).mean(axis=0)
                told = [step.compared_with[side][q.name] for q in asked]
                np.testing.assert_allclose(told, means, atol=1e-4)
            toward_visible = said.node_margin[region, step.node]
            assert step.margin == pytest.approx(toward_visible if taken == "visible" else -toward_visible, abs=1e-3)
            signs.add((taken, step.margin > 0))
            errors = [step.compared_with[f"error_{kind}"] for kind in ("whole", "cut")]
            np.testing.assert_allclose(errors, nodes.whole_and_cut[step.node], atol=1e-4)
    assert len(signs) > 2  # either side, and with either sign, occurred


def test_a_branch_that_is_joined_says_with_which(paper_tree):
    tree = with_rules(paper_tree, THE_PAPERS)
    said = said_of(tree, 1, seed=3)
    joined = {
        step.node: step.compared_with.get("joined_with")
        for group in kept_groups(tree) for step in decision_path(tree, said, 0, row_of(tree, group))
        if step.rule[0] == "L"
    }  # fmt: skip
    assert joined == {0: None, 1: "B0", 4: None, 5: None}


def test_determination_says_what_freedom_each_step_takes_and_what_is_left_to_refinement(paper_tree):
    groups, count = paper_tree.groups, paper_tree.groups.group_count
    chains = [(), ("A1", "A4", "A5"), ("A1", "A3", "A7"), ("A1", "A4"), ("A1",), ("A2",), ()]
    left = np.array([0, 1, 1, 2, 0, 1, 0], np.int32)
    assert count == len(chains)
    separable = np.zeros((count, count), np.float32)
    separable[1, 2] = separable[2, 1] = 0.4
    tree = replace(
        paper_tree, determination=replace(paper_tree.determination, steps=tuple(chains), rotations_left=left),
        confusion=replace(paper_tree.confusion, pair_error=separable),
    )  # fmt: skip
    for g in range(count):
        steps = determination_steps(tree, g)
        asks = left[g] != 1 or g in (1, 2)
        assert tuple(s.rule for s in steps) == (*chains[g], *(("refinement",) if asks else ()))
        freedom = [str(f) for f in freedom_along(chains[g])]
        assert [s.freedom_before for s in steps] == (freedom if asks else freedom[:-1])
        assert [s.freedom_after for s in steps] == [*freedom[1:], *(["unique"] if asks else [])]
        for step in steps[: len(chains[g])]:
            error = tree.determination.error[g, tree.determination.rules.index(step.rule)]
            np.testing.assert_allclose(step.compared_with["error_rate"], error, atol=1e-4)
        if asks:
            others = {1: [groups.label_strings[2]], 2: [groups.label_strings[1]]}.get(g)
            assert steps[-1].compared_with.get("alternatives") == others


def test_freedom_falls_along_the_path(paper_tree):
    """Each step starts with what the one before has left."""
    said = said_of(paper_tree, 1, seed=1)
    for group in kept_groups(paper_tree):
        path = decision_path(paper_tree, said, 0, row_of(paper_tree, group))
        steps = [step for step in path if step.rule[0] == "L"]
        left = [int(step.freedom_before.split()[0]) for step in steps]
        after = [int(step.freedom_after.split()[0]) for step in steps]
        assert all(a < b for a, b in zip(after, left, strict=True))
        assert after[:-1] == left[1:]
        assert left[0] == (~paper_tree.groups.pruned).sum()


@pytest.mark.parametrize(
    ("shares", "before", "after"),
    [
        ((), "unique", "unique"),
        ((0.01,), "2 poses of this place", "unique"),
        ((0.4, 0.01), "3 poses of this place", "ambiguous: 2 poses that the scene does not tell apart"),
    ],
)
def test_the_last_step_says_what_the_scene_does_not_tell_apart(paper_tree, shares, before, after):
    alternatives = tuple(Alternative(np.eye(4), s) for s in shares)
    margins = [10.0 * (k + 1) for k in range(len(shares))]
    rivals = [900.0 - 40.0 * (k + 1) for k in range(len(shares))]  # most of what they lack, they lack by chance
    step = verification_step(paper_tree, 900.0, rivals, margins, alternatives)
    assert (step.freedom_before, step.freedom_after) == (before, after)
    assert step.compared_with["shares"] == list(shares)
    assert step.margin == (10.0 if shares else None)
