"""Where on its face a region is planar, cylindrical, ...: rules L7, A6 and A8 (Ikeuchi 1987, sec. 3.4 and 5.2).

Each connected piece of one characteristic is kept as "the rectangular existence area whose vertices are referenced to
the coordinate of the mass center and the maximum inertia direction". On an image the rectangle becomes a polygon
through the inverse of T, and is examined for the supposed characteristic.

The direction of the larger moment is known up to a half turn: give `areas_on_image` alpha and alpha + pi to try both.
"""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int

from itree_jax.features.characteristics import CHARACTERISTICS, characteristics
from itree_jax.features.egi import surface_area
from itree_jax.features.inertia import FaceInertia, face_inertia, mean_normal
from itree_jax.features.rectify import affine_T, gradient_space
from itree_jax.features.window import Window

MOST_AREAS = 6  # per region: with creases between them, hardly more pieces of some size fit into a window of 48 pixels
LEAST_SHARE = 0.05  # of the region's surface: a smaller piece comes and goes with the noise of its boundary
LEAST_PIXELS = 12  # a piece of fewer pixels has no rectangle to speak of: with its border the fit needs 3 x 3


class CharacteristicArea(NamedTuple):
    """One connected piece of a region with one surface characteristic."""

    characteristic: int  # index in CHARACTERISTICS
    vertices: Float[np.ndarray, "4 2"]  # of the rectangle [mm] on the face: along and across the larger moment
    area: float  # surface of the piece [mm^2]
    support: float  # `area_support` of the rectangle on this very region: what an image of the same can reach at best


def characteristic_areas(
    window: Window,
    needle_std: float,
    most: int = MOST_AREAS,
    least_share: float = LEAST_SHARE,
) -> list[CharacteristicArea]:
    """The pieces of one region that have one characteristic, the largest first; none for an empty region.

    A piece is an 8-connected set of pixels whose likeliest characteristic is the same; its rectangle is the smallest
    (of any direction) around its pixels on the face. Creases belong to no piece.

    Args:
        window: one region.
        needle_std: see `characteristics`.
        most: how many pieces are kept.
        least_share: surface of the smallest piece that is kept, as a share of the region's.
    """
    memberships, surface, inertia, T = jax.tree.map(np.asarray, _measured(window, needle_std))
    pitch = float(np.asarray(window.pitch))
    likeliest = np.where(memberships.sum(axis=-1) > 0, memberships.argmax(axis=-1), -1)
    least = max(least_share * float(surface.sum()), 1e-9)
    pieces = [
        (float(surface[piece].sum()), c, piece)
        for c in range(len(CHARACTERISTICS))
        for piece in _connected(likeliest == c)
        if piece.sum() >= LEAST_PIXELS and surface[piece].sum() >= least
    ]
    found = []
    for area, c, piece in sorted(pieces, key=lambda each: -each[0])[:most]:
        bare = CharacteristicArea(c, _rectangle(piece, pitch, T, inertia), area, 0.0)
        (polygon,) = areas_on_image([bare], T, inertia.centroid, float(inertia.alpha), pitch, len(piece))
        found.append(bare._replace(support=float(_support(memberships, polygon, c))))
    return found


def areas_on_image(
    areas: Sequence[CharacteristicArea],
    T: Float[np.ndarray, "2 2"],
    centroid: Float[np.ndarray, "2"],
    alpha: float,
    pitch: float,
    size: int,
) -> Float[np.ndarray, "n 4 2"]:
    """Vertices (x, y) [px] of the areas in the window of a region, 0 at the centre of the first pixel.

    Args:
        areas: as `characteristic_areas` gives them.
        T: affine matrix of the region.
        centroid: its mass centre (x, y) [mm] in the image plane, from the window's centre.
        alpha: direction of its larger moment [rad] in face axes, or the opposite one.
        pitch: size of a pixel of the window [mm].
        size: side of the window [px].
    """
    on_face = np.array([a.vertices for a in areas], dtype=np.float32).reshape(-1, 4, 2) @ _turn(alpha).T
    in_image = np.linalg.solve(T, on_face[..., None])[..., 0] + centroid
    return (in_image / pitch + (size - 1) / 2.0).astype(np.float32)


