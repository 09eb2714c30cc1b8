"""Pose residuals of one hypothesis: needles, depth and contour, with their normal equations.

A pose moves by a twist (omega [rad], v [mm]) in the camera frame about the part's origin: `R <- exp(omega) R`,
`t <- t + v`. Correspondences (triangle and depth at each pixel) come from ray casting and stay fixed during a step.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from itree_jax.refinement.information import (
    AT_OUTLINE,
    MOST_FACES,
    SIDES,
    Measured,
    SmoothSurface,
    contour_jacobian,
    depth_jacobian,
    inside_of_contour,
    measured,
    needle_jacobian,
    side_of,
    surface_points,
)
from itree_jax.refinement.observed import CameraArrays, ObservedMaps
from itree_jax.refinement.steady import steady_product
from itree_jax.refinement.viewing import push_of, sight, unproject
from itree_jax.sensing.needle import Array

SHOWN, FOUND = 0.5, 0.125  # of a window's pixels, and of its possible contour points: most parts show less


class Predicted(NamedTuple):
    """Ray-cast prediction of one hypothesis at the pixels of its window (see itree_kernels.correspond)."""

    origin_uv: Float[Array, "2"]  # image point of window pixel (0, 0), whole numbers [px]
    depth: Float[Array, "s s"]  # z [mm], 0 where the part is missed
    triangle: Int[Array, "s s"]  # -1 where the part is missed
    contour_uv: Float[Array, "2 s s 2"]
    contour_depth: Float[Array, "2 s s"]  # 0 where no contour


class Deviations(NamedTuple):
    """Standard deviations and gates. Gates shrink from the first step to the last: a wide basin, then precision.

    A mean over N pixels whose errors share a bias b doesn't get better than b: a pixel's weight is 1/(s^2 + N b^2).
    """

    depth: Float[Array, ""]  # of one pixel [mm]
    depth_bias: Float[Array, ""]  # shared by a face [mm]
    depth_gate: Float[Array, ""]  # beyond it a pixel belongs to something else [mm]
    needle: Float[Array, ""]  # of one pixel [rad]
    needle_bias: Float[Array, ""]  # shared by a face [rad]
    needle_gate: Float[Array, ""]  # [rad]
    contour: Float[Array, ""]  # [px]
    contour_bias: Float[Array, ""]  # shared by a contour [px]
    contour_gate: Float[Array, ""]  # [px]
    grazing: Float[Array, ""] | np.float32 = np.float32(1.0)  # see `variance_across`; 1: the same on every surface


class NormalEquations(NamedTuple):
    """Sum of w J^T J, of w J^T r and of the robust cost; twist order (omega, v).

    `hessian` is for the step, with correspondences fixed. `information` and `spread` are for the covariance
    (`information.Measured`); both are the Hessian again where that was not asked for.
    """

    hessian: Float[Array, "6 6"]
    gradient: Float[Array, "6"]
    cost: Float[Array, ""]
    information: Float[Array, "6 6"]
    spread: Float[Array, "6 6"]


class WindowObservations(NamedTuple):
    """Observed maps at the pixels of a window."""

    uv: Float[Array, "s s 2"]
    depth: Float[Array, "s s"]
    normals: Float[Array, "s s 3"]
    needle_weight: Float[Array, "s s"]


def look_up(
    observed: ObservedMaps, origin_uv: Float[Array, "2"], size: int, stride: Int[Array, ""] | int
) -> WindowObservations:
    """Reads the maps at whole pixels; outside of the image nothing is observed."""
    height, width = observed.depth.shape
    step = stride * jnp.arange(size)
    u = origin_uv[0].astype(jnp.int32) + step
    v = origin_uv[1].astype(jnp.int32) + step
    inside = ((v >= 0) & (v < height))[:, None] & ((u >= 0) & (u < width))[None, :]
    uc, vc = jnp.clip(u, 0, width - 1)[None, :], jnp.clip(v, 0, height - 1)[:, None]
    uv = jnp.stack(jnp.broadcast_arrays(u[None, :], v[:, None]), axis=-1).astype(jnp.float32)
    return WindowObservations(
        uv,
        jnp.where(inside, observed.depth[vc, uc], 0.0),
        jnp.where(inside[..., None], observed.normals[vc, uc], 0.0),
        jnp.where(inside, observed.needle_weight[vc, uc], 0.0),
    )


def tukey(squared: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Tukey's biweight of (residual / gate)^2: 1 at none, 0 from the gate on."""
    return jnp.square(jnp.clip(1.0 - squared, 0.0, 1.0))


