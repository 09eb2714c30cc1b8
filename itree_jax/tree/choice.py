"""Choosing the rule of every branch by measured error rates (the paper leaves this "to humans at present").

Errors are measured on draws that stand alone and on draws that another part cuts. The paper takes the highest region,
"which is usually not occluded": its policy goes by the draws that stand alone. The policy `measured` expects a region
to be cut as often as not.
"""

import jax.numpy as jnp
import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Bool, Float

from itree_jax.batches import filled, multiple_above
from itree_jax.features.region import RegionFeatures
from itree_jax.tree.branches import Branches
from itree_jax.tree.classification_rules import (
    CLASSIFICATION_RULES,
    PAIR,
    RULE_NAMES,
    log_likelihoods,
    quantities,
)
from itree_jax.tree.draws import Draws
from itree_jax.tree.error_rates import Measured, at_stake, expected, independent_draws, whole_and_cut, wilson_interval
from itree_jax.tree.joining import joined_nodes
from itree_jax.tree.likelihood import kernel_bandwidth, relational_bandwidth
from itree_jax.tree.tree import PRUNED, Distributions, Nodes
from itree_jax.tree.work_models import GroupModels

POLICIES = ("measured", "paper")
ERROR_BOUND = 0.05  # policy `paper`: the first rule whose error is under it
EQUAL_ERROR = 0.005  # policy `measured`: rules this close are equal, the cheaper one is taken
DRAWS_STEP, SAMPLES_STEP = 512, 64  # draws, and those of a group, are filled up to a multiple: few shapes are compiled
WORTH_A_PAIR = 0.02  # a second rule is measured only where it takes away more than this


def quantities_of(draws: Draws, models: GroupModels) -> tuple[Float[np.ndarray, "draws d"], ...]:
    """What every rule compares, of every draw; computed for one of a few numbers of them."""
    count = len(draws.group)
    return tuple(q[:count] for q in map(np.asarray, quantities(_of_few_sizes(draws.features, count), models)))


def _of_few_sizes(features: RegionFeatures, count: int) -> RegionFeatures:
    return filled(features, multiple_above(count, DRAWS_STEP))


def distributions(draws: Draws, models: GroupModels, group_count: int) -> Distributions:
    """The samples of every rule's quantity by group."""
    samples, bandwidths = [], []
    for rule, quantity in zip(CLASSIFICATION_RULES, quantities_of(draws, models), strict=True):
        most = max(1, int(np.bincount(draws.group, minlength=group_count).max()))
        table = np.full((group_count, most, quantity.shape[1]), np.nan, np.float32)
        for g in range(group_count):
            own = quantity[draws.group == g]
            table[g, : len(own)] = own
        samples.append(table)
        bandwidths.append((relational_bandwidth if rule.relational else kernel_bandwidth)(quantity, draws.group))
    return Distributions(RULE_NAMES, tuple(samples), tuple(bandwidths))


def measure_rules(
    draws: Draws, models: GroupModels, known: Distributions, prior: Float[np.ndarray, "groups"]
) -> Measured:
    """What every rule says about every draw."""
    count = len(draws.group)
    measured = quantities(_of_few_sizes(draws.features, count), models)
    most = multiple_above(known.samples[0].shape[1], SAMPLES_STEP)
    samples = tuple(
        np.pad(s, ((0, 0), (0, most - s.shape[1]), (0, 0)), constant_values=np.nan) for s in known.samples
    )
    found = log_likelihoods(measured, samples, known.bandwidth, jnp.asarray(prior, jnp.float32))
    return Measured(np.asarray(found)[:, :count], draws.group, draws.cut)


def check_policy(policy: str) -> None:
    """Raises ItreeError when the policy is not one of `POLICIES`."""
    if policy not in POLICIES:
        raise ItreeError(f"There is no policy {policy!r}; use one of {', '.join(POLICIES)}.")


