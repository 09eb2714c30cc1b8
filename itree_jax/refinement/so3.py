"""Rotations and twists inside compiled functions."""

import jax.numpy as jnp
from jaxtyping import Float

from itree_jax.sensing.needle import Array


def so3_exp(omega: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """Rodrigues' formula, smooth at 0."""
    squared = jnp.sum(omega**2)
    small = squared < 1e-8
    angle = jnp.sqrt(jnp.where(small, 1.0, squared))
    a = jnp.where(small, 1.0 - squared / 6.0, jnp.sin(angle) / angle)
    b = jnp.where(small, 0.5 - squared / 24.0, (1.0 - jnp.cos(angle)) / (angle * angle))
    x, y, z = omega
    zero = jnp.zeros_like(x)
    K = jnp.stack([jnp.stack([zero, -z, y]), jnp.stack([z, zero, -x]), jnp.stack([-y, x, zero])])
    return jnp.eye(3, dtype=omega.dtype) + a * K + b * (K @ K)


def move(
    R_cam_obj: Float[Array, "3 3"], t_cam_obj: Float[Array, "3"], twist: Float[Array, "6"]
) -> tuple[Float[Array, "3 3"], Float[Array, "3"]]:
    """Applies a twist (omega, v) in the camera frame about the part's origin."""
    return so3_exp(twist[:3]) @ R_cam_obj, t_cam_obj + twist[3:]