def _sums(jacobian: Float[Array, "n 6"], residual: Float[Array, "n"], weight: Float[Array, "n"]) -> NormalEquations:
    weighted = jacobian * weight[:, None]
    sums = steady_product(weighted, jnp.concatenate([jacobian, residual[:, None]], axis=-1))
    hessian, gradient = sums[:, :-1], sums[:, -1]
    return NormalEquations(hessian, gradient, jnp.sum(weight * residual**2), hessian, hessian)


def depth_equations(
    R_cam_obj: Float[Array, "3 3"], t_cam_obj: Float[Array, "3"], predicted: Predicted, window: WindowObservations,
    normal_obj: Float[Array, "triangles 3"], camera: CameraArrays, deviations: Deviations,
) -> NormalEquations:
    """Point to plane: n . (X_obs - X_model) [mm] along each pixel's ray."""
    direction = sight(camera, window.uv)
    normal = normal_obj[predicted.triangle] @ R_cam_obj.T
    gap = window.depth - predicted.depth
    facing = jnp.sum(normal * direction, axis=-1)
    residual = gap * facing
    weight = depth_weights(predicted, window, residual, facing, deviations)
    arm = unproject(camera, window.uv, predicted.depth) - t_cam_obj
    jacobian = -jnp.concatenate([jnp.cross(arm, normal), normal], axis=-1)
    return _sums(jacobian.reshape(-1, 6), residual.reshape(-1), weight.reshape(-1))


def variance_across(facing: Float[Array, "*n"], grazing: Float[Array, ""] | np.float32) -> Float[Array, "*n"]:
    """Variance of a depth's error as it shows across a surface, beside that of one which faces the camera.

    A depth camera errs along its rays: across a surface seen at a slant that is less, by the cosine (`facing`), down to
    a share `grazing` of the variance, as rasters and lateral errors are left.
    """
    return grazing + (1.0 - grazing) * jnp.square(facing)


def depth_weights(
    predicted: Predicted, window: WindowObservations, residual: Float[Array, "s s"], facing: Float[Array, "s s"],
    deviations: Deviations,
) -> Float[Array, "s s"]:
    """How much each pixel's depth counts [1 / mm^2] beside the depths that share its bias."""
    valid = (predicted.triangle >= 0) & (window.depth > 0)
    variance = variance_across(facing, deviations.grazing)
    robust = tukey(jnp.square(residual / deviations.depth_gate) / variance) / variance
    robust = jnp.where(valid, robust, 0.0)
    count = jnp.sum(robust)
    return robust / (jnp.square(deviations.depth) + count * jnp.square(deviations.depth_bias))


def needle_equations(
    R_cam_obj: Float[Array, "3 3"], predicted: Predicted, window: WindowObservations,
    normal_obj: Float[Array, "triangles 3"], deviations: Deviations, gap: Float[Array, "s s"],
) -> NormalEquations:
    """Needles: n_obs - R n_obj. Its Jacobian is the cross-product matrix of n, so that J^T J = I - n n^T."""
    normal = normal_obj[predicted.triangle] @ R_cam_obj.T
    residual = window.normals - normal
    weight = needle_weights(predicted, window, normal, deviations, gap)
    flat = normal.reshape(-1, 3)
    outer = steady_product(flat * weight.reshape(-1, 1), flat)
    rotation = jnp.sum(weight) * jnp.eye(3) - outer
    gradient = steady_product(weight.reshape(-1, 1), jnp.cross(residual, normal).reshape(-1, 3))[0]
    hessian = jnp.zeros((6, 6)).at[:3, :3].set(rotation)
    cost = jnp.sum(weight * jnp.sum(residual**2, axis=-1))
    return NormalEquations(hessian, jnp.zeros(6).at[:3].set(gradient), cost, hessian, hessian)


