"""Work models of every attitude group that relational rules compare regions with (Ikeuchi 1987, sec. 2.1.3).

The paper stores those of one representative attitude. A group spans tens of degrees and its shadows turn with the part,
so that a dozen of its appearances are kept as exemplars.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from itree_jax.features.polar import ANGLES, turn_correlation
from itree_jax.features.region import RegionFeatures
from itree_jax.features.relation import BROTHER_FIELDS, MOST_MISFIT, SIZE_SPREAD, THERE, brother_misfit
from itree_jax.kept_functions import on_device
from itree_jax.tree.appearances import STORED_BROTHERS, Appearances

EXEMPLARS = 24  # per group: the ten views that the paper's table has of one, at two rolls each and more
LEAST_UNIQUENESS = 0.15  # moments within 30 % of each other: noise of the boundary turns the direction at will
ALONE = 0.5  # what being alone counts for, in brothers: a region alone agrees with a group that shows one region
BROTHER_SIGMAS = 2.0  # width of a brother's likeness: an exemplar stands for views some degrees around it
TURN_TOLERANCE = 1  # cells that A4's direction may be off


class GroupModels(NamedTuple):
    """Exemplars of every group."""

    edge_map: Float[Array, "groups exemplars radii angles 3"]
    characteristic_map: Float[Array, "groups exemplars radii angles 5"]
    brothers: Float[Array, "groups exemplars most fields"]
    size: Float[Array, "groups exemplars"]  # of the exemplar's region: half the logarithm of its area
    unique: Bool[Array, "groups exemplars"]  # the exemplar has an inertia direction
    there: Bool[Array, "groups exemplars"]  # False: padding


def group_models(table: Appearances, group_count: int) -> GroupModels:
    """Exemplars spread evenly over each group's appearances (the largest region of each attitude)."""
    first = np.append(True, np.diff(table.attitude) > 0)
    group = table.group[table.attitude]
    rows = np.full((group_count, EXEMPLARS), -1)
    for g in range(group_count):
        own = np.flatnonzero(first & (group == g))
        if len(own):
            step = np.unique(np.linspace(0, len(own) - 1, EXEMPLARS).round().astype(int))
            rows[g, : len(step)] = own[step]
    there = rows >= 0
    shape = (*rows.shape, STORED_BROTHERS, BROTHER_FIELDS)
    beside = np.where(there[..., None, None], table.brothers[rows], 0.0).reshape(shape)
    return GroupModels(
        edge_map=on_device(table.edge_map[rows], np.float32),
        characteristic_map=on_device(table.characteristic_map[rows], np.float32),
        brothers=on_device(beside, np.float32),
        size=on_device(0.5 * np.log(np.maximum(table.area[rows], 1.0)), np.float32),
        unique=on_device(table.inertia[rows, 3] > LEAST_UNIQUENESS),
        there=on_device(there),
    )


def relation_agreement(features: RegionFeatures, models: GroupModels) -> Float[Array, "groups"]:
    """How well the regions beside one region are those that each group shows: 1 exactly .. 0 not at all.

    Brothers that are missing count against a group, and so do regions too many, as far as they could be a brother in
    any group: what lies beside a region in a bin belongs to other parts more often than not.
    """
    unique = models.unique & (features.inertia.uniqueness > LEAST_UNIQUENESS)
    misfit = brother_misfit(
        features.brothers[None, None, :, None], models.brothers[:, :, None], unique[..., None, None]
    )  # [groups, exemplars, seen, stored]
    own = (0.5 * jnp.log(jnp.maximum(features.area, 1.0)) - models.size) / SIZE_SPREAD
    alike = jnp.exp(-0.5 * (jnp.square(misfit) + jnp.square(own)[..., None, None]) / BROTHER_SIGMAS**2)
    alike = jnp.where((misfit < MOST_MISFIT) & models.there[..., None, None], alike, 0.0)
    seen = jnp.minimum(jnp.sum(jnp.max(alike, axis=(0, 1, 3))), STORED_BROTHERS)
    stored = jnp.sum(models.brothers[..., THERE], axis=-1)
    found = jnp.sum(jnp.max(alike, axis=-2), axis=-1)
    found = jnp.minimum(found, seen)  # one region may fit two that are as far away, and is but one of them
    agreement = (found + ALONE) / (0.5 * (stored + seen) + ALONE)
    return jnp.max(jnp.where(models.there, agreement, 0.0), axis=-1)


def edge_characteristic_agreement(features: RegionFeatures, models: GroupModels) -> Float[Array, "groups"]:
    """How well edges and surface characteristics lie as in each group, at one rotation for both: 0..1.

    Rotations are those that the inertia directions leave open, all of them where there is none.
    """
    edges = turn_correlation(features.edge_map, models.edge_map)
    kinds = turn_correlation(features.characteristic_map, models.characteristic_map)
    allowed = allowed_turns(models.unique & (features.inertia.uniqueness > LEAST_UNIQUENESS))
    joint = jnp.where(allowed, 0.5 * (edges + kinds), 0.0)
    best = jnp.max(joint, axis=-1)
    return jnp.max(jnp.where(models.there, best, 0.0), axis=-1)


def allowed_turns(unique: Bool[Array, "*n"]) -> Bool[Array, "*n angles"]:
    """Turns near 0 and a half, or all of them."""
    k = jnp.arange(ANGLES)
    half = ANGLES // 2
    near = jnp.minimum(k % half, half - k % half) <= TURN_TOLERANCE
    return near | ~unique[..., None]


def each_region(function, features: RegionFeatures, models: GroupModels) -> Float[Array, "regions groups"]:
    """An agreement of every region of a batch, a few at a time, which bounds its memory."""
    return jax.lax.map(lambda f: function(f, models), features, batch_size=8)
