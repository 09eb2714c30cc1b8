"""Original face shape d(theta): the work model of rules L2 and A5 (Ikeuchi 1987, sec. 2.1.3).

The distance from the mass centre of the face to its boundary as a function of the angle from a given direction (the
maximum inertia direction): "a two-dimensional well-tessellated surface representation of the shape".
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from itree_jax.features.bilinear import bilinear
from itree_jax.features.rectify import inverse_T
from itree_jax.features.window import Window

N_THETA = 64


def outline(
    window: Window,
    T: Float[Array, "2 2"],
    centroid: Float[Array, "2"],
    alpha: Float[Array, ""],
    n_theta: int = N_THETA,
) -> Float[Array, "n_theta"]:
    """d(theta_k) [mm] on the rectified face, theta_k = 2 pi k/n_theta counted from `alpha` in face axes.

    Along each direction the mask is sampled bilinearly from the mass centre outward; the boundary is the outermost
    place where it falls through one half. A direction that meets no part of the region has distance 0.

    Args:
        window: one region.
        T: its affine matrix.
        centroid: mass centre (x, y) [mm] in the image plane, from the window's centre.
        alpha: direction [rad] of theta = 0 in face axes.
    """
    mask, pitch = jnp.asarray(window.mask), jnp.asarray(window.pitch)
    size = mask.shape[0]
    theta = jnp.arange(n_theta, dtype=pitch.dtype) * (2.0 * jnp.pi / n_theta) + alpha
    on_face = jnp.stack([jnp.cos(theta), jnp.sin(theta)])  # unit on the face
    in_image = inverse_T(T) @ on_face
    length = jnp.sqrt(jnp.sum(in_image**2, axis=0))  # image length of one face mm
    steps = jnp.arange(int(size * 2**0.5) + 2, dtype=pitch.dtype)  # [px]: steps of one reach every corner
    start = centroid / pitch + (size - 1) / 2.0
    xy = start[:, None, None] + (in_image / length[None, :])[:, :, None] * steps[None, None, :]
    sampled = bilinear(mask.astype(pitch.dtype), xy[0], xy[1])
    return _outermost_crossing(sampled) * pitch / length


def _outermost_crossing(sampled: Float[Array, "n steps"]) -> Float[Array, "n"]:
    """Largest position [steps] at which the samples fall through 1/2, between samples by a straight line."""
    last_is_out = sampled.at[:, -1].set(0.0)
    steps = jnp.arange(sampled.shape[1])
    last_inside = jnp.max(jnp.where(last_is_out >= 0.5, steps, -1), axis=1)
    index = jnp.maximum(last_inside, 0)[:, None]
    inner = jnp.take_along_axis(last_is_out, index, axis=1)[:, 0]
    outer = jnp.take_along_axis(last_is_out, index + 1, axis=1)[:, 0]
    found = last_inside >= 0
    fall = jnp.where(found, inner - outer, 1.0)
    return jnp.where(found, last_inside.astype(sampled.dtype) + (inner - 0.5) / fall, 0.0)
