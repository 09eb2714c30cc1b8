"""What needles measure of a pose once the surface may slide under its pixel: the information for the covariance."""

import jax.numpy as jnp
from jaxtyping import Float

from itree_jax.refinement.observed import CameraArrays
from itree_jax.refinement.viewing import cross_matrix, sight, unproject
from itree_jax.sensing.needle import Array

SHARPEST = 0.25  # [rad] per pixel: a surface that bends more is an edge to the camera, whose needles tell no place
STEEPEST = 0.2  # cosine of the slant under which nothing is detectable


def needle_information(
    R_cam_obj: Float[Array, "3 3"], t_cam_obj: Float[Array, "3"], uv: Float[Array, "*n 2"], depth: Float[Array, "*n"],
    normal: Float[Array, "*n 3"], bending_obj: Float[Array, "*n 3 3"], weight: Float[Array, "*n"],
    camera: CameraArrays,
) -> Float[Array, "6 6"]:
    """Sum of w J^T J, J the change of the predicted needle at a fixed pixel per twist (omega, v).

    A twist moves the surface point X by m = omega x (X - t) + v. The ray then meets another point of the surface, by
    u = -(I - r n^T / (n . r)) m away from the one it met before, whose normal is turned by the bending along u. So
    a turn about a cylinder's axis changes nothing, and a shift across it does.
    """
    ray = sight(camera, uv)
    facing = jnp.minimum(jnp.sum(normal * ray, axis=-1), -STEEPEST)
    pitch = jnp.where(camera.pinhole > 0, depth, 1.0) / camera.fx
    bending = R_cam_obj @ bending_obj @ R_cam_obj.T
    sharp = jnp.sqrt(jnp.sum(bending**2, axis=(-2, -1))) * pitch
    bending = bending * jnp.minimum(1.0, SHARPEST / jnp.maximum(sharp, 1e-9))[..., None, None]
    arm = unproject(camera, uv, depth) - t_cam_obj
    moved = jnp.concatenate([-cross_matrix(arm), jnp.broadcast_to(jnp.eye(3), (*arm.shape, 3))], axis=-1)
    slide = ray[..., :, None] * (normal / facing[..., None])[..., None, :] - jnp.eye(3)
    turned = jnp.concatenate([-cross_matrix(normal), jnp.zeros((*normal.shape, 3))], axis=-1)
    jacobian = (turned + bending @ slide @ moved).reshape(-1, 3, 6)
    return jnp.einsum("p,pia,pib->ab", weight.reshape(-1), jacobian, jacobian)
