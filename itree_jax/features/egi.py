"""Extended Gaussian image: surface area over surface orientation (Ikeuchi 1987, sec. 2.1.3), rules L3, A1 and A2.

Cells: the three-frequency dome (540 cells, 8.7 degrees across). Of the geodesic tessellations it is the one the views
are sampled on already, its cells are about the size of the needle map's 90 % error on plastic, and it has all 60 turns
of the icosahedron as exact symmetries and an opposite to every cell.

Binning is soft: a normal shares its mass among the cells with von Mises-Fisher weights that sum to 1, so mass is kept
exactly and the image is differentiable in the normals.
"""

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int

from itree_jax.tree.dome import dome

FREQUENCY = 3
# Angular width of the weights [rad]: half a cell. Narrower ones make the image jump as a normal crosses a cell border.
WIDTH = 0.5 * float(np.sqrt(4.0 * np.pi / (60 * FREQUENCY**2)))
# Pixels beyond 84 degrees of slant are noise of the normal; their area is not allowed to grow without limit.
LEAST_COS_SLANT = 0.1
# Patches of a region that are binned: each costs 264 exponentials, and hundreds fill the few cells of a region.
MOST_PATCHES = 384


def egi_cells() -> Float[np.ndarray, "540 3"]:
    """Unit directions of all cells over the sphere."""
    return dome(FREQUENCY).directions.astype(np.float32)


def visible_cells() -> Float[np.ndarray, "264 3"]:
    """Unit directions of the cells toward the viewer (z < 0), on which regions are measured; 12 lie on the rim."""
    cells = egi_cells()
    return cells[cells[:, 2] < -1e-6]


def surface_area(normals: Float[Array, "*n 3"], mask: Bool[Array, "*n"], pitch: Float[Array, ""]) -> Float[Array, "*n"]:
    """Surface [mm^2] that each pixel of the region shows: pixel area over the cosine of its slant; 0 off the region."""
    return jnp.where(mask, pitch**2 / jnp.maximum(-normals[..., 2], LEAST_COS_SLANT), 0.0)


def extended_gaussian_image(
    normals: Float[Array, "n 3"], areas: Float[Array, "n"], cells: Float[Array, "cells 3"]
) -> Float[Array, "cells"]:
    """Mass [mm^2] of every cell: the areas of surface patches, shared among the cells around their unit normals."""
    concentration = 1.0 / WIDTH**2
    weights = jnp.exp(concentration * (normals @ cells.T - 1.0))
    total = jnp.sum(weights, axis=1)
    usable = (areas > 0) & (total > 0)
    return jnp.where(usable, areas / jnp.where(usable, total, 1.0), 0.0) @ weights


def spread_patches(
    normals: Float[Array, "n 3"], areas: Float[Array, "n"], most: int = MOST_PATCHES
) -> tuple[Float[Array, "k 3"], Float[Array, "k"]]:
    """At most `most` of the patches that have area, evenly spread in their order; areas scaled so that the sum is kept.

    All of them (and nothing else) where there are no more.
    """
    if len(areas) <= most:
        return normals, areas
    index = spread_places(areas, most)
    chosen = areas[index]
    total = jnp.sum(chosen)
    return normals[index], chosen * jnp.sum(areas) / jnp.where(total > 0, total, 1.0)


def spread_places(areas: Float[Array, "n"], most: int) -> Int[Array, "k"]:
    """Indices of at most `most` patches that have area, evenly spread in their order; the rest are of one that has
    none."""
    most = min(most, len(areas))
    count = jnp.sum(areas > 0)
    kept = jnp.minimum(count, most)
    place = jnp.arange(most)
    wanted = 1 + ((2 * place + 1) * count) // (2 * jnp.maximum(kept, 1))  # ranks 1..count, each at most once
    index = jnp.minimum(jnp.searchsorted(jnp.cumsum(areas > 0), wanted), len(areas) - 1)
    return jnp.where(place < kept, index, jnp.argmin(areas))


def egi_mass_centre(normals: Float[Array, "n 3"], areas: Float[Array, "n"]) -> Float[Array, "3"]:
    """Mass centre of the EGI: the mean normal by surface area; 0 for a closed surface, on the sphere for a plane.

    Taken from the normals themselves, so that the width of the cells does not pull it inward.
    """
    total = jnp.sum(areas)
    return areas @ normals / jnp.where(total > 0, total, 1.0)
