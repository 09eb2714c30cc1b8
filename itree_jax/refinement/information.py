"""What the image measures of a pose, for its covariance: surfaces are smooth and slide under their pixels.

The equations of a step keep correspondences and facets as they are. That serves to find the pose, but on a curved
surface it measures what nothing measures: turned about its axis, a cylinder seems to show other needles, a facet
another depth, and the last pixel inside of its outline another place.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Float, Int

from itree_jax.refinement.observed import CameraArrays
from itree_jax.refinement.viewing import cross_matrix, push_of, sight, unproject
from itree_jax.sensing.needle import Array

SHARPEST = 0.25  # [rad] per pixel: a surface that bends more is an edge to the camera, whose needles tell no place
STEEPEST = 0.2  # cosine of the slant beyond which nothing is detectable
AT_OUTLINE = 1.5  # [px] within which of a contour a smooth surface must turn away for the contour to be its outline


class SmoothSurface(NamedTuple):
    """Over each triangle the normal is `bending @ X + offset`, not yet of length 1; X in the model frame [mm]."""

    bending: Float[Array, "triangles 3 3"]  # [rad / mm]
    offset: Float[Array, "triangles 3"]


class SurfacePoints(NamedTuple):
    """Points of the part's surface, camera frame."""

    ray: Float[Array, "*n 3"]  # direction of sight with z = 1
    arm: Float[Array, "*n 3"]  # from the part's origin [mm]
    normal: Float[Array, "*n 3"]
    bending: Float[Array, "*n 3 3"]  # [rad / mm]


def surface_points(
    R_cam_obj: Float[Array, "3 3"], t_cam_obj: Float[Array, "3"], uv: Float[Array, "*n 2"], depth: Float[Array, "*n"],
    triangle: Int[Array, "*n"], surface: SmoothSurface, camera: CameraArrays,
) -> SurfacePoints:
    """Where rays meet triangles; where they meet none (-1) the values mean nothing, but are finite."""
    arm = unproject(camera, uv, depth) - t_cam_obj
    bending = surface.bending[triangle]
    normal = jnp.einsum("...ij,...j->...i", bending, arm @ R_cam_obj) + surface.offset[triangle]
    normal = normal / jnp.maximum(jnp.linalg.norm(normal, axis=-1, keepdims=True), 1e-6) @ R_cam_obj.T
    return SurfacePoints(sight(camera, uv), arm, normal, R_cam_obj @ bending @ R_cam_obj.T)


def needle_information(
    points: SurfacePoints, weight: Float[Array, "*n"], pitch: Float[Array, "*n"]
) -> Float[Array, "6 6"]:
    """Sum of w J^T J, J the change of the predicted needle at a fixed pixel per twist (omega, v). `pitch` [mm / px].

    A twist moves the surface point X by m = omega x (X - t) + v. The ray then meets another point of the surface, by
    u = -(I - r n^T / (n . r)) m away from the one it met before, whose normal is turned by the bending along u. So
    a turn about a cylinder's axis changes nothing, and a shift across it does.
    """
    facing = jnp.minimum(jnp.sum(points.normal * points.ray, axis=-1), -STEEPEST)
    sharp = jnp.sqrt(jnp.sum(points.bending**2, axis=(-2, -1))) * pitch
    bending = points.bending * jnp.minimum(1.0, SHARPEST / jnp.maximum(sharp, 1e-9))[..., None, None]
    straight = jnp.broadcast_to(jnp.eye(3, dtype=points.arm.dtype), (*points.arm.shape, 3))
    moved = jnp.concatenate([-cross_matrix(points.arm), straight], axis=-1)
    slide = points.ray[..., :, None] * (points.normal / facing[..., None])[..., None, :] - straight
    turned = jnp.concatenate([-cross_matrix(points.normal), jnp.zeros_like(straight)], axis=-1)
    jacobian = (turned + bending @ slide @ moved).reshape(-1, 3, 6)
    return jnp.einsum("p,pia,pib->ab", weight.reshape(-1), jacobian, jacobian)


def depth_information(points: SurfacePoints, weight: Float[Array, "*n"]) -> Float[Array, "6 6"]:
    """Sum of w J^T J of the point-to-plane distance: a smooth surface that moves within itself tells nothing."""
    jacobian = jnp.concatenate([jnp.cross(points.arm, points.normal), points.normal], axis=-1).reshape(-1, 6)
    return (jacobian * weight.reshape(-1)[:, None]).T @ jacobian


def contour_information(
    points: SurfacePoints, depth: Float[Array, "n"], direction: Float[Array, "n 2"], weight: Float[Array, "n"],
    t_cam_obj: Float[Array, "3"], camera: CameraArrays, reach: Float[Array, "n"],
) -> Float[Array, "6 6"]:
    """Sum of w J^T J of the contour along its edge's `direction`. `points` are the last ones inside of it.

    Where a smooth surface turns away there, its outline lies deeper, where the ray touches: by |n . r| / (r^T B r)
    along the ray, (n . r)^2 / (2 r^T B r) [mm] beside it. Farther than `reach` [mm] the contour is a sharp edge.
    """
    facing = jnp.sum(points.normal * points.ray, axis=-1)
    bend = jnp.einsum("...i,...ij,...j->...", points.ray, points.bending, points.ray)
    bend = jnp.maximum(bend, 1e-9)
    deeper = jnp.where(facing**2 < 2.0 * bend * reach, -facing / bend, 0.0)
    X = points.arm + t_cam_obj + deeper[:, None] * points.ray
    push = push_of(X, depth, direction, camera)
    jacobian = jnp.concatenate([jnp.cross(X - t_cam_obj, push), push], axis=-1)
    return (jacobian * weight[:, None]).T @ jacobian


def inside_of_contour(depth: Float[Array, "s s"], triangle: Int[Array, "s s"]) -> Int[Array, "two_s_s"]:
    """The triangle on the near side of every possible contour: between a pixel and its right, its lower neighbour."""
    far = jnp.where(triangle >= 0, depth, jnp.inf)
    right = jnp.where(far[:, :-1] <= far[:, 1:], triangle[:, :-1], triangle[:, 1:])
    below = jnp.where(far[:-1] <= far[1:], triangle[:-1], triangle[1:])
    right = jnp.concatenate([right, triangle[:, -1:]], axis=1)
    below = jnp.concatenate([below, triangle[-1:]], axis=0)
    return jnp.stack([right, below]).reshape(-1)
