"""Determination by where things lie: A3 the brother regions, A6 the surface characteristics, A7 the edges, A8 both at
once (Ikeuchi 1987, sec. 2.2.1)."""

from itertools import product
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from itree_jax.features.polar import ANGLES, turn_correlation
from itree_jax.features.region import RegionFeatures
from itree_jax.features.relation import MOST_MISFIT, brother_angle, brother_misfit
from itree_jax.tree.appearance_rows import AppearanceArrays, DeterminationScales, bounded, wrapped


def relation_penalty(
    features: RegionFeatures, rows: AppearanceArrays, scales: DeterminationScales
) -> Float[Array, "rows turns"]:
    """A3: of the angle between the directions toward brothers, at each turn of the outline; of several brothers the one
    that fits best. None where a region or an appearance has no brother that could be the other's."""
    n_theta = rows.outline.shape[-1]
    step = jnp.arange(n_theta) * (2.0 * jnp.pi / n_theta)
    best = jnp.full((len(rows.area), n_theta), jnp.inf)
    for seen, stored in product(range(features.brothers.shape[0]), range(rows.brothers.shape[1])):
        misfit, apart = brothers_apart(features.brothers[seen], rows.brothers[:, stored])
        turn = jnp.abs(wrapped(apart[:, None] - step)) / scales.relation
        each = bounded(turn) + bounded(misfit)[:, None]
        best = jnp.minimum(best, jnp.where((misfit < MOST_MISFIT)[:, None], each, jnp.inf))
    return jnp.where(jnp.isfinite(best), best, 0.0)


def brothers_apart(
    seen: Float[Array, "fields"], stored: Float[Array, "*n fields"]
) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
    """Misfit of two brothers, directions left aside, and the angle [rad] from the stored one's to the seen one's."""
    misfit = brother_misfit(seen, stored, jnp.zeros((), bool))
    return misfit, brother_angle(seen) - brother_angle(stored)


class MapAgreement(NamedTuple):
    """How much edges and surface characteristics disagree with appearances', 0..1, at each turn of the outline."""

    characteristic: Float[Array, "rows turns"]  # A6
    edges: Float[Array, "rows turns"]  # A7
    both: Float[Array, "rows turns"]  # A8: edges where the characteristics are right


def compare_maps(features: RegionFeatures, rows: AppearanceArrays) -> MapAgreement:
    """One region against some appearances; a map that is empty agrees with nothing."""
    n_theta = rows.outline.shape[-1]
    finer = jnp.arange(n_theta) * (ANGLES / n_theta)
    below = jnp.floor(finer).astype(jnp.int32)
    share = finer - below

    def at_turns(correlation: Float[Array, "rows angles"]) -> Float[Array, "rows turns"]:
        return correlation[:, below] * (1.0 - share) + correlation[:, (below + 1) % ANGLES] * share

    kinds = at_turns(turn_correlation(features.characteristic_map, rows.characteristic_map.astype(jnp.float32)))
    edges = at_turns(turn_correlation(features.edge_map, rows.edge_map.astype(jnp.float32)))
    return MapAgreement(1.0 - kinds, 1.0 - edges, 1.0 - jnp.maximum(kinds, 0.0) * jnp.maximum(edges, 0.0))


def map_penalty(
    features: RegionFeatures, rows: AppearanceArrays, scales: DeterminationScales, at: Int[Array, "rows"]
) -> Float[Array, "rows"]:
    """Penalties of A3 and A6-A8 at given turns, of the rules that each row's group uses."""
    maps = compare_maps(features, rows)
    uses = rows.uses[rows.group]
    each = (
        (2, relation_penalty(features, rows, scales)), (5, bounded(maps.characteristic / scales.characteristic)),
        (6, bounded(maps.edges / scales.edges)), (7, bounded(maps.both / scales.both)),
    )  # fmt: skip
    at_turn = [uses[:, k] * jnp.take_along_axis(penalty, at[:, None], axis=1)[:, 0] for k, penalty in each]
    return jnp.sum(jnp.stack(at_turn), axis=0)
