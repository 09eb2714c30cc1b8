"""What determination reads of the tree: its appearances as arrays, and how far true attitudes leave each comparison."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

# A region that was cut lies about its direction, outline and size: none of them counts for more than this (2.8 sigma).
MOST_PENALTY = 4.0


class AppearanceArrays(NamedTuple):
    """Rows of `Appearances` as determination reads them (padded rows have area 0)."""

    R_cam_obj: Float[Array, "rows 3 3"]
    group: Int[Array, "rows"]
    area: Float[Array, "rows"]
    mean_normal: Float[Array, "rows 3"]
    concentration: Float[Array, "rows"]  # length of the EGI mass centre
    egi: Float[Array, "rows cells"]
    inertia: Float[Array, "rows 4"]
    outline: Float[Array, "rows n_theta"]
    centroid_obj: Float[Array, "rows 3"]
    brothers: Float[Array, "rows most fields"]
    characteristic_map: Float[Array, "rows radii angles 5"]  # half precision
    edge_map: Float[Array, "rows radii angles 3"]  # half precision
    uses: Float[Array, "groups 8"]  # 1 where the group's steps use the rule, columns A1..A8


class DeterminationScales(NamedTuple):
    """Spread of what a true attitude leaves, measured on noisy draws."""

    tilt: Float[Array, ""]  # of the mean normal [rad]: the dome's cells and A1's error
    direction: Float[Array, ""]  # of A4's direction [rad]
    outline: Float[Array, ""]  # of A5's relative distance
    size: Float[Array, ""]  # of log lengths
    egi: Float[Array, ""]  # of the share of mass that A2 finds elsewhere
    least_uniqueness: Float[Array, ""]  # below it a region has no inertia direction
    relation: Float[Array, ""]  # of A3's direction toward a brother [rad]
    characteristic: Float[Array, ""]  # of A6's lack of agreement, 0..1
    edges: Float[Array, ""]  # of A7's
    both: Float[Array, ""]  # of A8's
    concentration: Float[Array, ""]  # of the length of A1's mass centre


def take_rows(rows: AppearanceArrays, index: Int[Array, "n"]) -> AppearanceArrays:
    """Some of the appearances."""
    return AppearanceArrays(*[values[index] for values in rows[:-1]], uses=rows.uses)


def bounded(deviation: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Penalty of a deviation in its own scale, as of a Gaussian with outliers."""
    return jnp.minimum(0.5 * deviation**2, MOST_PENALTY)


def wrapped(angle: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """The same angle in -pi..pi."""
    return angle - 2.0 * jnp.pi * jnp.round(angle / (2.0 * jnp.pi))
