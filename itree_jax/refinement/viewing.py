"""Rays of a camera inside compiled functions."""

import jax.numpy as jnp
from jaxtyping import Float

from itree_jax.refinement.observed import CameraArrays
from itree_jax.sensing.needle import Array


def sight(camera: CameraArrays, uv: Float[Array, "*n 2"]) -> Float[Array, "*n 3"]:
    """Direction of sight with z = 1: how a point moves per mm of depth."""
    x = (uv[..., 0] - camera.cx) / camera.fx * camera.pinhole
    y = (uv[..., 1] - camera.cy) / camera.fy * camera.pinhole
    return jnp.stack([x, y, jnp.ones_like(x)], axis=-1)


def unproject(camera: CameraArrays, uv: Float[Array, "*n 2"], depth: Float[Array, "*n"]) -> Float[Array, "*n 3"]:
    """The point [mm] at this depth [mm] on a pixel's ray."""
    scale = jnp.where(camera.pinhole > 0, depth, 1.0)
    x = (uv[..., 0] - camera.cx) / camera.fx * scale
    y = (uv[..., 1] - camera.cy) / camera.fy * scale
    return jnp.stack([x, y, depth], axis=-1)


def cross_matrix(a: Float[Array, "*n 3"]) -> Float[Array, "*n 3 3"]:
    """`cross_matrix(a) @ b` is a x b."""
    x, y, z = jnp.moveaxis(a, -1, 0)
    zero = jnp.zeros_like(x)
    rows = ((zero, -z, y), (z, zero, -x), (-y, x, zero))
    return jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)


def push_of(
    X: Float[Array, "n 3"], depth: Float[Array, "n"], direction: Float[Array, "n 2"], camera: CameraArrays
) -> Float[Array, "n 3"]:
    """How far [px] along an image direction a point's image moves per mm of the point, by axis."""
    scale = jnp.where(camera.pinhole > 0, jnp.maximum(depth, 1.0), 1.0)
    a = direction[:, 0] * camera.fx / scale
    b = direction[:, 1] * camera.fy / scale
    slope = -(a * X[:, 0] + b * X[:, 1]) / scale * camera.pinhole
    return jnp.stack([a, b, slope], axis=-1)
