"""The root of a forest: which parts a region may belong to, told by rules L1-L5 as a node of a tree tells groups apart.

(Our addition: Ikeuchi 1987 recognises one part.) A part is the mixture of its attitude groups, each with its share of
the views: the draws that a tree remembers are the draws of its part. L6 and L7 lay a region beside the work models of
every group of one part; they are left to the trees.

A tree keeps no second set of draws. So the draws are divided in two, and what is reported is how each half is told with
densities of the other.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.distance import cdist
from scipy.special import logsumexp

from itree_jax.tree.choice import cheapest_of_equals
from itree_jax.tree.classification_rules import CLASSIFICATION_RULES, PAIR
from itree_jax.tree.classify import LEAST_ERROR
from itree_jax.tree.tree import InterpretationTree

ROOT_RULES = tuple(rule for rule in CLASSIFICATION_RULES if not rule.relational)
NONE = "none of the parts"  # last column of what the root says
MOST_DRAWS = 256  # of a part: twenty parts are measured in seconds, an error of 5 % to 1.4 %
LEFT_OUT = LEAST_ERROR  # share of a part's regions whose part the root may leave out; most parts show two regions
# A part that is twenty times less likely than the best one goes on, however well the draws are told apart.
LEAST_BEHIND = float(np.log((1.0 - LEAST_ERROR) / LEAST_ERROR))
WIDER = 2.0  # regions of floor, bin and other things spread so much wider than regions of all parts together
SAME = 1e-6  # [nat] parts this close are as likely as each other

Quantities = tuple[Float[np.ndarray, "n d"], ...]  # what every one of `ROOT_RULES` measured


@dataclass(frozen=True)
class PartDraws:
    """What the root knows of one part: quantities of its draws under every rule."""

    samples: Quantities  # row k of all rules is draw k
    bandwidth: tuple[Float[np.ndarray, "d"], ...]
    weight: Float[np.ndarray, "n"]  # share of the views, sum 1

    def take(self, index: Int[np.ndarray, "kept"]) -> "PartDraws":
        weight = self.weight[index]
        return PartDraws(tuple(s[index] for s in self.samples), self.bandwidth, weight / weight.sum())


@dataclass(frozen=True)
class Root:
    """The node above the trees, with the errors it was chosen by.

    `confusion[p, q]` is the share of part p's draws that part q is likeliest for; the last column is `NONE`.
    """

    names: tuple[str, ...]  # of the parts
    draws: tuple[PartDraws, ...]
    rule: str  # "L1".."L5", or several joined by "+"
    error: float  # share of draws whose part is not the likeliest; every part counts alike
    rule_errors: Float[np.ndarray, "rules"]  # of each rule alone
    confusion: Float[np.ndarray, "parts outcomes"]
    behind: float  # [nat] a part this far behind the likeliest, or less, is left
    left_out: float  # measured share of draws whose part is not left
    mean_left: float  # parts left for a draw

    def log_posterior(self, measured: Sequence[Quantities]) -> Float[np.ndarray, "regions outcomes"]:
        """log p(part | region), last column `NONE`; `measured[p]`: the regions as the windows of part p show them."""
        return log_posterior(rules_of(self.rule), self.draws, measured)

    def left(self, posterior: Float[np.ndarray, "regions outcomes"]) -> Bool[np.ndarray, "regions parts"]:
        """The parts that each region may belong to; none of them for a region that is like no part."""
        return parts_left(posterior, self.behind)


def rules_of(name: str) -> tuple[int, ...]:
    """Indices in `ROOT_RULES` of "L1", "L1+L3", ..."""
    names = [rule.name for rule in ROOT_RULES]
    return tuple(names.index(one) for one in name.split(PAIR))


def part_draws(tree: InterpretationTree) -> PartDraws:
    """The draws that a tree remembers, every group weighed by its share of the views, at most `MOST_DRAWS`."""
    groups = tree.groups
    prior = np.where(groups.pruned, 0, groups.view_count).astype(float)
    of_rule = [tree.distributions.samples[CLASSIFICATION_RULES.index(rule)] for rule in ROOT_RULES]
    there = ~np.isnan(of_rule[0][..., 0])
    most = max(2, MOST_DRAWS // max(1, int(np.sum(prior > 0))))
    group, row = [], []
    for g in np.flatnonzero((prior > 0) & there.any(axis=1)):
        own = np.flatnonzero(there[g])
        own = own[np.linspace(0, len(own) - 1, min(most, len(own))).round().astype(int)]
        group += [g] * len(own)
        row += own.tolist()
    at = np.array(group, int), np.array(row, int)
    weight = prior[at[0]] / np.bincount(at[0], minlength=len(prior))[at[0]]
    bandwidth = tuple(tree.distributions.bandwidth[CLASSIFICATION_RULES.index(rule)] for rule in ROOT_RULES)
    return PartDraws(tuple(s[at].astype(float) for s in of_rule), bandwidth, weight / weight.sum())


def measure_root(trees: Sequence[InterpretationTree]) -> Root:
    """Chooses the rules by the error between the parts, and how far behind a part may be and still be left."""
    draws = tuple(part_draws(tree) for tree in trees)
    density, true, weight = cross_validated(draws)
    chosen, rule_errors = choose(density, true, weight)
    said = with_none_weighed(density[list(chosen)].sum(axis=0))
    behind = max(LEAST_BEHIND, weighted_quantile(behind_best(said)[np.arange(len(true)), true], weight, 1.0 - LEFT_OUT))
    left = parts_left(said, behind)
    confusion = np.zeros((len(trees), said.shape[1]))
    np.add.at(confusion, (true, said.argmax(axis=1)), weight * len(trees))
    return Root(
        names=tuple(tree.part.name for tree in trees), draws=draws,
        rule=PAIR.join(ROOT_RULES[r].name for r in chosen),
        error=told_wrong(said, true, weight), rule_errors=rule_errors, confusion=confusion, behind=behind,
        left_out=float(weight @ ~left[np.arange(len(true)), true]), mean_left=float(weight @ left.sum(axis=1)),
    )


def cross_validated(
    draws: Sequence[PartDraws],
) -> tuple[Float[np.ndarray, "rules draws outcomes"], Int[np.ndarray, "draws"], Float[np.ndarray, "draws"]]:
    """log p(quantity | part) of every draw with the other half of the draws as densities; true parts; weights."""
    halves = [[one.take(np.arange(k, len(one.weight), 2)) for one in draws] for k in (0, 1)]
    density, true, weight = [], [], []
    for known, asked in (halves, halves[::-1]):
        quantities = tuple(np.concatenate(of_parts) for of_parts in zip(*(one.samples for one in asked), strict=True))
        density.append([log_densities(r, known, [quantities] * len(draws)) for r in range(len(ROOT_RULES))])
        true.append(np.repeat(np.arange(len(draws)), [len(one.weight) for one in asked]))
        weight.append(np.concatenate([one.weight for one in asked]))
    total = np.concatenate(weight)
    return np.concatenate(density, axis=1), np.concatenate(true), total / total.sum()


def choose(
    density: Float[np.ndarray, "rules draws outcomes"], true: Int[np.ndarray, "draws"],
    weight: Float[np.ndarray, "draws"],
) -> tuple[tuple[int, ...], Float[np.ndarray, "rules"]]:
    """The rules that err least together, the cheapest of equals; also the error of each rule alone.

    Where a node of a tree takes two rules at most, the root takes any: the trees measure them all anyway.
    """
    count = len(ROOT_RULES)
    sets = [rules for size in range(1, count + 1) for rules in combinations(range(count), size)]
    errors = np.array([told_wrong(with_none_weighed(density[list(s)].sum(axis=0)), true, weight) for s in sets])
    best = cheapest_of_equals(errors, [sum(ROOT_RULES[r].cost for r in s) for s in sets])
    return sets[best], errors[:count]


def log_posterior(
    rules: Sequence[int], draws: Sequence[PartDraws], measured: Sequence[Quantities]
) -> Float[np.ndarray, "regions outcomes"]:
    said = with_none_weighed(np.sum([log_densities(r, draws, measured) for r in rules], axis=0))
    return said - logsumexp(said, axis=1, keepdims=True)


def log_densities(
    rule: int, draws: Sequence[PartDraws], measured: Sequence[Quantities]
) -> Float[np.ndarray, "regions outcomes"]:
    """log p(quantity | part): kernel densities over each part's draws, in the windows of that part. Last `NONE`: a
    normal distribution about all parts, `WIDER` than they are.

    A region may be cut as no draw was: a share of `LEAST_ERROR` of a part's regions is like any other thing, so that no
    rule speaks louder than it was measured to be right.
    """
    parts = [
        log_density(quantity[rule], one.samples[rule], one.bandwidth[rule], one.weight)
        for one, quantity in zip(draws, measured, strict=True)
    ]
    mean = np.mean([one.weight @ one.samples[rule] for one in draws], axis=0)
    variance = np.mean([one.weight @ (one.samples[rule] - mean) ** 2 for one in draws], axis=0)
    narrowest = np.max([one.bandwidth[rule] for one in draws], axis=0)
    deviation = WIDER * np.maximum(np.sqrt(variance), narrowest)
    none = np.mean([log_density(q[rule], mean[None], deviation, np.ones(1)) for q in measured], axis=0)
    believed = [np.logaddexp(np.log1p(-LEAST_ERROR) + part, np.log(LEAST_ERROR) + none) for part in parts]
    return np.stack([*believed, none], axis=1)


def log_density(
    quantity: Float[np.ndarray, "n d"], samples: Float[np.ndarray, "m d"], bandwidth: Float[np.ndarray, "d"],
    weight: Float[np.ndarray, "m"],
) -> Float[np.ndarray, "n"]:
    """Of a weighted kernel density, up to the constant that all densities of this rule share."""
    squared = cdist(quantity / bandwidth, samples / bandwidth, "sqeuclidean")
    return logsumexp(-0.5 * squared, axis=1, b=weight[None]) - np.log(bandwidth).sum()


def with_none_weighed(density: Float[np.ndarray, "n outcomes"]) -> Float[np.ndarray, "n outcomes"]:
    """Parts are as frequent as each other, and `NONE` as all of them together; of one part, every region is."""
    parts = density.shape[1] - 1
    prior = np.log(parts) if parts > 1 else -np.inf
    return density + np.append(np.zeros(parts), prior)


def behind_best(said: Float[np.ndarray, "n outcomes"]) -> Float[np.ndarray, "n outcomes"]:
    """By how much [nat] each outcome is less likely than the likeliest."""
    return said.max(axis=1, keepdims=True) - said


def parts_left(said: Float[np.ndarray, "n outcomes"], behind: float) -> Bool[np.ndarray, "n parts"]:
    return behind_best(said)[:, :-1] <= behind + SAME


def told_wrong(
    said: Float[np.ndarray, "n outcomes"], true: Int[np.ndarray, "n"], weight: Float[np.ndarray, "n"]
) -> float:
    """Share of draws whose part is not the likeliest; where k are as likely, 1 - 1/k of a draw."""
    best = behind_best(said) <= SAME
    right = best[np.arange(len(true)), true] / best.sum(axis=1)
    return float(weight @ (1.0 - right))


def weighted_quantile(values: Float[np.ndarray, "n"], weight: Float[np.ndarray, "n"], share: float) -> float:
    """The least value that this share of the weight does not exceed."""
    order = np.argsort(values)
    reached = np.searchsorted(np.cumsum(weight[order]), share * weight.sum() - 1e-12)
    return float(values[order][min(reached, len(values) - 1)])
