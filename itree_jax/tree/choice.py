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


def wilson_interval(errors: float, count: float, z: float = 1.96) -> tuple[float, float]:
    """95 % interval of a share (Wilson 1927)."""
    if count == 0:
        return 0.0, 1.0
    p = errors / count
    spread = z * z / count
    centre = (p + spread / 2) / (1 + spread)
    half = np.sqrt(spread * p * (1 - p) + spread**2 / 4) / (1 + spread)
    low = centre - half if errors > 0 else 0.0  # the ends exactly: the formula leaves a rounding error there
    high = centre + half if errors < count else 1.0
    return max(0.0, float(low)), min(1.0, float(high))


def check_policy(policy: str) -> None:
    """Raises ItreeError when the policy is not one of `POLICIES`."""
    if policy not in POLICIES:
        raise ItreeError(f"There is no policy {policy!r}; use one of {', '.join(POLICIES)}.")


def choose_rules(
    branches: Branches, measured: Distributions, test: Draws, prior: Float[np.ndarray, "groups"],
    kept: Bool[np.ndarray, "groups"], policy: str,
) -> Nodes:
    """The rule of every branch, by the error rates on other draws than those of `measured`.

    `prior`: share of views per group; `kept`: groups that aren't pruned. Raises ItreeError on an unknown policy.
    """
    check_policy(policy)
    likelihood = np.asarray(log_likelihoods(quantities(test.features), measured.samples, measured.bandwidth))
    count, rules = branches.branch_count, len(RULE_NAMES)
    names, error, interval = [PRUNED] * count, np.zeros(count, np.float32), np.zeros((count, 2), np.float32)
    rates, draws = np.full((count, rules), np.nan, np.float32), np.zeros(count, np.int32)
    for k in np.flatnonzero(~branches.pruned):
        visible, hidden = branches.visible[k] & kept, branches.hidden[k] & kept
        here = (visible | hidden)[test.group]
        weight = view_weights(test.group[here], prior)
        rates[k] = side_errors(likelihood[:, here], prior, visible, hidden, test.group[here]) @ weight
        chosen = choose_rule(rates[k], policy)
        names[k], error[k], draws[k] = RULE_NAMES[chosen], rates[k, chosen], here.sum()
        independent = 1.0 / np.sum(weight**2)  # draws of equal weight that would say as much
        interval[k] = wilson_interval(error[k] * independent, independent)
    return Nodes(
        branch=branches.names, tested=branches.tested, parent=branches.parent, on_visible_side=branches.on_visible_side,
        visible=branches.visible, hidden=branches.hidden, rule=tuple(names), error=error, error_interval=interval,
        rule_errors=rates, draws=draws,
    )


def side_errors(
    log_likelihood: Float[np.ndarray, "rules draws groups"], prior: Float[np.ndarray, "groups"],
    visible: Bool[np.ndarray, "groups"], hidden: Bool[np.ndarray, "groups"], group: Int[np.ndarray, "draws"],
) -> Bool[np.ndarray, "rules draws"]:
    """Which draws each rule puts on the wrong side."""
    return np.stack([(side_margin(each, prior, visible, hidden) > 0) != visible[group] for each in log_likelihood])


def view_weights(group: Int[np.ndarray, "draws"], prior: Float[np.ndarray, "groups"]) -> Float[np.ndarray, "draws"]:
    """Weights that sum to 1 and give every group its share of the views, however many draws it has."""
    count = np.bincount(group, minlength=len(prior))
    weight = prior[group] / count[group]
    return weight / weight.sum()


def choose_rule(rates: Float[np.ndarray, "rules"], policy: str) -> int:
    """Index of the rule that a policy takes by the error rates."""
    if policy == "paper":
        under = np.flatnonzero(rates < ERROR_BOUND)
        return int(under[0]) if len(under) else int(np.argmin(rates))
    equal = np.flatnonzero(rates <= rates.min() + EQUAL_ERROR)
    return int(min(equal, key=lambda k: (CLASSIFICATION_RULES[k].cost, rates[k])))
