"""The determination part at run time: candidate attitudes of every region, in one compiled call."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from itree_jax.features.region import RegionFeatures
from itree_jax.tree.determination import appearance_arrays
from itree_jax.tree.determination_rules import (
    AppearanceArrays,
    Candidates,
    DeterminationScales,
    egi_candidates,
    shape_candidates,
)
from itree_jax.tree.tree import InterpretationTree


class DeterminationArrays(NamedTuple):
    """The tree's appearances as determination reads them."""

    base: AppearanceArrays  # one rotation per viewer direction: rules A1, A4, A5
    base_row: Int[Array, "base"]  # their rows in `rows`
    rows: AppearanceArrays  # view x roll: rule A2
    scales: DeterminationScales


def determination_arrays(tree: InterpretationTree) -> DeterminationArrays:
    group = tree.groups.group_of_view
    base, index = appearance_arrays(tree.appearances, group, tree.rolls, base_only=True)
    rows, _ = appearance_arrays(tree.appearances, group, tree.rolls, base_only=False)
    scales = DeterminationScales(*(jnp.float32(s) for s in tree.determination.scales))
    return DeterminationArrays(base, jnp.asarray(index, jnp.int32), rows, scales)


@partial(jax.jit, static_argnames=("by_shape", "by_egi"))
def determine(
    features: RegionFeatures,
    group_log_probability: Float[Array, "regions groups"],
    arrays: DeterminationArrays,
    by_shape: int,
    by_egi: int,
) -> Candidates:
    """The best attitudes of every region: `by_shape` from A1, A4 and A5, then `by_egi` from A1 and A2.

    Both lists go on, because the first is sharper on whole regions and the second holds on regions that were cut.
    Returns candidates [regions, by_shape + by_egi] in the frame of each region's viewing ray, `row` an index into the
    tree's appearances.
    """
    by_shape = min(by_shape, arrays.base.area.shape[0])
    by_egi = min(by_egi, arrays.rows.area.shape[0])

    def one(item):
        f, prior = item
        a = shape_candidates(f, arrays.base, prior, arrays.scales, by_shape)
        a = a._replace(row=arrays.base_row[a.row])
        b = egi_candidates(f, arrays.rows, prior, arrays.scales, by_egi)
        return Candidates(*(jnp.concatenate(pair) for pair in zip(a, b, strict=True)))

    return jax.lax.map(one, (features, group_log_probability), batch_size=4)


def remaining_freedom(rotations_left: int) -> str:
    """What determination leaves open, in words."""
    return {0: "rotation open", 1: "unique"}.get(rotations_left, f"{rotations_left} rotations")


