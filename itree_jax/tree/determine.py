"""The determination part at run time: candidate attitudes of every region, in one compiled call."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from itree_jax.features.region import RegionFeatures
from itree_jax.kept_functions import kept, on_device
from itree_jax.tree.appearance_rows import AppearanceArrays, DeterminationScales
from itree_jax.tree.determination import appearance_arrays, rules_used
from itree_jax.tree.determination_rules import Candidates, egi_candidates, shape_candidates
from itree_jax.tree.tree import InterpretationTree


class DeterminationArrays(NamedTuple):
    """The tree's appearances as determination reads them."""

    rows: AppearanceArrays  # view x roll
    scales: DeterminationScales
    roll_step: float  # [rad]


def determination_arrays(tree: InterpretationTree) -> DeterminationArrays:
    rows = appearance_arrays(tree.appearances, rules_used(tree.determination.steps))
    scales = DeterminationScales(*(on_device(s, np.float32) for s in tree.determination.scales))
    return DeterminationArrays(rows, scales, 2.0 * np.pi / tree.rolls)


@kept("by_shape", "by_egi")
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
    count = arrays.rows.area.shape[0]
    by_shape, by_egi = min(by_shape, count), min(by_egi, count)

    def one(item):
        f, prior = item
        a = shape_candidates(f, arrays.rows, prior, arrays.scales, by_shape, arrays.roll_step)
        b = egi_candidates(f, arrays.rows, prior, arrays.scales, by_egi)
        return Candidates(*(jnp.concatenate(pair) for pair in zip(a, b, strict=True)))

    return jax.lax.map(one, (features, group_log_probability), batch_size=4)


def remaining_freedom(rotations_left: int) -> str:
    """What determination leaves open, in words."""
    return {0: "rotation open", 1: "unique"}.get(rotations_left, f"{rotations_left} rotations")


