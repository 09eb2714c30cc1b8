"""Choosing the rule of every node by measured error rates (the paper leaves this "to humans at present")."""

import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Bool, Float, Int

from itree_jax.tree.branches import Branches
from itree_jax.tree.classification_rules import (
    CLASSIFICATION_RULES,
    RULE_NAMES,
    kernel_bandwidth,
    log_likelihoods,
    quantities,
)
from itree_jax.tree.draws import Draws
from itree_jax.tree.tree import PRUNED, Distributions, Nodes

POLICIES = ("measured", "paper")
ERROR_BOUND = 0.05  # policy `paper`: the first rule whose error is under it
EQUAL_ERROR = 0.005  # policy `measured`: rules this close are equal, the cheaper one is taken


def distributions(draws: Draws, group_count: int) -> Distributions:
    """The samples of every rule's quantity by group."""
    samples, bandwidths = [], []
    for quantity in map(np.asarray, quantities(draws.features)):
        most = max(1, int(np.bincount(draws.group, minlength=group_count).max()))
        table = np.full((group_count, most, quantity.shape[1]), np.nan, np.float32)
        for g in range(group_count):
            own = quantity[draws.group == g]
            table[g, : len(own)] = own
        samples.append(table)
        bandwidths.append(kernel_bandwidth(quantity, draws.group))
    return Distributions(RULE_NAMES, tuple(samples), tuple(bandwidths))


def side_margin(
    log_likelihood: Float[np.ndarray, "draws groups"], prior: Float[np.ndarray, "groups"],
    visible: Bool[np.ndarray, "groups"], hidden: Bool[np.ndarray, "groups"],
) -> Float[np.ndarray, "draws"]:
    """log p(visible side) - log p(hidden side), groups weighted by their share of the views."""
    with np.errstate(divide="ignore"):
        weighted = log_likelihood + np.log(prior)
    return np.logaddexp.reduce(weighted[:, visible], axis=1) - np.logaddexp.reduce(weighted[:, hidden], axis=1)


def wilson_interval(errors: float, count: int, z: float = 1.96) -> tuple[float, float]:
    """95 % interval of a share (Wilson 1927)."""
    if count == 0:
        return 0.0, 1.0
    p = errors / count
    centre = (p + z * z / (2 * count)) / (1 + z * z / count)
    half = z * np.sqrt(p * (1 - p) / count + z * z / (4 * count * count)) / (1 + z * z / count)
    return max(0.0, float(centre - half)), min(1.0, float(centre + half))


def choose_rules(
    branches: Branches, measured: Distributions, test: Draws, prior: Float[np.ndarray, "groups"],
    kept: Bool[np.ndarray, "groups"], policy: str,
) -> Nodes:
    """The rule of every branch. `prior`: share of views per group; `kept`: groups that aren't pruned.

    Raises ItreeError when the policy is not one of `POLICIES`.
    """
    if policy not in POLICIES:
        raise ItreeError(f"There is no policy {policy!r}; use one of {', '.join(POLICIES)}.")
    table = np.asarray(log_likelihoods(quantities(test.features), measured.samples, measured.bandwidth))
    rules, errors, intervals, all_errors, counts = [], [], [], [], []
    for k in range(branches.branch_count):
        visible, hidden = branches.visible[k] & kept, branches.hidden[k] & kept
        if branches.pruned[k]:
            rules.append(PRUNED)
            errors.append(0.0)
            intervals.append((0.0, 0.0))
            all_errors.append(np.full(len(CLASSIFICATION_RULES), np.nan))
            counts.append(0)
            continue
        here = np.flatnonzero((visible | hidden)[test.group])
        wrong = np.stack([
            (side_margin(t[here], prior, visible, hidden) > 0) != visible[test.group[here]] for t in table
        ])
        weight = view_weights(test.group[here], prior)
        rates = wrong @ weight
        chosen = _choose(rates, policy)
        rules.append(CLASSIFICATION_RULES[chosen].name)
        errors.append(float(rates[chosen]))
        intervals.append(wilson_interval(rates[chosen] * len(here), len(here)))
        all_errors.append(rates)
        counts.append(len(here))
    count = branches.branch_count
    return Nodes(
        branch=branches.names, tested=branches.tested, parent=branches.parent, on_visible_side=branches.on_visible_side,
        visible=branches.visible, hidden=branches.hidden, rule=tuple(rules),
        error=np.array(errors, np.float32).reshape(count),
        error_interval=np.array(intervals, np.float32).reshape(count, 2),
        rule_errors=np.array(all_errors, np.float32).reshape(count, len(CLASSIFICATION_RULES)),
        draws=np.array(counts, np.int32).reshape(count),
    )


def view_weights(group: Int[np.ndarray, "draws"], prior: Float[np.ndarray, "groups"]) -> Float[np.ndarray, "draws"]:
    """Weights that sum to 1 and give every group its share of the views, however many draws it has."""
    count = np.bincount(group, minlength=len(prior))
    weight = prior[group] / count[group]
    return weight / weight.sum()


def _choose(rates: Float[np.ndarray, "rules"], policy: str) -> int:
    if policy == "paper":
        under = np.flatnonzero(rates < ERROR_BOUND)
        return int(under[0]) if len(under) else int(np.argmin(rates))
    equal = np.flatnonzero(rates <= rates.min() + EQUAL_ERROR)
    return int(min(equal, key=lambda k: (CLASSIFICATION_RULES[k].cost, rates[k])))
