"""All work models of one region in one call, and of a batch of regions in one compiled function."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from itree_jax.features.characteristics import CHARACTERISTICS, characteristic_shares, characteristics
from itree_jax.features.egi import (
    egi_mass_centre,
    extended_gaussian_image,
    spread_patches,
    spread_places,
    surface_area,
    visible_cells,
)
from itree_jax.features.inertia import FaceInertia, face_inertia, mean_normal
from itree_jax.features.outline import outline
from itree_jax.features.polar import RIM, face_angle, polar_map, polar_place, strongest
from itree_jax.features.rectify import affine_T, face_axes, gradient_space
from itree_jax.features.relation import BROTHER_FIELDS, MOST_BROTHERS
from itree_jax.features.window import Window
from itree_jax.kept_functions import kept

# Regions measured at once: bounds the memory of the EGI's weights (0.4 MB a region) whatever the number of regions.
REGIONS_AT_ONCE = 8
MOST_EDGE_PIXELS = 192  # a region of this window has a border of some hundred pixels
MOST_PATCHES = 256  # of its surface whose characteristic is mapped
NEEDLE_STD = 0.035  # [rad]: two degrees, what interreflection does to half the needles of a bin


class RegionFeatures(NamedTuple):
    """Work models of one region, in the frame of its viewing ray; a batch has a leading axis on every field."""

    inertia: FaceInertia
    outline: Float[Array, "64"]  # d(theta) [mm], theta from the direction of the larger moment
    egi: Float[Array, "264"]  # [mm^2] per cell of `visible_cells()`
    mass_centre: Float[Array, "3"]  # EGI mass centre
    mean_normal: Float[Array, "3"]  # unit, toward the viewer
    normal_scatter: Float[Array, "2"]  # falling variances of the normals in the plane across the mean normal [rad^2]
    area: Float[Array, ""]  # [mm^2] of surface, pixel by pixel
    shares: Float[Array, "5"]  # of the surface, per surface characteristic
    characteristic_map: Float[Array, "5 32 5"]  # [mm^2] per polar cell and characteristic
    edge_map: Float[Array, "5 32 3"]  # edge length [mm] per polar cell, and times (cos, sin) of twice its direction
    brothers: Float[Array, "4 6"]  # other regions beside it, see `relation`; zeros until `with_brothers` puts them in


def measure(
    window: Window, edges: Float[Array, "s s 2"] | None = None, needle_std: float | Float[Array, ""] = NEEDLE_STD
) -> RegionFeatures:
    """The work models of one region. An empty region gives zeros, with a frontal mean normal.

    Args:
        window: the region.
        edges: edge map of the whole window (`edges.edge_map`), on the region and off it; none: no edges.
        needle_std: by how much a needle may err under the sensor [rad]; the same for model views and image regions.
    """
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
        **where_things_lie(window, edges, needle_std, areas, inertia, p, q),
        brothers=jnp.zeros((MOST_BROTHERS, BROTHER_FIELDS), normals.dtype),
    )


def where_things_lie(
    window: Window, edges: Float[Array, "s s 2"] | None, needle_std: float | Float[Array, ""],
    areas: Float[Array, "n"], inertia: FaceInertia, p: Float[Array, ""], q: Float[Array, ""],
) -> dict[str, Array]:
    """Surface characteristics and edges in polar cells round the mass centre, from the inertia direction."""
    mask, pitch = jnp.asarray(window.mask), jnp.asarray(window.pitch)
    radius, angle = polar_place(window, affine_T(p, q), inertia.centroid, inertia.alpha)
    member = characteristics(window, jnp.asarray(needle_std, areas.dtype))
    kinds = member.reshape(-1, len(CHARACTERISTICS))
    patch = spread_places(areas, MOST_PATCHES)
    weight = kinds[patch] * areas[patch, None] * (jnp.sum(areas) / jnp.maximum(jnp.sum(areas[patch]), 1e-6))
    drawn = jnp.zeros((*mask.shape, 2), areas.dtype) if edges is None else jnp.asarray(edges)
    drawn = jnp.where(grown(mask, RIM)[..., None], drawn, 0.0).reshape(-1, 2)
    squared = jnp.sum(drawn**2, axis=-1)
    strength = jnp.where(squared > 0, jnp.sqrt(jnp.where(squared > 0, squared, 1.0)), 0.0)
    index, edge = strongest(drawn, strength, MOST_EDGE_PIXELS)
    # directions against the radius turn with the part, so that its rotation only moves them to other cells
    twice = 2.0 * (face_angle(edge, p, q) - inertia.alpha - angle[index])
    length = strength[index] * pitch
    lines = length[:, None] * jnp.stack([jnp.ones_like(twice), jnp.cos(twice), jnp.sin(twice)], axis=-1)
    return {
        "shares": characteristic_shares(member, window),
        "characteristic_map": polar_map(radius[patch], angle[patch], weight),
        "edge_map": polar_map(radius[index], angle[index], lines),
    }


def grown(mask: Array, by: int) -> Array:
    """The mask and `by` pixels round it."""
    side = 2 * by + 1
    return jax.lax.reduce_window(mask, False, jax.lax.bitwise_or, (side, side), (1, 1), "SAME")


@kept()
def measure_batch(
    windows: Window, edges: Float[Array, "n s s 2"] | None = None, needle_std: float | Float[Array, ""] = NEEDLE_STD
) -> RegionFeatures:
    """`measure` of a batch of regions (leading axis on every field), `REGIONS_AT_ONCE` at a time."""
    mask, normals, pitch = windows
    window = Window(jnp.asarray(mask), jnp.asarray(normals), jnp.asarray(pitch))
    batch = (window, None if edges is None else jnp.asarray(edges))
    return jax.lax.map(lambda item: measure(item[0], item[1], needle_std), batch, batch_size=REGIONS_AT_ONCE)


def with_brothers(features: RegionFeatures, found: Float[np.ndarray, "n most fields"]) -> RegionFeatures:
    """Features (host arrays) with the regions beside each, as `relation.brothers` gives them."""
    return features._replace(brothers=np.asarray(found, np.float32))


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
