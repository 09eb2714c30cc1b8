"""What the image measures of a pose, for its covariance: surfaces are smooth and slide under their pixels.

The equations of a step keep correspondences and facets as they are. That serves to find the pose, but on a curved
surface it measures what nothing measures: turned about its axis, a cylinder seems to show other needles, a facet
another depth, and the last pixel inside of its outline another place.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Float, Int

from itree_jax.refinement.observed import CameraArrays
from itree_jax.refinement.steady import steady_product
from itree_jax.refinement.viewing import cross_matrix, push_of, sight, unproject
from itree_jax.sensing.needle import Array

SHARPEST = 0.25  # [rad] per pixel: a surface that bends more is an edge to the camera, whose needles tell no place
STEEPEST = 0.2  # cosine of the slant beyond which nothing is detectable
AT_OUTLINE = 1.5  # [px] within which of a contour a smooth surface must turn away for the contour to be its outline


MOST_FACES = 32  # component faces that have a bias of their own; the smallest of a part with more share one
SIDES = 8  # of a contour, by its direction in the image: each has a bias of its own


class SmoothSurface(NamedTuple):
    """Over each triangle the normal is `bending @ X + offset`, not yet of length 1; X in the model frame [mm]."""

    bending: Float[Array, "triangles 3 3"]  # [rad / mm]
    offset: Float[Array, "triangles 3"]
    face: Int[Array, "triangles"]  # component face


class Measured(NamedTuple):
    """What residuals tell of a twist, and how far their errors turn what they pull at.

    The covariance of the twist is information^-1 spread information^-1.
    """

    information: Float[Array, "6 6"]  # sum of w J^T J
    spread: Float[Array, "6 6"]  # covariance of sum of w J^T error


def measured(
    jacobian: Float[Array, "n k 6"], weight: Float[Array, "n"], group: Int[Array, "n"], groups: int,
    deviation: Float[Array, ""], bias: Float[Array, ""],
) -> Measured:
    """Of residuals whose errors have a `deviation` of their own and a `bias` that those of one group share.

    The weights keep a mean from becoming surer than the bias, but take it out on all directions alike, though a shift
    that all pixels share turns nothing. Here it counts where it acts.
    """
    rows, each = jacobian.reshape(-1, 6), jnp.repeat(weight, jacobian.shape[1])[:, None]
    information, alone = steady_product(each * rows, rows), steady_product(jnp.square(each) * rows, rows)
    member = weight[:, None] * (group[:, None] == jnp.arange(groups))
    together = steady_product(member, jacobian.reshape(len(weight), -1)).reshape(groups, -1, 6)
    shared = jnp.einsum("gka,gkb->ab", together, together)
    return Measured(information, jnp.square(deviation) * alone + jnp.square(bias) * shared)


class SurfacePoints(NamedTuple):
    """Points of the part's surface, camera frame."""

    ray: Float[Array, "*n 3"]  # direction of sight with z = 1
    arm: Float[Array, "*n 3"]  # from the part's origin [mm]
    normal: Float[Array, "*n 3"]
    bending: Float[Array, "*n 3 3"]  # [rad / mm]
    face: Int[Array, "*n"]


def surface_points(
    R_cam_obj: Float[Array, "3 3"], t_cam_obj: Float[Array, "3"], uv: Float[Array, "*n 2"], depth: Float[Array, "*n"],
    triangle: Int[Array, "*n"], surface: SmoothSurface, camera: CameraArrays,
) -> SurfacePoints:
    """Where rays meet triangles; where they meet none (-1) the values mean nothing, but are finite."""
    arm = unproject(camera, uv, depth) - t_cam_obj
    bending = surface.bending[triangle]
    normal = jnp.einsum("...ij,...j->...i", bending, arm @ R_cam_obj) + surface.offset[triangle]
    normal = normal / jnp.maximum(jnp.linalg.norm(normal, axis=-1, keepdims=True), 1e-6) @ R_cam_obj.T
    face = jnp.minimum(surface.face[triangle], MOST_FACES - 1)
    return SurfacePoints(sight(camera, uv), arm, normal, R_cam_obj @ bending @ R_cam_obj.T, face)


def needle_jacobian(points: SurfacePoints, pitch: Float[Array, "*n"]) -> Float[Array, "*n 3 6"]:
    """Change of the predicted needle at a fixed pixel per twist (omega, v). `pitch` [mm / px].

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
    return turned + bending @ slide @ moved


def depth_jacobian(points: SurfacePoints) -> Float[Array, "*n 6"]:
    """Change of the point-to-plane distance: a smooth surface that moves within itself tells nothing."""
    return jnp.concatenate([jnp.cross(points.arm, points.normal), points.normal], axis=-1)


def contour_jacobian(
    points: SurfacePoints, depth: Float[Array, "n"], direction: Float[Array, "n 2"], t_cam_obj: Float[Array, "3"],
    camera: CameraArrays, reach: Float[Array, "n"],
) -> Float[Array, "n 6"]:
    """Change of the contour [px] along its edge's `direction`. `points` are the last ones inside of it.

    Where a smooth surface turns away there, its outline lies deeper, where the ray touches: by |n . r| / (r^T B r)
    along the ray, (n . r)^2 / (2 r^T B r) [mm] beside it. Farther than `reach` [mm] the contour is a sharp edge.
    """
    facing = jnp.sum(points.normal * points.ray, axis=-1)
    bend = jnp.einsum("...i,...ij,...j->...", points.ray, points.bending, points.ray)
    bend = jnp.maximum(bend, 1e-9)
    deeper = jnp.where(facing**2 < 2.0 * bend * reach, -facing / bend, 0.0)
    X = points.arm + t_cam_obj + deeper[:, None] * points.ray
    push = push_of(X, depth, direction, camera)
    return jnp.concatenate([jnp.cross(X - t_cam_obj, push), push], axis=-1)


def side_of(direction: Float[Array, "n 2"]) -> Int[Array, "n"]:
    """Which of the `SIDES` a direction in the image belongs to."""
    angle = jnp.arctan2(direction[:, 1], direction[:, 0]) / (2.0 * jnp.pi)
    return jnp.clip(jnp.floor((angle + 0.5) * SIDES).astype(jnp.int32), 0, SIDES - 1)


def inside_of_contour(depth: Float[Array, "s s"], triangle: Int[Array, "s s"]) -> Int[Array, "two_s_s"]:
    """The triangle on the near side of every possible contour: between a pixel and its right, its lower neighbour."""
    far = jnp.where(triangle >= 0, depth, jnp.inf)
    right = jnp.where(far[:, :-1] <= far[:, 1:], triangle[:, :-1], triangle[:, 1:])
    below = jnp.where(far[:-1] <= far[1:], triangle[:-1], triangle[1:])
    right = jnp.concatenate([right, triangle[:, -1:]], axis=1)
    below = jnp.concatenate([below, triangle[-1:]], axis=0)
    return jnp.stack([right, below]).reshape(-1)
