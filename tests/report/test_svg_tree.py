"""The tree's picture: every branch and leaf once, no crossing edges, the path of decision_path in bold."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from itree_jax.decision_path import determination_steps, path_to
from itree_jax.detections import Step
from itree_jax.report.svg_tree import BOX_W, layout, leaf_order, svg_tree
from itree_jax.report.tree_path import group_reached
from itree_jax.tree.branches import branches
from itree_jax.tree.tree import ROOT, InterpretationTree


def parsed(tree: InterpretationTree, group: int | None = None) -> ET.Element:
    return ET.fromstring(svg_tree(tree, group))


def with_class(root: ET.Element, *classes: str) -> list[ET.Element]:
    return [e for e in root.iter() if set(classes) <= set(e.get("class", "").split())]


def names(root: ET.Element, *classes: str) -> list[str]:
    return [e.findtext("text[@class='name']") or "" for e in with_class(root, *classes) if e.tag == "g"]


def relabelled(tree: InterpretationTree, labels: np.ndarray, areas: np.ndarray) -> InterpretationTree:
    """The tree of other groups; what was measured is left out."""
    count = len(labels)
    parts = branches(labels, areas, np.zeros(count, bool))
    n = parts.branch_count
    nodes = replace(
        tree.nodes, branch=parts.names, tested=parts.tested, parent=parts.parent,
        on_visible_side=parts.on_visible_side, visible=parts.visible, hidden=parts.hidden, rule=("L1",) * n,
        error=np.zeros(n, np.float32), error_interval=np.zeros((n, 2), np.float32), draws=np.zeros(n, np.int32),
        rule_errors=np.zeros((n, 3), np.float32),
    )  # fmt: skip
    groups = replace(
        tree.groups, group_labels=labels, pruned=np.zeros(count, bool), pruned_reason=("",) * count,
        group_of_view=np.arange(60) % count,
    )  # fmt: skip
    determination = replace(
        tree.determination, steps=((),) * count, rotations_left=np.zeros(count, np.int32),
        error=np.full((count, 4), np.nan, np.float32), draws=np.zeros(count, np.int32),
    )  # fmt: skip
    return replace(tree, nodes=nodes, groups=groups, determination=determination)


def random_tree(tree: InterpretationTree, seed: int, count: int) -> InterpretationTree:
    rng = np.random.default_rng(seed)
    labels = np.unique(rng.random((count, 8)) < 0.4, axis=0)[::-1]
    areas = np.sort(rng.choice([100.0, 99.0, 60.0, 30.0, 29.5], 8))[::-1]
    return relabelled(tree, labels, areas)


def test_every_branch_rule_and_group_is_drawn_once(tree):
    root = parsed(tree)
    steps = [rule for chain in tree.determination.steps for rule in chain]
    drawn = sorted(f"{b} · {r}" for b, r in zip(tree.nodes.branch, tree.nodes.rule, strict=True))
    assert sorted(names(root, "box")) == sorted([*drawn, *steps])
    labels = [e.text for e in with_class(root, "label")]
    assert sorted(labels) == sorted(tree.groups.label_strings)
    assert with_class(root, "on") == []


def test_the_bold_path_is_that_of_the_decision_path(tree):
    for group, label in enumerate(tree.groups.label_strings):
        root = parsed(tree, group)
        path = path_to(tree, group)
        drawn = [f"{tree.nodes.branch[k]} · {tree.nodes.rule[k]}" for k in path]
        assert names(root, "box", "on") == [*sorted(drawn), *tree.determination.steps[group]]
        assert len(with_class(root, "edge", "on")) == len(path) + len(tree.determination.steps[group])
        (leaf,) = with_class(root, "leaf", "on")
        assert leaf.findtext("text[@class='label']") == label


@pytest.mark.parametrize("seed", range(6))
def test_no_edges_cross(tree, seed):
    """The leaves of every branch lie side by side, its visible side above the hidden one, and a branch between."""
    drawn = random_tree(tree, seed, 5 + 6 * seed)
    at, order, nodes = layout(drawn), leaf_order(drawn), drawn.nodes
    assert sorted(order) == list(range(drawn.groups.group_count))
    rank = np.argsort(order)
    for k in range(len(nodes.branch)):
        above, below = np.sort(rank[nodes.visible[k]]), np.sort(rank[nodes.hidden[k]])
        np.testing.assert_array_equal(np.concatenate([above, below]), above[0] + np.arange(len(above) + len(below)))
        assert at.leaf_y[order[above[0]]] < at.node_y[k] < at.leaf_y[order[below[-1]]]
        if nodes.parent[k] != ROOT:
            assert at.node_x[k] > at.node_x[int(nodes.parent[k])] + BOX_W
        assert at.node_x[k] + BOX_W < at.end


@pytest.mark.parametrize("seed", [0, 5])
def test_everything_lies_inside_of_the_picture(tree, seed):
    root = parsed(random_tree(tree, seed, 30), 0)
    width, height = (float(v) for v in root.get("viewBox", "").split()[2:])
    for e in root.iter():
        if e.get("x") is not None:
            assert 0 <= float(e.get("x", "")) <= width
            assert 0 <= float(e.get("y", "")) <= height


def test_a_tree_of_one_group_is_one_leaf(tree):
    one = relabelled(tree, np.ones((1, 8), bool), np.linspace(90, 10, 8))
    root = parsed(one, 0)
    assert len(with_class(root, "leaf", "on")) == len(with_class(root, "edge", "on")) == 1
    assert with_class(root, "box") == []


def test_names_are_escaped(tree):
    name = "<i>&\"'</svg>"
    root = parsed(replace(tree, part=replace(tree.part, name=name)))
    assert name in (root.findtext("title") or "")


def test_the_group_reached_is_read_from_the_last_step(tree):
    for group in np.flatnonzero(~tree.groups.pruned).tolist():
        assert group_reached(tree, determination_steps(tree, group)) == group
    assert group_reached(tree, ()) is None


def test_the_group_reached_is_read_from_a_side_of_one_group(tree):
    kept = ~tree.groups.pruned
    for k in range(len(tree.nodes.branch)):
        for taken, members in (("visible", tree.nodes.visible[k] & kept), ("hidden", tree.nodes.hidden[k] & kept)):
            expected = int(np.flatnonzero(members)[0]) if members.sum() == 1 else None
            assert group_reached(tree, [Step(k, "L1", 0.0, {"taken": taken}, 1.0)]) == expected
    assert group_reached(tree, [Step(0, "L1", 0.0, None, 1.0)]) is None
