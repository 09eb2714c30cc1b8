"""Joining consecutive branches of one rule to one many-way node (Ikeuchi 1987, sec. 2.1.5, figure 4).

"Since B0 and B1 branches have the same rule and they are consecutive, they are joined into a three-branch node." One
measurement then decides between all sides at once; by Bayes that is the same decision as one after the other, but its
error is measured once.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from itree_jax.tree.branches import ROOT, Branches
from itree_jax.tree.classification_rules import rules_in
from itree_jax.tree.error_rates import Measured, at_stake, view_weights
from itree_jax.tree.tree import PRUNED, Nodes


def joined_nodes(
    branches: Branches, rules: tuple[str, ...], test: Measured, prior: Float[np.ndarray, "groups"],
    kept: Bool[np.ndarray, "groups"], policy: str,
) -> tuple[Int[np.ndarray, "nodes"], Float[np.ndarray, "nodes"]]:
    """For every branch the top branch of its many-way node (itself where it is not joined), and at the tops the error
    of the many-way decision."""
    top = tops(branches.parent, rules)
    error = np.zeros(len(rules), np.float32)
    for t in np.unique(top):
        if rules[t] == PRUNED:
            continue
        side = sides_of(branches.visible & kept, branches.hidden & kept, branches.parent, branches.on_visible_side,
                        top, int(t))  # fmt: skip
        here = (side[test.group] >= 0) & at_stake(test, policy)
        if not here.any():
            continue
        with np.errstate(divide="ignore"):
            weighted = test.log_likelihood[list(rules_in(rules[t]))].sum(axis=0)[here] + np.log(prior)
        said = np.stack([np.logaddexp.reduce(weighted[:, side == s], axis=1) for s in range(side.max() + 1)], axis=1)
        wrong = said.argmax(axis=1) != side[test.group[here]]
        kinds = [wrong_kind @ view_weights(group, prior) for wrong_kind, group in _by_kind(wrong, test, here)]
        error[t] = float(np.mean(kinds))
    return top, error


def _by_kind(wrong: np.ndarray, test: Measured, here: np.ndarray):
    """Wrong answers and groups of whole draws, then of cut ones, where there are any."""
    cut, group = test.cut[here], test.group[here]
    return [(wrong[kind], group[kind]) for kind in (~cut, cut) if kind.any()]


def tops(parent: Int[np.ndarray, "nodes"], rules: tuple[str, ...]) -> Int[np.ndarray, "nodes"]:
    """The top branch of every branch's many-way node; branches without a decision between two of one rule are
    passed over, and belong to none."""
    top = np.arange(len(parent), dtype=np.int32)
    for k, above in enumerate(parent):
        while above != ROOT and rules[above] == PRUNED:
            above = parent[above]
        if above != ROOT and rules[k] == rules[above] and rules[k] != PRUNED:
            top[k] = top[above]
    return top


def sides_of(
    visible: Bool[np.ndarray, "nodes groups"], hidden: Bool[np.ndarray, "nodes groups"], parent: Int[np.ndarray, "n"],
    on_visible_side: Bool[np.ndarray, "nodes"], top: Int[np.ndarray, "nodes"], node: int,
) -> Int[np.ndarray, "groups"]:
    """Which side of a many-way node every group is on, -1 for groups that don't reach it.

    Sides come in the order of the tree's picture: visible before hidden.
    """
    side = np.full(visible.shape[1], -1)
    members = [k for k in range(len(top)) if top[k] == node]
    reach = visible[node] | hidden[node]
    # how each group answers the node's branches, as digits: 0 visible, 1 hidden, 2 not asked
    answers = np.stack([np.where(visible[k], 0, np.where(hidden[k], 1, 2)) for k in members], axis=1)
    for number, key in enumerate(sorted({tuple(a) for a in answers[reach]})):
        side[reach & (answers == key).all(axis=1)] = number
    return side


def many_way_sides(nodes: Nodes, kept: Bool[np.ndarray, "groups"], node: int) -> Int[np.ndarray, "groups"]:
    """`sides_of` of a finished tree."""
    return sides_of(
        nodes.visible & kept, nodes.hidden & kept, nodes.parent, nodes.on_visible_side, nodes.joined, node
    )
