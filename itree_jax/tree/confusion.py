"""The expected error of the whole tree, the groups that no rule tells apart, and the count that checks both.

A region reaches its leaf if every node on the way takes the right side. The expected error multiplies the nodes' rates
for the regions of each group, as if they erred independently; `counted` walks fresh draws down the tree.
"""

from typing import NamedTuple

import numpy as np
from itree_cad.decimate import lean
from itree_kernels.mesh import ray_mesh
from jaxtyping import Bool, Float, Int

from itree_jax.tree.choice import measure_rules
from itree_jax.tree.classification_rules import RULE_NAMES
from itree_jax.tree.draws import draw_regions
from itree_jax.tree.error_rates import Measured, whole_and_cut, wilson_interval
from itree_jax.tree.joining import many_way_nodes, many_way_sides, side_said
from itree_jax.tree.tree import Confusion, InterpretationTree, Nodes
from itree_jax.tree.work_models import group_models

AMBIGUOUS = 0.25  # error rate between two: half way to a coin's


def expected_confusion(
    nodes: Nodes, told: Measured, prior: Float[np.ndarray, "groups"], kept: Bool[np.ndarray, "groups"]
) -> Confusion:
    """Expected errors and pairwise errors, from the draws that the error rates were measured on."""
    right = np.where(kept[:, None], np.ones((len(prior), 2)), np.nan)
    for node in many_way_nodes(nodes):
        side = many_way_sides(nodes, kept, node)
        at = told.take(np.flatnonzero(side[told.group] >= 0))
        wrong = side_said(at, nodes.rule[node], prior, side) != side[at.group]
        for g in np.flatnonzero(side >= 0):
            for kind, cut in enumerate((False, True)):
                own = (at.group == g) & (at.cut == cut)
                right[g, kind] *= 1.0 - wrong[own].mean() if own.any() else 1.0
    group_error = (1.0 - right).astype(np.float32)
    expected = np.nansum(prior[:, None] * group_error, axis=0).astype(np.float32)
    error, rule = pair_errors(told, kept)
    return Confusion(expected, group_error, error, rule)


def pair_errors(
    told: Measured, kept: Bool[np.ndarray, "groups"]
) -> tuple[Float[np.ndarray, "groups groups"], tuple[tuple[str, ...], ...]]:
    """Of every two groups, seen equally often: the least error of any rule, and its name."""
    count = len(kept)
    error = np.full((count, count), np.nan, np.float32)
    names = [[""] * count for _ in range(count)]
    for g, h in ((g, h) for g in np.flatnonzero(kept) for h in np.flatnonzero(kept) if g < h):
        pair = np.isin(told.group, (g, h))
        present = np.unique(told.group[pair])
        if len(present) < 2:
            continue
        sides = np.arange(count) == g, np.arange(count) == h
        even = (sides[0] | sides[1]) / 2.0
        at = told.take(np.flatnonzero(pair))
        rates = [whole_and_cut(at, (r,), even, *sides).mean() for r in range(len(RULE_NAMES))]
        error[g, h] = error[h, g] = min(rates)
        names[g][h] = names[h][g] = RULE_NAMES[int(np.argmin(rates))]
    return error, tuple(tuple(row) for row in names)


def inseparable(tree: InterpretationTree, group: int) -> list[int]:
    """Groups that no rule tells from this one: the best errs in over `AMBIGUOUS` of the draws of both."""
    with np.errstate(invalid="ignore"):
        return np.flatnonzero(tree.confusion.pair_error[group] > AMBIGUOUS).tolist()


class Counted(NamedTuple):
    """What fresh draws did."""

    error: Float[np.ndarray, "2"]  # on whole and on cut regions, groups weighted by their share of the views
    interval: Float[np.ndarray, "2 2"]  # 95 %
    table: Float[np.ndarray, "groups groups"]  # share of a group's draws (rows) that end in each leaf
    draws: Int[np.ndarray, "groups"]


def counted(tree: InterpretationTree, draws: int, seed: int) -> Counted:
    """Walks fresh noisy draws (`draws` per group) down the tree and counts where they end.

    Take a seed that the tree was not compiled with: the draws must be new ones.
    """
    part, groups = lean(tree.part.about_middle()), tree.groups
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle)
    fresh = draw_regions(mesh, tree.sensor, groups, draws, np.random.default_rng([seed, 3]))
    kept, prior = ~groups.pruned, np.where(groups.pruned, 0.0, groups.view_count)
    prior = prior / prior.sum()
    told = measure_rules(fresh, group_models(tree.appearances, groups.group_count), tree.distributions, prior)
    leaf = walked(tree.nodes, told, prior, kept)
    table = np.zeros((groups.group_count, groups.group_count))
    np.add.at(table, (told.group, leaf), 1.0)
    number = table.sum(axis=1)
    error, interval = np.zeros(2), np.zeros((2, 2))
    for kind, cut in enumerate((False, True)):
        own = told.cut == cut
        count = np.bincount(told.group[own], minlength=groups.group_count)
        weight = prior[told.group[own]] / np.maximum(count, 1)[told.group[own]]
        weight = weight / max(weight.sum(), 1e-12)
        error[kind] = ((leaf != told.group)[own] @ weight) if own.any() else np.nan
        independent = 1.0 / max(float((weight**2).sum()), 1e-12)
        interval[kind] = wilson_interval(error[kind] * independent, independent)
    return Counted(error, interval, table / np.maximum(number, 1.0)[:, None], number.astype(np.int64))


def walked(
    nodes: Nodes, told: Measured, prior: Float[np.ndarray, "groups"], kept: Bool[np.ndarray, "groups"]
) -> Int[np.ndarray, "draws"]:
    """The leaf of every draw, each node taking the likelier side."""
    alive = np.tile(kept, (len(told.group), 1))
    for node in many_way_nodes(nodes):
        side = many_way_sides(nodes, kept, node)
        here = np.flatnonzero((alive & (side >= 0)).any(axis=1))
        if len(here):
            said = side_said(told.take(here), nodes.rule[node], prior, side)
            alive[here] &= (side[None, :] == said[:, None]) | (side[None, :] < 0)
    return np.where(alive.any(axis=1), alive.argmax(axis=1), 0)
