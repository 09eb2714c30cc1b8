"""Trees to be drawn: other groups and other rules in the place of those of a compiled tree."""

from dataclasses import replace

import numpy as np

from itree_jax.tree.branches import branches
from itree_jax.tree.joining import tops
from itree_jax.tree.tree import PRUNED, InterpretationTree

RULES = ("L1", "L3", "L1+L6")  # few, so that branches that follow each other often have the same


def with_rules(tree: InterpretationTree, rules: tuple[str, ...]) -> InterpretationTree:
    """Other rules at the branches, joined as these say."""
    return replace(tree, nodes=replace(tree.nodes, rule=rules, joined=tops(tree.nodes.parent, rules)))


def with_steps(tree: InterpretationTree, group: int, steps: tuple[str, ...], left: int) -> InterpretationTree:
    """Other determination steps of one group."""
    chains, rotations = list(tree.determination.steps), tree.determination.rotations_left.copy()
    chains[group], rotations[group] = steps, left
    return replace(tree, determination=replace(tree.determination, steps=tuple(chains), rotations_left=rotations))


def relabelled(
    tree: InterpretationTree, labels: np.ndarray, areas: np.ndarray, pruned: np.ndarray, seed: int = 0
) -> InterpretationTree:
    """The tree of other groups with rules by chance; what was measured is left out."""
    rng, count = np.random.default_rng(seed), len(labels)
    parts = branches(labels, areas, pruned)
    n = parts.branch_count
    rules = tuple(PRUNED if p else str(rng.choice(RULES)) for p in parts.pruned)
    nodes = replace(
        tree.nodes, branch=parts.names, tested=parts.tested, parent=parts.parent,
        on_visible_side=parts.on_visible_side, visible=parts.visible, hidden=parts.hidden, rule=rules,
        error=np.zeros(n, np.float32), error_interval=np.zeros((n, 2), np.float32), draws=np.zeros(n, np.int32),
        rule_errors=np.zeros((n, 7, 2), np.float32), whole_and_cut=np.zeros((n, 2), np.float32),
        joined=tops(parts.parent, rules), joined_error=np.zeros((n, 2), np.float32),
    )  # fmt: skip
    groups = replace(
        tree.groups, group_labels=labels, pruned=pruned, pruned_reason=tuple("steep" if p else "" for p in pruned),
        group_of_view=np.arange(60) % count,
    )  # fmt: skip
    determination = replace(
        tree.determination, steps=(("A1", "A4", "A7"),) * count, rotations_left=np.ones(count, np.int32),
        error=np.zeros((count, 8), np.float32), error_interval=np.zeros((count, 8, 2), np.float32),
        draws=np.zeros(count, np.int32),
    )  # fmt: skip
    return replace(tree, nodes=nodes, groups=groups, determination=determination)


def random_tree(tree: InterpretationTree, seed: int, count: int) -> InterpretationTree:
    """Up to `count` groups, one in five pruned but the first."""
    rng = np.random.default_rng(seed)
    labels = np.unique(rng.random((count, 8)) < 0.4, axis=0)[::-1]
    areas = np.sort(rng.choice([100.0, 99.0, 60.0, 30.0, 29.5], 8))[::-1]
    pruned = rng.random(len(labels)) < 0.2
    pruned[0] = False
    return relabelled(tree, labels, areas, pruned, seed)
