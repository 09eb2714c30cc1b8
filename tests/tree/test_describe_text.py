"""The text of `itree show`: every group, branch and rule, and the tree as figure 4 draws it."""

import io
from dataclasses import fields, replace

import numpy as np
from rich.console import Console, RenderableType

from itree_jax.tree.chain import determination_chain, left_open
from itree_jax.tree.describe_text import as_text, drawn_tree
from itree_jax.tree.drawing import interpretation_drawing, leaf_names, node_name
from itree_jax.tree.tree import PRUNED, InterpretationTree

from .drawn_trees import random_tree, with_rules, with_steps


def printed(what: RenderableType) -> str:
    out = io.StringIO()
    Console(width=240, file=out).print(what)
    return out.getvalue()


def drawn(tree: InterpretationTree) -> list[str]:
    """The lines of the tree, without what joins them."""
    return [line.lstrip("│├└─ ").rstrip() for line in printed(drawn_tree(tree)).splitlines()[1:]]


def test_every_node_and_leaf_is_one_line_of_the_tree(paper_tree):
    for seed in range(4):
        tree = random_tree(paper_tree, seed, 2 + 6 * seed)
        lines = drawn(tree)
        drawing, names = interpretation_drawing(tree), leaf_names(tree)
        assert len(lines) == len(drawing.nodes) + len(drawing.leaves)
        for node in drawing.nodes:
            rule = tree.nodes.rule[node.branches[0]]
            assert sum(f"{node_name(tree, node)}: {rule}, errs in " in line for line in lines) == 1
        for g in drawing.leaves:
            (line,) = [line for line in lines if f"{names[g]} {tree.groups.label_strings[g]}: " in line]
            assert all(f"{rule} ({taken})" in line for rule, taken in determination_chain(tree, g))
            assert line.endswith(left_open(tree, g))


def test_the_papers_tree_reads_like_its_figure_4(paper_tree):
    tree = with_rules(paper_tree, ("L1", "L1", PRUNED, PRUNED, "L6", "L7"))
    tree = with_steps(tree, 0, ("A1", "A4", "A5"), 1)
    lines = drawn(tree)
    assert lines[0].startswith("B0+B1: L1, errs in ")
    chain = "A1 (direction 2 → 0), A4 (rotation 360 → 2), A5 (rotation 2 → 1), unique"
    assert lines[1] == f"any of f1 f2, any of f3 → S1 11100000: {chain}"
    assert lines[2].startswith("any of f1 f2, none of f3 → B4: L6, errs in ")
    assert lines[-1].startswith("none of f1 f2 → S5 00001100: ")


def test_the_tables_have_every_group_branch_and_rule(paper_tree):
    text = printed(as_text(paper_tree))
    assert all(label in text for label in paper_tree.groups.label_strings)
    assert all(f"│ {branch}" in text for branch in paper_tree.nodes.branch)
    assert all(rule in text for rule in (*paper_tree.distributions.rules, *paper_tree.determination.rules))
    assert "Expected of the whole tree" in text


def test_a_tree_with_nothing_to_divide_has_no_rules(paper_tree):
    nodes = paper_tree.nodes
    none = {f.name: getattr(nodes, f.name)[:0] for f in fields(nodes)}
    pruned = np.arange(paper_tree.groups.group_count) > 0
    tree = replace(paper_tree, nodes=replace(nodes, **none), groups=replace(paper_tree.groups, pruned=pruned))
    assert "Rules, with errors" not in printed(as_text(tree))
    assert len(drawn(tree)) == 1
