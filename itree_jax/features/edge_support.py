"""Whether an image shows the edges of a work model where one supposed attitude puts them (Ikeuchi 1987, sec. 3.3).

The tree "only examines the existence of the edge distribution whose direction agrees, at the place where one of the two
rotations is supposed to make" it: no edges are extracted from the image, only its edge map is looked up.
"""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from itree_jax.features.bilinear import bilinear
from itree_jax.features.rectify import inverse_T

# Each of the two edge maps (the work model's, the image's) puts an edge on a whole pixel: half a pixel off, twice.
PLACEMENT = 1.0  # [px]
# The mass centre moves by half a pixel when a shadow or the limit of slant takes a strip of one pixel off one side.
CENTRE_STD = 0.5  # [px]
# The direction of the larger moment of a region with a rim of a pixel's uncertainty, 30 px long: 1/30 rad.
DIRECTION_STD = 0.035  # [rad]
STDS = 2.0  # 95 % of the edges lie inside the search area
ALONG = 32  # places looked up along an edge: one a pixel on most windows
ACROSS = 13  # and across its search area: less than a pixel apart up to a half width of 6 px


def segments_on_image(
    segments: Float[Array, "k 4"],
    T: Float[Array, "2 2"],
    centroid: Float[Array, "2"],
    alpha: Float[Array, ""],
    pitch: Float[Array, ""],
    size: int,
) -> Float[Array, "k 4"]:
    """Start and end (x, y, x, y) [px] in a window of `size` pixels of segments in the face frame [mm].

    Args:
        segments: start and end (x, y, x, y) [mm] relative to the mass centre and the maximum inertia direction.
        T: affine matrix of the region; its inverse foreshortens the segments.
        centroid: mass centre (x, y) [mm] in the image plane, from the window's centre.
        alpha: supposed direction [rad] of the face frame's first axis in face axes: that of the larger moment, or the
            opposite one.
        pitch: size of a window pixel [mm].
        size: side of the window [px].
    """
    c, s = jnp.cos(alpha), jnp.sin(alpha)
    turn = jnp.stack([jnp.stack([c, -s]), jnp.stack([s, c])])
    ends = segments.reshape(-1, 2) @ (inverse_T(T) @ turn).T + centroid[None, :]
    return (ends / pitch + (size - 1) / 2.0).reshape(-1, 4)


def search_half_width(on_image: Float[Array, "k 4"], centre: Float[Array, "2"]) -> Float[Array, "k"]:
    """Half the width [px] of the area that is searched for each edge, from the pixel size and from how well the mass
    centre and the direction are known. An edge far from the mass centre `centre` [px] moves more with the direction.
    """
    middle = (on_image[:, :2] + on_image[:, 2:]) / 2.0
    arm_squared = jnp.sum((middle - centre[None, :]) ** 2, axis=1)
    return PLACEMENT + STDS * jnp.sqrt(CENTRE_STD**2 + DIRECTION_STD**2 * arm_squared)


def edge_support(
    edges: Float[Array, "s s 2"],
    segments: Float[Array, "k 4"],
    T: Float[Array, "2 2"],
    centroid: Float[Array, "2"],
    alpha: Float[Array, ""],
    pitch: Float[Array, ""],
) -> Float[Array, "k"]:
    """Share of the length of each stored edge along which the image has an edge of its direction in its search area.

    The response at a place is the strength there times cos^2 of the angle between the directions; the largest across
    the search area counts. Segments of length 0, which fill up a table, get 0.

    Args:
        edges: edge map of a window (see `edges.EdgeMap`).
        segments: work model, start and end (x, y, x, y) [mm] in the face frame.
        T, centroid, alpha, pitch: of the observed region, with a supposed `alpha` (see `segments_on_image`).
    """
    size = edges.shape[0]
    placed = segments_on_image(segments, T, centroid, alpha, pitch, size)
    widths = search_half_width(placed, centroid / pitch + (size - 1) / 2.0)
    return jax.vmap(lambda segment, width: _support(edges, segment, width))(placed, widths)


def _support(
    edges: Float[Array, "s s 2"], segment: Float[Array, "4"], half_width: Float[Array, ""]
) -> Float[Array, ""]:
    """Of one segment in window pixels."""
    start, along = segment[:2], segment[2:] - segment[:2]
    squared = jnp.sum(along**2)
    there = squared > 0
    tangent = along / jnp.sqrt(jnp.where(there, squared, 1.0))
    normal = jnp.stack([-tangent[1], tangent[0]])
    t = ((jnp.arange(ALONG, dtype=segment.dtype) + 0.5) / ALONG)[:, None, None]
    across = jnp.linspace(-1.0, 1.0, ACROSS, dtype=segment.dtype)[None, :, None]
    places = start[None, None] + t * along[None, None] + across * half_width * normal[None, None]
    c, s = (bilinear(edges[..., k], places[..., 0], places[..., 1]) for k in range(2))
    # strength cos^2(difference) = (strength + strength cos(2 difference)) / 2, the latter an inner product
    strength_squared = c**2 + s**2
    found = strength_squared > 0
    strength = jnp.where(found, jnp.sqrt(jnp.where(found, strength_squared, 1.0)), 0.0)
    agreement = c * (tangent[0] ** 2 - tangent[1] ** 2) + s * (2.0 * tangent[0] * tangent[1])
    response = (strength + agreement) / 2.0
    # By its place, not by its value: the derivative of a maximum asks which values equal it, and compiled code that
    # computes them twice may round them differently.
    largest = jnp.argmax(response, axis=1)[:, None]
    return jnp.where(there, jnp.mean(jnp.take_along_axis(response, largest, axis=1)), 0.0)
