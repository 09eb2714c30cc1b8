"""Original face inertia: the work model of rule L1 and A4 (Ikeuchi 1987, sec. 2.1.3 and 5.1, corrected).

Second moments of the region, mapped onto its face by T: I_xx = integral of m x'^2 dA' with dA' = det T dx dy.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from itree_jax.features.rectify import affine_T, gradient_space
from itree_jax.features.window import Window


class FaceInertia(NamedTuple):
    """Size and rough shape of the original face of one region; zeros for an empty region."""

    area: Float[Array, ""]  # [mm^2] on the face
    centroid: Float[Array, "2"]  # mass centre (x, y) [mm] in the image plane, from the window's centre
    I_max: Float[Array, ""]  # larger second moment [mm^4]
    I_min: Float[Array, ""]  # smaller second moment [mm^4]
    alpha: Float[Array, ""]  # direction of the larger moment [rad] in face axes, (-pi/2, pi/2], known up to a half turn
    uniqueness: Float[Array, ""]  # (I_max - I_min)/(I_max + I_min): 0 for a disc or a square, toward 1 for a needle


def mean_normal(window: Window) -> Float[Array, "3"]:
    """Unit mean of the normals over the region's pixels; (0, 0, -1) for an empty region."""
    normals = jnp.asarray(window.normals)
    total = jnp.sum(normals, axis=(0, 1))
    length_squared = jnp.sum(total**2)
    safe = jnp.where(length_squared > 0, length_squared, 1.0)
    frontal = jnp.array([0.0, 0.0, -1.0], dtype=normals.dtype)
    return jnp.where(length_squared > 0, total / jnp.sqrt(safe), frontal)


def face_inertia(window: Window) -> FaceInertia:
    """Inertia of the original face of one region, T taken at the region's mean normal."""
    p, q = gradient_space(mean_normal(window))
    T = affine_T(p, q)
    mask, pitch = jnp.asarray(window.mask), jnp.asarray(window.pitch)
    pixels, centroid, covariance = _pixel_moments(mask, pitch)
    area = jnp.linalg.det(T) * pixels * pitch**2
    tensor = area * (T @ covariance @ T.T)
    return FaceInertia(area, centroid, *_principal(tensor[0, 0], tensor[0, 1], tensor[1, 1]))


def window_grid(size: int, pitch: Float[Array, ""]) -> Float[Array, "2 s s"]:
    """(x, y) [mm] of the window's pixel centres, from the window's centre."""
    offset = (jnp.arange(size, dtype=pitch.dtype) - (size - 1) / 2.0) * pitch
    return jnp.stack([jnp.broadcast_to(offset, (size, size)), jnp.broadcast_to(offset[:, None], (size, size))])


def _pixel_moments(
    mask: Bool[Array, "s s"], pitch: Float[Array, ""]
) -> tuple[Float[Array, ""], Float[Array, "2"], Float[Array, "2 2"]]:
    """Pixel count, mean (x, y) [mm] and covariance [mm^2] of the region in the image plane."""
    m = mask.astype(pitch.dtype)
    grid = window_grid(mask.shape[0], pitch)
    pixels = jnp.sum(m)
    safe = jnp.maximum(pixels, 1.0)
    centroid = jnp.einsum("ab,cab->c", m, grid) / safe
    centred = grid - centroid[:, None, None]
    covariance = jnp.einsum("ab,cab,dab->cd", m, centred, centred) / safe
    # A pixel is a square, not a point: its own second moment makes rectangles along the axes exact.
    return pixels, centroid, covariance + jnp.eye(2, dtype=pitch.dtype) * pitch**2 / 12.0


def _principal(
    xx: Float[Array, ""], xy: Float[Array, ""], yy: Float[Array, ""]
) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
    """I_max, I_min, direction of the larger moment, uniqueness of a symmetric 2 x 2 tensor."""
    squared = (xx - yy) ** 2 + 4.0 * xy**2
    isotropic = squared == 0
    # Without a larger moment the direction is 0 and so is its derivative (atan2 and sqrt have none at 0).
    difference = jnp.where(isotropic, 0.0, jnp.sqrt(jnp.where(isotropic, 1.0, squared)))
    alpha = 0.5 * jnp.arctan2(jnp.where(isotropic, 0.0, 2.0 * xy), jnp.where(isotropic, 1.0, xx - yy))
    total = xx + yy
    uniqueness = difference / jnp.where(total > 0, total, 1.0)
    return (total + difference) / 2.0, (total - difference) / 2.0, alpha, uniqueness
