"""The tree's picture: every node and leaf once, no crossing edges, the path of decision_path in bold."""

import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from itree_jax.decision_path import determination_steps
from itree_jax.detections import Step
from itree_jax.report.svg_file import write_svg_tree
from itree_jax.report.svg_tree import Figure, svg_tree
from itree_jax.report.tree_layout import faces_asked, layout
from itree_jax.report.tree_path import group_reached
from itree_jax.tree.drawing import Drawing, branch_drawing, interpretation_drawing, leaf_names, node_name
from itree_jax.tree.tree import PRUNED, InterpretationTree

from ..tree.drawn_trees import random_tree, relabelled, with_rules, with_steps

FIGURES: dict[Figure, Callable[[InterpretationTree], Drawing]] = {
    "interpretation": interpretation_drawing,
    "branches": branch_drawing,
}
SVG = "{http://www.w3.org/2000/svg}"


def parsed(tree: InterpretationTree, group: int | None = None, figure: Figure = "interpretation") -> ET.Element:
    return ET.fromstring(svg_tree(tree, group, figure))


def with_class(root: ET.Element, *classes: str) -> list[ET.Element]:
    return [e for e in root.iter() if set(classes) <= set(e.get("class", "").split())]


def names(root: ET.Element, *classes: str) -> list[str]:
    return [e.findtext("text[@class='name']") or "" for e in with_class(root, *classes) if e.tag == "g"]


def steps_shown(root: ET.Element, *classes: str) -> list[str]:
    return [name.split(" ·")[0] for name in names(root, "box", "step", *classes)]


def nodes_shown(root: ET.Element, *classes: str) -> list[str]:
    chains = names(root, "box", "step", *classes)
    return [name for name in names(root, "box", *classes) if name not in chains]


def test_figure_3_has_every_branch_with_its_rule_and_every_group(tree):
    root = parsed(tree, figure="branches")
    drawn = [f"{b} · {r}" for b, r in zip(tree.nodes.branch, tree.nodes.rule, strict=True)]
    assert nodes_shown(root) == drawn
    assert sorted(e.text or "" for e in with_class(root, "label")) == sorted(tree.groups.label_strings)
    assert steps_shown(root) == []
    assert len(with_class(root, "box", "pruned")) == tree.nodes.rule.count(PRUNED)
    assert with_class(root, "on") == []


def test_figure_4_has_joined_nodes_and_the_leaves_with_their_chains(tree):
    tree = with_steps(with_rules(tree, ("L1", "L1", PRUNED, PRUNED, "L6", "L7")), 0, ("A1", "A4", "A5"), 1)
    root = parsed(tree)
    assert nodes_shown(root) == ["B0+B1 · L1", "B4 · L6", "B5 · L7"]
    assert with_class(root, "pruned") == []
    leaves = leaf_names(tree)
    assert [e.text for e in with_class(root, "attitude")] == list(leaves.values())
    assert [e.text for e in with_class(root, "label")] == [tree.groups.label_strings[g] for g in leaves]
    assert steps_shown(root) == [rule for g in leaves for rule in tree.determination.steps[g]]
    assert "rotation 360 → 2" in "".join(root.itertext())


@pytest.mark.parametrize("figure", FIGURES)
def test_the_bold_path_leads_to_its_leaf_through_the_nodes_that_the_group_reaches(tree, figure):
    drawing = FIGURES[figure](tree)
    for group in np.flatnonzero(~tree.groups.pruned).tolist():
        root = parsed(tree, group, figure)
        path = [node for node in drawing.nodes if group in node.groups]
        drawn = [f"{node_name(tree, node)} · {tree.nodes.rule[node.branches[0]]}" for node in path]
        assert nodes_shown(root, "on") == drawn
        chain = tree.determination.steps[group] if figure == "interpretation" else ()
        assert steps_shown(root, "on") == list(chain)
        assert len(with_class(root, "edge", "on")) == len(path) + len(chain)
        (leaf,) = with_class(root, "leaf", "on")
        assert leaf.findtext("text[@class='label']") == tree.groups.label_strings[group]


def test_a_pruned_group_has_no_path_in_figure_4(tree):
    pruned = int(np.flatnonzero(tree.groups.pruned)[0])
    assert with_class(parsed(tree, pruned), "on") == []
    assert len(with_class(parsed(tree, pruned, "branches"), "leaf", "on")) == 1