def needle_weights(
    predicted: Predicted, window: WindowObservations, normal: Float[Array, "s s 3"], deviations: Deviations,
    gap: Float[Array, "s s"],
) -> Float[Array, "s s"]:
    """How much each pixel's needle counts [1 / rad^2] beside the needles that share its bias."""
    squared = jnp.sum((window.normals - normal) ** 2, axis=-1)
    same_surface = (window.depth <= 0) | (jnp.abs(gap) < deviations.depth_gate)
    valid = (predicted.triangle >= 0) & (window.needle_weight > 0) & same_surface
    robust = jnp.where(valid, window.needle_weight * tukey(squared / jnp.square(deviations.needle_gate)), 0.0)
    count = jnp.sum(robust)
    return robust / (jnp.square(deviations.needle) + count * jnp.square(deviations.needle_bias))


class MatchedContour(NamedTuple):
    """Contour points with the observed edge of each; weight 0 where there is none."""

    uv: Float[Array, "n 2"]  # [px]
    depth: Float[Array, "n"]  # [mm]
    direction: Float[Array, "n 2"]  # across the edge
    residual: Float[Array, "n"]  # [px]
    weight: Float[Array, "n"]  # [1 / px^2]


def matched_contour(predicted: Predicted, observed: ObservedMaps, deviations: Deviations) -> MatchedContour:
    """The nearest observed edge point of every contour point of the window."""
    uv = predicted.contour_uv.reshape(-1, 2)
    z = predicted.contour_depth.reshape(-1)
    height, width = observed.edge_label.shape
    half = jnp.round(2.0 * uv).astype(jnp.int32)
    inside = (half[:, 0] >= 0) & (half[:, 0] < width) & (half[:, 1] >= 0) & (half[:, 1] < height)
    label = observed.edge_label[jnp.clip(half[:, 1], 0, height - 1), jnp.clip(half[:, 0], 0, width - 1)]
    gap = uv - observed.edge_uv[label]
    direction = observed.edge_normal[label]
    residual = jnp.sum(gap * direction, axis=-1)
    # an edge at another depth belongs to another part
    edge_depth = observed.edge_depth[label]
    deep = (edge_depth <= 0) | (jnp.abs(edge_depth - z) < 2.0 * deviations.depth_gate)
    valid = inside & (z > 0) & deep
    robust = jnp.where(valid, tukey(jnp.sum(gap**2, axis=-1) / jnp.square(deviations.contour_gate)), 0.0)
    count = jnp.sum(robust)
    weight = robust / (jnp.square(deviations.contour) + count * jnp.square(deviations.contour_bias))
    return MatchedContour(uv, z, direction, jnp.where(valid, residual, 0.0), weight)


def contour_equations(
    t_cam_obj: Float[Array, "3"], predicted: Predicted, observed: ObservedMaps, camera: CameraArrays,
    deviations: Deviations,
) -> NormalEquations:
    """Occluding contour: distance [px] to the nearest observed edge point along that edge's own direction."""
    match = matched_contour(predicted, observed, deviations)
    X = unproject(camera, match.uv, match.depth)
    push = push_of(X, match.depth, match.direction, camera)  # d residual / d X
    jacobian = jnp.concatenate([jnp.cross(X - t_cam_obj, push), push], axis=-1)
    return _sums(jnp.where(match.weight[:, None] > 0, jacobian, 0.0), match.residual, match.weight)


