"""The refinement's loss as one function of pose, images and lights: differentiable where the chain is smooth.

`refine` minimises half the weighted sum of squares of needle and depth residuals by Gauss-Newton; here the same sum is
written out from the images on, so that whatever it depends on can be fitted or checked by `jax.grad`. Correspondences
and weights are data: ray casting and robust weighting are redone between steps, not differentiated. (The contour has no
part in it: edges of a depth map don't move smoothly.)
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Float

from itree_jax.refinement.observed import CameraArrays, ObservedMaps
from itree_jax.refinement.residuals import Deviations, Predicted, WindowObservations, look_up, tukey
from itree_jax.refinement.so3 import so3_exp
from itree_jax.refinement.viewing import sight, unproject
from itree_jax.sensing.needle import Array, NeedleMap
from itree_jax.sensing.photometric import photometric_stereo
from itree_jax.sensor import Noise


class LossWeights(NamedTuple):
    """Weights of the window's pixels, held fixed; 0 where nothing is compared."""

    depth: Float[Array, "s s"]  # [1 / mm^2]
    needle: Float[Array, "s s"]  # [1 / rad^2]


def loss_weights(
    R_cam_obj: Float[Array, "3 3"],
    predicted: Predicted,
    needle: NeedleMap,
    depth: Float[Array, "height width"],
    normal_obj: Float[Array, "triangles 3"],
    camera: CameraArrays,
    deviations: Deviations,
    stride: int,
) -> LossWeights:
    """The weights that a step of `refine` would use at this pose (see `residuals`): Tukey's biweight over the variance,
    with the bias that a face's pixels share. Depth [mm], 0 = none.
    """
    window = _window(needle, depth, predicted, stride)
    normal = normal_obj[predicted.triangle] @ R_cam_obj.T
    gap = window.depth - predicted.depth
    hit, known = predicted.triangle >= 0, window.depth > 0
    along = gap * jnp.sum(normal * sight(camera, window.uv), axis=-1)
    of_depth = jnp.where(hit & known, tukey(jnp.square(along / deviations.depth_gate)), 0.0)
    turned = jnp.sum(jnp.square(window.normals - normal), axis=-1) / jnp.square(deviations.needle_gate)
    same_surface = hit & (~known | (jnp.abs(gap) < deviations.depth_gate))
    of_needle = jnp.where(same_surface, window.needle_weight * tukey(turned), 0.0)
    return LossWeights(
        of_depth / (deviations.depth**2 + of_depth.sum() * deviations.depth_bias**2),
        of_needle / (deviations.needle**2 + of_needle.sum() * deviations.needle_bias**2),
    )


def refinement_loss(
    twist: Float[Array, "6"],
    R_cam_obj: Float[Array, "3 3"],
    t_cam_obj: Float[Array, "3"],
    predicted: Predicted,
    weights: LossWeights,
    images: Float[Array, "lights height width"],
    light_directions: Float[Array, "lights 3"],
    light_intensities: Float[Array, "lights"],
    noise: Noise,
    depth: Float[Array, "height width"],
    normal_obj: Float[Array, "triangles 3"],
    camera: CameraArrays,
    stride: int,
) -> Float[Array, ""]:
    """Half the weighted sum of squared needle differences and point-to-plane distances [mm] of one hypothesis.

    The pose is (R, t) moved by `twist` (omega [rad], v [mm]; camera frame, about the part's origin). `predicted` comes
    from ray casting at (R, t), `weights` from `loss_weights`. Differentiable with respect to twist, images, light
    directions and intensities; its gradient with respect to the twist, at 0, is that of the normal equations.
    """
    needle = photometric_stereo(images, light_directions, light_intensities, noise)
    window = _window(needle, depth, predicted, stride)
    turn = so3_exp(twist[:3])
    normal = normal_obj[predicted.triangle] @ R_cam_obj.T
    X_model = unproject(camera, window.uv, predicted.depth) - t_cam_obj
    X_seen = unproject(camera, window.uv, window.depth) - t_cam_obj
    distance = jnp.sum(normal * (X_seen - X_model @ turn.T - twist[3:]), axis=-1)
    turned = jnp.sum(jnp.square(window.normals - normal @ turn.T), axis=-1)
    return 0.5 * jnp.sum(weights.depth * jnp.square(distance)) + 0.5 * jnp.sum(weights.needle * turned)


def _window(
    needle: NeedleMap, depth: Float[Array, "height width"], predicted: Predicted, stride: int
) -> WindowObservations:
    believed = jnp.where(needle.interpretable, needle.confidence, 0.0)
    no_edge = jnp.zeros((0, 2))
    edges = jnp.zeros((0, 0), int), no_edge, no_edge, no_edge[:, 0]
    no_shading = jnp.zeros((*believed.shape, 0)), jnp.zeros((0, 3))
    maps = ObservedMaps(jnp.asarray(depth), jnp.asarray(needle.normals), believed, *edges, *no_shading)
    return look_up(maps, predicted.origin_uv, len(predicted.depth), stride)
