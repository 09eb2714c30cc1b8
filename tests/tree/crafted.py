"""Draws whose log-likelihoods are given, and nodes that stand for themselves."""

import numpy as np

from itree_jax.tree.branches import Branches, branches
from itree_jax.tree.classification_rules import RULE_NAMES
from itree_jax.tree.error_rates import Measured
from itree_jax.tree.joining import tops
from itree_jax.tree.tree import PRUNED, Nodes

LABELS = np.array([[True, True, False], [True, False, False], [False, True, False], [False, False, True]])
AREAS = np.array([300.0, 200.0, 100.0])


def four_groups(pruned=(False,) * 4) -> Branches:
    """B0: groups 0, 1 or 2, 3; B1 divides the first two, B2 the others."""
    return branches(LABELS, AREAS, np.array(pruned))


def told(margins: dict[str, np.ndarray], group: np.ndarray, cut: np.ndarray | None = None, groups: int = 2) -> Measured:
    """Draws about which rule r says `margins[r]` [draws]: log-likelihood of the true group over any other.

    Rules that aren't named say nothing.
    """
    table = np.zeros((len(RULE_NAMES), len(group), groups))
    for rule, margin in margins.items():
        table[RULE_NAMES.index(rule), np.arange(len(group)), group] = margin
    return Measured(table, group, np.zeros(len(group), bool) if cut is None else cut)


def random_told(seed: int, groups: int = 4, draws: int = 25) -> Measured:
    """Draws of every group, every second one cut; some rules know more than others."""
    rng = np.random.default_rng(seed)
    group = np.repeat(np.arange(groups), draws)
    table = rng.normal(size=(len(RULE_NAMES), len(group), groups))
    table[:, np.arange(len(group)), group] += rng.uniform(0, 3, (len(RULE_NAMES), 1))
    return Measured(table, group, np.arange(len(group)) % 2 == 1)


def nodes_of(branch: Branches, rule: tuple[str, ...]) -> Nodes:
    """Nodes with these rules, whose errors nobody measured."""
    count, rules = branch.branch_count, len(RULE_NAMES)
    rule = tuple(PRUNED if p else r for r, p in zip(rule, branch.pruned, strict=True))
    return Nodes(
        branch=branch.names, tested=branch.tested, parent=branch.parent, on_visible_side=branch.on_visible_side,
        visible=branch.visible, hidden=branch.hidden, rule=rule, error=np.zeros(count, np.float32),
        error_interval=np.zeros((count, 2), np.float32), rule_errors=np.zeros((count, rules, 2), np.float32),
        whole_and_cut=np.zeros((count, 2), np.float32), draws=np.zeros(count, np.int32),
        joined=tops(branch.parent, rule), joined_error=np.zeros((count, 2), np.float32),
    )  # fmt: skip
