"""The affine matrix T that recovers a face from its foreshortened region (Ikeuchi 1987, sec. 2.1.3, corrected).

All in the frame of the region's viewing ray: x right, y down, z away from the viewer. A face with gradient (p, q) is
the plane z = p x + q y; its normal toward the viewer is (p, q, -1)/sqrt(1 + p^2 + q^2).
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

# Slants beyond 89.4 degrees have no usable gradient; the limit only keeps the division finite.
LEAST_COS_SLANT = 0.01


def gradient_space(mean_normal: Float[Array, "3"]) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Gradient (p, q) = (dz/dx, dz/dy) of the plane with this normal toward the viewer (z < 0, any length)."""
    towards = jnp.maximum(-mean_normal[2], LEAST_COS_SLANT * jnp.sqrt(jnp.sum(mean_normal**2)))
    towards = jnp.where(towards > 0, towards, 1.0)
    return mean_normal[0] / towards, mean_normal[1] / towards


def affine_T(p: Float[Array, ""], q: Float[Array, ""]) -> Float[Array, "2 2"]:
    """T with (x', y') = T (x, y): image offsets [mm] to face coordinates [mm] along `face_axes`.

    The square roots are missing in the printed matrix; with them det T = sqrt(1 + p^2 + q^2) = 1/cos(slant).
    """
    s = jnp.sqrt(1.0 + p**2)
    return jnp.stack([jnp.stack([s, p * q / s]), jnp.stack([jnp.zeros_like(s), jnp.sqrt(1.0 + p**2 + q**2) / s])])


def inverse_T(T: Float[Array, "2 2"]) -> Float[Array, "2 2"]:
    """The inverse of `affine_T`, an upper triangular matrix: face coordinates to image offsets."""
    a, b, d = T[0, 0], T[0, 1], T[1, 1]
    return jnp.stack([jnp.stack([1.0 / a, -b / (a * d)]), jnp.stack([jnp.zeros_like(a), 1.0 / d])])


def face_axes(p: Float[Array, ""], q: Float[Array, ""]) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
    """The unit 3-D directions e1, e2 of the face coordinates x', y': e1 = (1, 0, p)/sqrt(1 + p^2), e2 completes it."""
    s = jnp.sqrt(1.0 + p**2)
    e1 = jnp.stack([jnp.ones_like(p), jnp.zeros_like(p), p]) / s
    e2 = jnp.stack([-p * q, 1.0 + p**2, q]) / (s * jnp.sqrt(1.0 + p**2 + q**2))
    return e1, e2