def choose_rules(
    branches: Branches, test: Measured, prior: Float[np.ndarray, "groups"], kept: Bool[np.ndarray, "groups"],
    policy: str,
) -> Nodes:
    """The rule of every branch, by the error rates on other draws than those that the distributions are made of.

    `prior`: share of views per group; `kept`: groups that aren't pruned. Raises ItreeError on an unknown policy.
    """
    check_policy(policy)
    count, rules = branches.branch_count, len(RULE_NAMES)
    names, error, interval = [PRUNED] * count, np.zeros(count, np.float32), np.zeros((count, 2), np.float32)
    rates, draws = np.full((count, rules, 2), np.nan, np.float32), np.zeros(count, np.int32)
    own = np.zeros((count, 2), np.float32)
    for k in np.flatnonzero(~branches.pruned):
        sides = branches.visible[k] & kept, branches.hidden[k] & kept
        here = (sides[0] | sides[1])[test.group]
        at = test.take(np.flatnonzero(here))
        rates[k] = np.array([whole_and_cut(at, (r,), prior, *sides) for r in range(rules)])
        names[k], own[k] = choose_rule(at, rates[k], prior, *sides, policy)
        used = at_stake(at, policy)
        error[k], draws[k] = expected(own[k], policy), len(used.group)
        independent = independent_draws(used.group, prior)
        interval[k] = wilson_interval(error[k] * independent, independent)
    joint, joint_error = joined_nodes(branches, tuple(names), test, prior, kept)
    return Nodes(
        branch=branches.names, tested=branches.tested, parent=branches.parent, on_visible_side=branches.on_visible_side,
        visible=branches.visible, hidden=branches.hidden, rule=tuple(names), error=error, error_interval=interval,
        rule_errors=rates, whole_and_cut=own, draws=draws, joined=joint, joined_error=joint_error,
    )


def choose_rule(
    at: Measured, rates: Float[np.ndarray, "rules 2"], prior: Float[np.ndarray, "groups"],
    visible: Bool[np.ndarray, "groups"], hidden: Bool[np.ndarray, "groups"], policy: str,
) -> tuple[str, Float[np.ndarray, "2"]]:
    """The rule (or pair of rules) that a policy takes at a branch, and its errors on whole and on cut regions.

    `paper`: the first rule whose error is under the bound; where none is, the least. `measured`: the least expected
    error, the cheapest of equals; a pair where no single rule is under the bound and a second one helps.
    """
    single = expected(rates, policy)
    if policy == "paper":
        under = np.flatnonzero(single < ERROR_BOUND)
        k = int(under[0]) if len(under) else int(np.argmin(single))
        return RULE_NAMES[k], rates[k]
    best = cheapest_of_equals(single, [rule.cost for rule in CLASSIFICATION_RULES])
    if single[best] < ERROR_BOUND:
        return RULE_NAMES[best], rates[best]
    pairs = [(i, j) for i in range(len(RULE_NAMES)) for j in range(i)]
    together = np.array([whole_and_cut(at, pair, prior, visible, hidden) for pair in pairs])
    costs = [CLASSIFICATION_RULES[i].cost + CLASSIFICATION_RULES[j].cost for i, j in pairs]
    least = cheapest_of_equals(expected(together, policy), costs)
    if expected(together[least], policy) < single[best] - WORTH_A_PAIR:
        i, j = pairs[least]
        return f"{RULE_NAMES[j]}{PAIR}{RULE_NAMES[i]}", together[least]
    return RULE_NAMES[best], rates[best]


def cheapest_of_equals(errors: Float[np.ndarray, "rules"], costs: list[float]) -> int:
    """The cheapest among those within `EQUAL_ERROR` of the least; of equal cost, the one that errs least."""
    equal = np.flatnonzero(errors <= errors.min() + EQUAL_ERROR)
    return int(min(equal, key=lambda k: (costs[k], errors[k])))