@pytest.mark.parametrize("figure", FIGURES)
@pytest.mark.parametrize("seed", range(6))
def test_no_edges_cross_and_no_boxes_overlap(tree, seed, figure):
    """Leaves of every side lie side by side, sides from top to bottom, nodes between their sides and right of the
    node above."""
    drawn = random_tree(tree, seed, 1 + 5 * seed)
    drawing = FIGURES[figure](drawn)
    at = layout(drawn, drawing)
    assert np.all(np.diff([at.leaf_y[g] for g in drawing.leaves]) > 0)
    rank = {g: k for k, g in enumerate(drawing.leaves)}
    for k, node in enumerate(drawing.nodes):
        ranks = [rank[g] for side in node.sides for g in sorted(side.groups, key=rank.__getitem__)]
        assert ranks == list(range(ranks[0], ranks[0] + len(ranks)))
        ys = [at.side_y(side) for side in node.sides]
        assert sorted(ys) == ys
        assert ys[0] < at.node_y[k] < ys[-1]
        if node.above is not None:
            assert at.node_x[k] > at.node_x[node.above] + at.node_w[node.above]
        assert at.node_x[k] + at.node_w[k] < at.end


@pytest.mark.parametrize("figure", FIGURES)
@pytest.mark.parametrize("seed", [0, 5])
def test_everything_lies_inside_of_the_picture(tree, seed, figure):
    root = parsed(random_tree(tree, seed, 30), 0, figure)
    width, height = (float(v) for v in root.get("viewBox", "").split()[2:])
    for e in root.iter():
        if e.get("x") is not None:
            assert 0 <= float(e.get("x", "")) <= width
            assert 0 <= float(e.get("y", "")) <= height


@pytest.mark.parametrize("figure", FIGURES)
def test_a_tree_of_one_group_is_one_leaf(tree, figure):
    one = relabelled(tree, np.ones((1, 8), bool), np.linspace(90, 10, 8), np.zeros(1, bool))
    root = parsed(one, 0, figure)
    assert len(with_class(root, "leaf", "on")) == 1
    assert nodes_shown(root) == []


def test_faces_that_follow_each_other_are_one_range(tree):
    tested = np.array([[1, 1, 0, 0, 0, 0, 0, 0], [1, 1, 1, 0, 1, 1, 1, 1], [0, 1, 0, 1, 0, 0, 0, 0]], bool)
    odd = replace(tree, nodes=replace(tree.nodes, tested=tested))
    assert [faces_asked(odd, k) for k in range(3)] == ["1,2", "1\N{EN DASH}3,5\N{EN DASH}8", "2,4"]


def test_names_are_escaped(tree):
    name = "<i>&\"'</svg>"
    root = parsed(replace(tree, part=replace(tree.part, name=name)))
    assert name in (root.findtext("title") or "")


@pytest.mark.parametrize("figure", FIGURES)
def test_a_file_of_its_own_carries_its_style_and_fetches_nothing(tmp_path, tree, figure):
    for name in ("a.svg", "b.svg"):
        write_svg_tree(tmp_path / name, tree, figure)
    text = (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert text == (tmp_path / "b.svg").read_text(encoding="utf-8")
    root = ET.fromstring(text)
    assert root.tag == f"{SVG}svg"
    assert len(root.findall(f"{SVG}style")) == 1
    assert [word for word in ("var(", "url(", "@import", "href", "<script") if word in text] == []
    boxes = [e for e in root.iter(f"{SVG}g") if e.get("class", "").startswith("box")]
    assert len(boxes) == len(with_class(parsed(tree, figure=figure), "box"))


def test_the_group_reached_is_read_from_the_last_step(tree):
    for group in np.flatnonzero(~tree.groups.pruned).tolist():
        chained = with_steps(tree, group, ("A1",), 1)
        assert group_reached(chained, determination_steps(chained, group)) == group
    assert group_reached(tree, ()) is None


def test_the_group_reached_is_read_from_a_side_of_one_group(tree):
    kept = ~tree.groups.pruned
    for k in range(len(tree.nodes.branch)):
        for taken, members in (("visible", tree.nodes.visible[k] & kept), ("hidden", tree.nodes.hidden[k] & kept)):
            expected = int(np.flatnonzero(members)[0]) if members.sum() == 1 else None
            assert group_reached(tree, [Step(k, "L1", 0.0, {"taken": taken}, 1.0)]) == expected
    assert group_reached(tree, [Step(0, "L1", 0.0, None, 1.0)]) is None