def area_support(
    memberships: Float[Array, "s s 5"], polygon: Float[Array, "4 2"], characteristic: Int[Array, ""] | int
) -> Float[Array, ""]:
    """Share of a polygon's area on the image that has the supposed characteristic, 0..1.

    What of the polygon lies off the region, at a crease or outside the window has no characteristic. Zero for a polygon
    without area.

    Args:
        memberships: `characteristics` of the region on the image.
        polygon: vertices (x, y) [px] of a parallelogram, in order, as `areas_on_image` gives them.
        characteristic: index in CHARACTERISTICS.
    """
    x, y = polygon[:, 0], polygon[:, 1]
    signed_area = jnp.sum(x * jnp.roll(y, -1) - y * jnp.roll(x, -1)) / 2.0
    area = jnp.abs(signed_area)
    has = jnp.take(memberships, characteristic, axis=-1)
    found = jnp.sum(_coverage(polygon, jnp.sign(signed_area), len(has)) * has)
    return jnp.where(area > 0, jnp.minimum(found / jnp.where(area > 0, area, 1.0), 1.0), 0.0)


def _coverage(polygon: Float[Array, "4 2"], sense: Float[Array, ""], size: int) -> Float[Array, "s s"]:
    """How much of every pixel a parallelogram covers, 0..1: exact for sides along the rows, within 0.1 for others."""
    edge = jnp.roll(polygon, -1, axis=0) - polygon
    length = jnp.sqrt(jnp.sum(edge**2, axis=-1))
    unit = edge / jnp.where(length > 0, length, 1.0)[:, None]
    along = jnp.arange(size, dtype=polygon.dtype)
    dx = along[None, None, :] - polygon[:, 0, None, None]
    dy = along[None, :, None] - polygon[:, 1, None, None]
    inward = sense * (unit[:, 0, None, None] * dy - unit[:, 1, None, None] * dx)  # distance from each side [px]
    within = jnp.clip(inward + 0.5, 0.0, 1.0)
    # Opposite sides together, so that a strip thinner than a pixel covers its own width of it.
    strips = jnp.maximum(within[:2] + within[2:] - 1.0, 0.0)
    return strips[0] * strips[1]


_support = jax.jit(area_support)


@jax.jit
def _measured(
    window: Window, needle_std: Float[Array, ""] | float
) -> tuple[Float[Array, "s s 5"], Float[Array, "s s"], FaceInertia, Float[Array, "2 2"]]:
    """Memberships, surface [mm^2] of every pixel, face inertia and T of one region."""
    mask, normals, pitch = (jnp.asarray(field) for field in window)
    memberships = characteristics(window, jnp.asarray(needle_std, dtype=normals.dtype))
    T = affine_T(*gradient_space(mean_normal(window)))
    return memberships, surface_area(normals, mask, pitch), face_inertia(window), T


def _connected(mask: Bool[np.ndarray, "s s"]) -> list[Bool[np.ndarray, "s s"]]:
    """The 8-connected pieces of a mask."""
    count, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
    return [labels == k for k in range(1, count)]


def _rectangle(
    piece: Bool[np.ndarray, "s s"], pitch: float, T: Float[np.ndarray, "2 2"], inertia: FaceInertia
) -> Float[np.ndarray, "4 2"]:
    """Vertices [mm] of the smallest rectangle around the pixels of a piece, along and across the larger moment."""
    row, column = np.nonzero(piece)
    centres = np.stack([column, row], axis=-1) - (len(piece) - 1) / 2.0
    corners = (centres[:, None, :] + np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])).reshape(-1, 2)
    on_face = (corners * pitch - inertia.centroid) @ np.asarray(T).T @ _turn(float(inertia.alpha))
    return cv2.boxPoints(cv2.minAreaRect(on_face.astype(np.float32)))


def _turn(angle: float) -> Float[np.ndarray, "2 2"]:
    """Rotation of face axes by an angle [rad] from the first toward the second."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
