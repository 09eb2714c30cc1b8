"""Joining consecutive branches of one rule to one many-way node (Ikeuchi 1987, sec. 2.1.5, figure 4).

"Since B0 and B1 branches have the same rule and they are consecutive, they are joined into a three-branch node." One
measurement then decides between all sides at once. By Bayes the probability of a side is the product of what the
branches on its way give it, so that a side with more than half of it is decided as one after the other would; the error
is measured once.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from itree_jax.tree.branches import ROOT, Branches
from itree_jax.tree.classification_rules import rules_in
from itree_jax.tree.error_rates import Measured, view_weights
from itree_jax.tree.tree import PRUNED, Nodes


def joined_nodes(
    branches: Branches, rules: tuple[str, ...], test: Measured, prior: Float[np.ndarray, "groups"],
    kept: Bool[np.ndarray, "groups"],
) -> tuple[Int[np.ndarray, "nodes"], Float[np.ndarray, "nodes 2"]]:
    """For every branch the top branch of its many-way node (itself where it is not joined), and at the tops the error
    of the many-way decision on whole and on cut regions."""
    top = tops(branches.parent, rules)
    error = np.zeros((len(rules), 2), np.float32)
    for t in np.unique(top):
        if rules[t] == PRUNED:
            continue
        side = sides_of(branches.visible & kept, branches.hidden & kept, top, int(t))
        at = test.take(np.flatnonzero(side[test.group] >= 0))
        wrong = side_said(at, rules[t], prior, side) != side[at.group]
        for kind, cut in enumerate((False, True)):
            own = at.cut == cut
            error[t, kind] = wrong[own] @ view_weights(at.group[own], prior) if own.any() else np.nan
        error[t] = np.where(np.isnan(error[t]), np.nanmax(np.append(error[t], 0.0)), error[t])
    return top, error


def side_said(
    at: Measured, rule: str, prior: Float[np.ndarray, "groups"], side: Int[np.ndarray, "groups"]
) -> Int[np.ndarray, "draws"]:
    """The side of a many-way node that every draw is put on."""
    with np.errstate(divide="ignore"):
        weighted = at.log_likelihood[list(rules_in(rule))].sum(axis=0) + np.log(prior)
    likelihood = [np.logaddexp.reduce(weighted[:, side == s], axis=1) for s in range(side.max() + 1)]
    return np.stack(likelihood, axis=1).argmax(axis=1)


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
    visible: Bool[np.ndarray, "nodes groups"], hidden: Bool[np.ndarray, "nodes groups"], top: Int[np.ndarray, "nodes"],
    node: int,
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
    return sides_of(nodes.visible & kept, nodes.hidden & kept, nodes.joined, node)


def many_way_nodes(nodes: Nodes) -> list[int]:
    """The tops of the nodes that decide something, parents first."""
    return [int(k) for k in np.unique(nodes.joined) if nodes.rule[k] != PRUNED]
