"""Classification rules L1-L7: what each compares, how likely a region is under every attitude group, and its cost
(Ikeuchi 1987, sec. 2.1.4).

L1-L5 compare distributions: each turns a region's work models into a short vector that no rotation in the image
changes, and a mirrored view would not change either. L6 and L7 compare relations, for which a region is laid beside the
work models of every group: quantity k is the agreement with group k's.
"""

from collections.abc import Callable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from itree_jax.features.characteristics import CHARACTERISTICS
from itree_jax.features.polar import RADII
from itree_jax.features.region import RegionFeatures
from itree_jax.kept_functions import kept
from itree_jax.tree.likelihood import group_log_likelihood, relational_log_likelihood
from itree_jax.tree.work_models import (
    GroupModels,
    each_region,
    edge_characteristic_agreement,
    relation_agreement,
)

OUTLINE_HARMONICS = 5  # of d(theta): beyond it a window of 48 pixels holds mostly its own raster
REGIONS_AT_ONCE = 16  # of regions compared with all draws of all groups
PAIR = "+"  # joins the names of two rules that are used together


@dataclass(frozen=True)
class ClassificationRule:
    """One of L1..L7: a name, the relative cost of measuring it, and what it compares."""

    name: str
    title: str
    cost: float  # relative to L1
    quantity_names: tuple[str, ...]  # empty: one agreement per group
    quantity: Callable[[RegionFeatures, GroupModels], Float[Array, "regions d"]]

    @property
    def relational(self) -> bool:
        """Whether quantity k is the agreement with group k's work models."""
        return not self.quantity_names


def inertia_quantity(features: RegionFeatures, models: GroupModels | None = None) -> Float[Array, "regions 2"]:
    """L1: the principal moments of the original face, as logarithms of lengths."""
    inertia = features.inertia
    moments = jnp.stack([inertia.I_max, inertia.I_min], axis=-1)
    return 0.25 * jnp.log(jnp.maximum(moments, 1.0))


def shape_quantity(features: RegionFeatures, models: GroupModels | None = None) -> Float[Array, "regions d"]:
    """L2: size and harmonics of d(theta). Amplitudes don't know where theta starts, so no rotation changes them."""
    spectrum = jnp.abs(jnp.fft.rfft(features.outline, axis=-1))[..., : OUTLINE_HARMONICS + 1]
    mean = jnp.maximum(spectrum[..., :1], 1e-6)
    return jnp.concatenate([jnp.log(mean), 2.0 * spectrum[..., 1:] / mean], axis=-1)


def egi_quantity(features: RegionFeatures, models: GroupModels | None = None) -> Float[Array, "regions 4"]:
    """L3: spread and mass of the extended Gaussian image, in every frame the same."""
    shortfall = 1.0 - jnp.sum(features.mass_centre**2, axis=-1)
    spread = jnp.sqrt(jnp.maximum(shortfall, 0.0))
    scatter = jnp.sqrt(jnp.maximum(features.normal_scatter, 0.0))
    mass = 0.5 * jnp.log(jnp.maximum(features.area, 1.0))
    return jnp.concatenate([spread[..., None], scatter, mass[..., None]], axis=-1)


def characteristic_quantity(features: RegionFeatures, models: GroupModels | None = None) -> Float[Array, "regions 5"]:
    """L4: how much of the surface is planar, cylindrical, elliptic or hyperbolic."""
    return features.shares


def edge_quantity(features: RegionFeatures, models: GroupModels | None = None) -> Float[Array, "regions 4"]:
    """L5: length of the edges, how far out they lie, and how they run against the radius."""
    cells = features.edge_map
    ring = jnp.arange(RADII, dtype=cells.dtype) / RADII
    by_ring = jnp.sum(cells[..., 0], axis=-1)
    length = jnp.sum(by_ring, axis=-1)
    safe = jnp.maximum(length, 1e-3)
    mean = by_ring @ ring / safe
    spread = jnp.sqrt(jnp.maximum(by_ring @ ring**2 / safe - mean**2, 1e-6))
    radial = jnp.sum(cells[..., 1], axis=(-2, -1)) / safe
    return jnp.stack([0.25 * jnp.log1p(length), mean, spread, 0.5 * radial], axis=-1)


def relation_quantity(features: RegionFeatures, models: GroupModels) -> Float[Array, "regions groups"]:
    """L6: agreement of the regions beside it with the brothers that each group shows."""
    return each_region(relation_agreement, features, models)


def edge_relation_quantity(features: RegionFeatures, models: GroupModels) -> Float[Array, "regions groups"]:
    """L7: agreement of edges and surface characteristics, where they lie to one another."""
    return each_region(edge_characteristic_agreement, features, models)


CLASSIFICATION_RULES = (
    ClassificationRule("L1", "original face inertia", 1.0, ("log I_max / 4", "log I_min / 4"), inertia_quantity),
    ClassificationRule(
        "L2", "original face shape", 2.0,
        ("log d", *(f"d_{k}" for k in range(1, OUTLINE_HARMONICS + 1))), shape_quantity,
    ),
    ClassificationRule(
        "L3", "extended Gaussian image", 3.0, ("spread", "scatter 1", "scatter 2", "log mass / 2"), egi_quantity
    ),
    ClassificationRule("L4", "surface characteristic distribution", 4.0, CHARACTERISTICS, characteristic_quantity),
    ClassificationRule(
        "L5", "edge distribution", 5.0, ("log length / 4", "mean radius", "spread of radii", "radial"), edge_quantity
    ),
    ClassificationRule("L6", "region distribution", 6.0, (), relation_quantity),
    ClassificationRule("L7", "edges relative to surface characteristics", 8.0, (), edge_relation_quantity),
)
RULE_NAMES = tuple(rule.name for rule in CLASSIFICATION_RULES)


def rules_in(name: str) -> tuple[int, ...]:
    """Indices of the rules that a node's rule is made of: "L1", or a pair such as "L1+L6"."""
    return tuple(RULE_NAMES.index(one) for one in name.split(PAIR))


@kept()
def quantities(features: RegionFeatures, models: GroupModels) -> tuple[Float[Array, "regions d"], ...]:
    """What every rule compares, in the order of `CLASSIFICATION_RULES`."""
    return tuple(rule.quantity(features, models) for rule in CLASSIFICATION_RULES)


@kept()
def log_likelihoods(
    measured: tuple[Float[Array, "regions d"], ...],
    samples: tuple[Float[Array, "groups draws d"], ...],
    bandwidth: tuple[Float[Array, "d"], ...],
    prior: Float[Array, "groups"],
) -> Float[Array, "rules regions groups"]:
    """log p(quantity | group) of every rule, a few regions at a time, which bounds its memory.

    `prior` (share of the views) weighs the groups that a relational rule takes as background.
    """

    def one(quantity: tuple) -> Array:
        found = []
        for rule, q, s, h in zip(CLASSIFICATION_RULES, quantity, samples, bandwidth, strict=True):
            found.append(
                relational_log_likelihood(q, s, h, prior) if rule.relational
                else group_log_likelihood(q[None], s, h)[0]
            )
        return jnp.stack(found)

    return jnp.moveaxis(jax.lax.map(one, measured, batch_size=REGIONS_AT_ONCE), 0, 1)
