"""Determination rules A1-A8 as one family: what each compares, its cost, and the freedom that it takes
(Ikeuchi 1987, sec. 2.2.1)."""

from collections.abc import Callable
from dataclasses import dataclass

from jaxtyping import Array, Float

from itree_jax.features.region import RegionFeatures
from itree_jax.tree.appearance_rows import AppearanceArrays, DeterminationScales, bounded
from itree_jax.tree.determination_relations import compare_maps, relation_penalty
from itree_jax.tree.determination_rules import compare_shape, direction_penalty, outline_distance


@dataclass(frozen=True)
class DeterminationRule:
    """One of A1..A8: name, title, cost relative to A1, which freedom it takes, and its penalty
    (-log-likelihood) of every appearance at every turn. `None`: it compares without turns (A1, A2)."""

    name: str
    title: str
    cost: float
    fixes: str  # "direction", "two rotations", "rotation" or "attitude"
    penalty: Callable[[RegionFeatures, AppearanceArrays, DeterminationScales], Float[Array, "rows turns"]] | None


DETERMINATION_RULES = (
    DeterminationRule("A1", "EGI mass centre", 1.0, "direction", None),
    DeterminationRule("A2", "extended Gaussian image", 3.0, "attitude", None),
    DeterminationRule("A3", "position of observable regions", 2.0, "two rotations", relation_penalty),
    DeterminationRule(
        "A4", "inertia direction of original face", 1.0, "two rotations",
        lambda f, rows, scales: direction_penalty(f, rows, compare_shape(f, rows), scales),
    ),
    DeterminationRule(
        "A5", "rotation of original face shape", 2.0, "rotation",
        lambda f, rows, scales: bounded(outline_distance(f.outline, rows.outline) / scales.outline),
    ),
    DeterminationRule(
        "A6", "position of surface characteristics", 4.0, "rotation",
        lambda f, rows, scales: bounded(compare_maps(f, rows).characteristic / scales.characteristic),
    ),
    DeterminationRule(
        "A7", "position of edges", 4.0, "rotation",
        lambda f, rows, scales: bounded(compare_maps(f, rows).edges / scales.edges),
    ),
    DeterminationRule(
        "A8", "edges relative to surface characteristics", 6.0, "rotation",
        lambda f, rows, scales: bounded(compare_maps(f, rows).both / scales.both),
    ),
)
DETERMINATION_RULE_NAMES = tuple(rule.name for rule in DETERMINATION_RULES)