def measured_information(
    R_cam_obj: Float[Array, "3 3"], t_cam_obj: Float[Array, "3"], predicted: Predicted, observed: ObservedMaps,
    window: WindowObservations, normal_obj: Float[Array, "triangles 3"], surface: SmoothSurface, camera: CameraArrays,
    deviations: Deviations, few: bool, places: Int[Array, "n"],
) -> Measured:
    """What needles, depth and contour measure of the pose (see `information.py`), under the weights of the step.

    Depth and needles of a component face share their bias, contour points of one side theirs. `few`: see `are_few`;
    `places`: of the contour points, among all that are possible.
    """
    gap = window.depth - predicted.depth
    normal = normal_obj[predicted.triangle] @ R_cam_obj.T
    facing = jnp.sum(normal * sight(camera, window.uv), axis=-1)
    match = matched_contour(predicted, observed, deviations)

    def on_surface(uv: Float[Array, "n 2"], depth: Float[Array, "n"], triangle: Int[Array, "n"]):
        pitch = jnp.where(camera.pinhole > 0, depth, 1.0) / camera.fx
        return surface_points(R_cam_obj, t_cam_obj, uv, depth, triangle, surface, camera), pitch

    triangle, beside = predicted.triangle.reshape(-1), inside_of_contour(predicted.depth, predicted.triangle)[places]
    of_depth = depth_weights(predicted, window, gap * facing, facing, deviations).reshape(-1)
    of_needles = needle_weights(predicted, window, normal, deviations, gap).reshape(-1)
    uv, depth = window.uv.reshape(-1, 2), predicted.depth.reshape(-1)
    if few:
        shown, is_shown = _places(triangle >= 0, int(SHOWN * len(triangle)))
        uv, depth, triangle = uv[shown], depth[shown], triangle[shown]
        of_depth, of_needles = (jnp.where(is_shown, weight[shown], 0.0) for weight in (of_depth, of_needles))
    points, pitch = on_surface(uv, depth, triangle)
    inner, fine = on_surface(match.uv, match.depth, beside)
    reach = AT_OUTLINE * (window.uv[0, 1, 0] - window.uv[0, 0, 0]) * fine
    by_depth = measured(
        depth_jacobian(points)[:, None], of_depth, points.face, MOST_FACES, deviations.depth, deviations.depth_bias
    )
    by_needles = measured(
        needle_jacobian(points, pitch), of_needles, points.face, MOST_FACES, deviations.needle, deviations.needle_bias
    )
    by_contour = measured(
        contour_jacobian(inner, match.depth, match.direction, t_cam_obj, camera, reach)[:, None], match.weight,
        side_of(match.direction), SIDES, deviations.contour, deviations.contour_bias,
    )
    information = by_depth.information + by_needles.information + by_contour.information
    return Measured(information, by_depth.spread + by_needles.spread + by_contour.spread)


def are_few(triangle: Int[np.ndarray, "poses s s"], contour_depth: Float[np.ndarray, "poses 2 s s"]) -> bool:
    """Whether each window shows so few pixels and contour points that they are picked out before they are weighed."""
    shown, found = (triangle >= 0).sum(axis=(1, 2)), (contour_depth > 0.0).sum(axis=(1, 2, 3))
    few = (shown <= SHOWN * triangle[0].size) & (found <= FOUND * contour_depth[0].size)
    return bool(few.all())


def _places(there: Bool[Array, "n"], most: int) -> tuple[Int[Array, "most"], Bool[Array, "most"]]:
    """Where it is so, filled up to `most`; which are no filling."""
    return jnp.nonzero(there, size=most, fill_value=0)[0], jnp.arange(most) < jnp.sum(there)


def total_equations(
    R_cam_obj: Float[Array, "3 3"], t_cam_obj: Float[Array, "3"], predicted: Predicted, observed: ObservedMaps,
    normal_obj: Float[Array, "triangles 3"], camera: CameraArrays, deviations: Deviations, size: int,
    stride: Int[Array, ""] | int, surface: SmoothSurface | None = None, few: bool = False,
) -> NormalEquations:
    """The normal equations of one hypothesis: needles + depth + contour.

    With the smooth `surface` that the triangles stand for, they tell what the image measures. `few`: see `are_few`.
    """
    window = look_up(observed, predicted.origin_uv, size, stride)
    gap = window.depth - predicted.depth
    places = jnp.arange(predicted.contour_depth.size)
    if few:
        uv, z = predicted.contour_uv.reshape(-1, 2), predicted.contour_depth.reshape(-1)
        places, is_found = _places(z > 0.0, int(FOUND * len(z)))
        predicted = predicted._replace(contour_uv=uv[places], contour_depth=jnp.where(is_found, z[places], 0.0))
    terms = (
        depth_equations(R_cam_obj, t_cam_obj, predicted, window, normal_obj, camera, deviations),
        needle_equations(R_cam_obj, predicted, window, normal_obj, deviations, gap),
        contour_equations(t_cam_obj, predicted, observed, camera, deviations),
    )
    total = NormalEquations(*(sum(parts[1:], parts[0]) for parts in zip(*terms, strict=True)))
    if surface is None:
        return total

    found = measured_information(
        R_cam_obj, t_cam_obj, predicted, observed, window, normal_obj, surface, camera, deviations, few, places
    )
    return total._replace(information=found.information, spread=found.spread)
