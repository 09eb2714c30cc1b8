"""Original edge relationship: the work model of rules L5 and A7 (Ikeuchi 1987, sec. 2.1.3).

"The edge information is described by the starting position and the ending position. These positions are denoted
relative to the mass center of the face and the maximum inertia direction": the face frame, [mm] on the face, in which a
region gives the same edges however its face is tilted and turned. The maximum inertia direction is known up to a half
turn, and so are the edges; they are what tells the two apart (see `edge_support`).

Here the edges are found, on the host, and laid back into an image.
"""

from typing import NamedTuple

import cv2
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from itree_jax.features.edge_support import search_half_width, segments_on_image
from itree_jax.features.inertia import face_inertia, mean_normal
from itree_jax.features.rectify import affine_T, gradient_space
from itree_jax.features.straight_edges import straight_edges
from itree_jax.features.window import Window

MOST = 8  # edges kept per region: the straight edges of a box face and of a slot in it
RIM = 2  # [px] an edge on the region's rim lies up to one pixel outside, and noise takes one pixel off the region


class Edge(NamedTuple):
    """One prominent edge, in the face frame. Which end comes first has no meaning."""

    start: Float[np.ndarray, "2"]  # (x, y) [mm], x along the maximum inertia direction
    end: Float[np.ndarray, "2"]
    strength: float  # 0..1, mean along the edge


class FaceFrame(NamedTuple):
    """Where the face frame of a region lies in its window."""

    T: Float[jax.Array, "2 2"]  # image offsets to face coordinates
    centroid: Float[jax.Array, "2"]  # mass centre (x, y) [mm] in the image plane, from the window's centre
    alpha: Float[jax.Array, ""]  # maximum inertia direction [rad] in face axes, or the opposite one


@jax.jit
def face_frame(window: Window) -> FaceFrame:
    """T at the region's mean normal, its mass centre and maximum inertia direction."""
    inertia = face_inertia(window)
    return FaceFrame(affine_T(*gradient_space(mean_normal(window))), inertia.centroid, inertia.alpha)


def prominent_edges(edges: Float[np.ndarray, "s s 2"], window: Window, most: int = MOST) -> tuple[Edge, ...]:
    """The straight edges inside a region or on its rim, those with the largest length times strength first.

    Args:
        edges: edge map of the window (see `edges.EdgeMap`).
        window: one region.
        most: so many edges at most.
    """
    mask, pitch = np.asarray(window.mask), np.asarray(window.pitch, np.float32)
    if not mask.any():
        return ()
    near = cv2.dilate(mask.astype(np.uint8), np.ones((2 * RIM + 1, 2 * RIM + 1), np.uint8)) > 0
    found = straight_edges(np.where(near[..., None], np.asarray(edges), 0.0), most)
    frame = face_frame(Window(jnp.asarray(mask), jnp.asarray(window.normals), jnp.asarray(pitch)))
    ends = np.array([e.ends for e in found], np.float32).reshape(-1, 2)
    on_face = _on_face(ends, frame, pitch, mask.shape[0]).reshape(-1, 2, 2)
    return tuple(Edge(start, end, e.strength) for (start, end), e in zip(on_face, found, strict=True))


def edge_table(edges: tuple[Edge, ...], most: int = MOST) -> Float[np.ndarray, "most 4"]:
    """Start and end (x, y, x, y) [mm] of the first `most` edges, filled up with zeros: what `edge_support` takes."""
    table = np.zeros((most, 4), np.float32)
    for row, edge in zip(table, edges, strict=False):
        row[:] = *edge.start, *edge.end
    return table


def on_image(
    edges: tuple[Edge, ...],
    T: Float[np.ndarray, "2 2"],
    centroid: Float[np.ndarray, "2"],
    alpha: float,
    pitch: float,
    size: int,
) -> Float[np.ndarray, "k 4"]:
    """Start and end (x, y, x, y) [px] of the edges in a window of an observed region, under a supposed direction.

    "A position is converted into the position on the image plane using the affine matrix" (sec. 2.1.3). For the
    arguments see `edge_support.segments_on_image`.
    """
    alpha_, pitch_ = jnp.float32(alpha), jnp.float32(pitch)
    table = jnp.asarray(edge_table(edges, len(edges)))
    return np.asarray(segments_on_image(table, jnp.asarray(T), jnp.asarray(centroid), alpha_, pitch_, size))


def search_areas(placed: Float[np.ndarray, "k 4"], centre: Float[np.ndarray, "2"]) -> Float[np.ndarray, "k 4 2"]:
    """Corners (x, y) [px], in order around it, of the area that is searched for each edge of `on_image`.

    `centre` is the mass centre in pixels; half widths are those of `edge_support.search_half_width`.
    """
    half_width = np.asarray(search_half_width(jnp.asarray(placed, jnp.float32), jnp.asarray(centre, jnp.float32)))
    start, end = placed[:, :2], placed[:, 2:]
    along = end - start
    length = np.linalg.norm(along, axis=1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1) * (half_width / np.where(length > 0, length, 1.0))[:, None]
    return np.stack([start + across, end + across, end - across, start - across], axis=1)


def _on_face(
    uv: Float[np.ndarray, "n 2"], frame: FaceFrame, pitch: Float[np.ndarray, ""], size: int
) -> Float[np.ndarray, "n 2"]:
    """Window pixels to the face frame [mm]."""
    T, centroid, alpha = map(np.asarray, frame)
    c, s = np.cos(alpha), np.sin(alpha)
    back = np.array([[c, s], [-s, c]], np.float32)
    offset = (uv - np.float32((size - 1) / 2)) * pitch - centroid
    return (offset @ (back @ T).T).astype(np.float32)
