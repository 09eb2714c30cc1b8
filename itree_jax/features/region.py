"""All work models of one region in one call, and of a batch of regions in one compiled function."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from itree_jax.features.egi import (
    egi_mass_centre,
    extended_gaussian_image,
    spread_patches,
    surface_area,
    visible_cells,
)
from itree_jax.features.inertia import FaceInertia, face_inertia, mean_normal
from itree_jax.features.outline import outline
from itree_jax.features.rectify import affine_T, face_axes, gradient_space
from itree_jax.features.window import Window

# Regions measured at once: bounds the memory of the EGI's weights (0.4 MB a region) whatever the number of regions.
REGIONS_AT_ONCE = 8


class RegionFeatures(NamedTuple):
    """Work models of one region, in the frame of its viewing ray; a batch has a leading axis on every field."""

    inertia: FaceInertia
    outline: Float[Array, "64"]  # d(theta) [mm], theta from the direction of the larger moment
    egi: Float[Array, "264"]  # [mm^2] per cell of `visible_cells()`
    mass_centre: Float[Array, "3"]  # EGI mass centre
    mean_normal: Float[Array, "3"]  # unit, toward the viewer
    normal_scatter: Float[Array, "2"]  # falling variances of the normals in the plane across the mean normal [rad^2]
    area: Float[Array, ""]  # [mm^2] of surface, pixel by pixel


def measure(window: Window) -> RegionFeatures:
    """The work models of one region. An empty region gives zeros, with a frontal mean normal."""
    normal = mean_normal(window)
    p, q = gradient_space(normal)
    inertia = face_inertia(window)
    mask, pitch = jnp.asarray(window.mask).reshape(-1), jnp.asarray(window.pitch)
    normals = jnp.asarray(window.normals).reshape(-1, 3)
    areas = surface_area(normals, mask, pitch)
    cells = jnp.asarray(visible_cells(), dtype=normals.dtype)
    return RegionFeatures(
        inertia=inertia,
        outline=outline(window, affine_T(p, q), inertia.centroid, inertia.alpha),
        egi=extended_gaussian_image(*spread_patches(normals, areas), cells),
        mass_centre=egi_mass_centre(normals, areas),
        mean_normal=normal,
        normal_scatter=normal_scatter(normals, areas > 0, p, q),
        area=jnp.sum(areas),
    )


@jax.jit
def measure_batch(windows: Window) -> RegionFeatures:
    """`measure` of a batch of regions (leading axis on every field), `REGIONS_AT_ONCE` at a time."""
    return jax.lax.map(measure, Window(*map(jnp.asarray, windows)), batch_size=REGIONS_AT_ONCE)


def normal_scatter(
    normals: Float[Array, "n 3"], mask: Array, p: Float[Array, ""], q: Float[Array, ""]
) -> Float[Array, "2"]:
    """Falling variances of the normals along two axes across the mean normal: (0, 0) plane, (s, 0) cylinder."""
    e1, e2 = face_axes(p, q)
    m = mask.astype(normals.dtype)
    count = jnp.maximum(jnp.sum(m), 1.0)
    across = normals @ jnp.stack([e1, e2], axis=1)
    centred = (across - (m @ across / count)[None, :]) * m[:, None]
    scatter = centred.T @ centred / count
    half = (scatter[0, 0] + scatter[1, 1]) / 2.0
    squared = ((scatter[0, 0] - scatter[1, 1]) / 2.0) ** 2 + scatter[0, 1] ** 2
    positive = squared > 0
    root = jnp.where(positive, jnp.sqrt(jnp.where(positive, squared, 1.0)), 0.0)  # sqrt has no derivative at 0
    return jnp.stack([half + root, jnp.maximum(half - root, 0.0)])
