"""Verification by rendering: which pixels agree with a pose, contradict it, or are hidden by something nearer."""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.correspond import correspondences
from jaxtyping import Bool, Float, Int

from itree_jax.refinement.observed import ObservedMaps
from itree_jax.refinement.optimise import (
    Hypotheses,
    OtherView,
    RefineModel,
    as_predicted,
    in_batches,
    padded,
    window_origins,
    window_stride,
)
from itree_jax.refinement.residuals import Predicted, look_up
from itree_jax.sensing.needle import Array

BLIND = 0.5  # what a pixel without depth counts: needles and shading are alike on any parallel face
SAME_SHADING = 0.12  # of full albedo: 4 standard deviations of the 3 % that reflected light adds
LIT_SHADING = 0.2  # of full albedo: what reflected light fills shadows with is less
TOO_BRIGHT = 0.25  # of full albedo: beyond the 99 percentile of reflected light
CONTOUR_STEP = 2.5  # [px] how far outside of its contour a pose is asked whether the surface goes on


class Tolerances(NamedTuple):
    """What still counts as the same."""

    depth: Float[Array, ""]  # along the normal [mm]
    needle: Float[Array, ""]  # [rad]
    jump: Float[Array, ""]  # step between two surfaces [mm]
    # [px] from an observed edge within which a contour counts as found; 0: where depth ends or isn't known, it is found
    edge: Float[Array, ""] | float = 0.0


class Verdict(NamedTuple):
    """Counts of window pixels and of contour points per hypothesis (JAX arrays inside of compiled functions)."""

    agreeing: Float[np.ndarray, "*h"]  # depth agrees, and so do the needles where there are any
    closeness: Float[np.ndarray, "*h"]  # sum over agreeing pixels of 1 - (gap / tolerance)^2, half depth, half needle
    needles_agreeing: Float[np.ndarray, "*h"]  # of these, pixels with an agreeing needle
    contradicting: Float[np.ndarray, "*h"]  # the scene is behind the pose, or its needle points elsewhere
    hidden: Float[np.ndarray, "*h"]  # something is nearer
    contour_found: Float[np.ndarray, "*h"]  # contour points outside of which the surface ends
    contour_missed: Float[np.ndarray, "*h"]  # contour points outside of which it goes on as if there were no contour


def verify_one(
    R_cam_obj: Float[Array, "3 3"], predicted: Predicted, observed: ObservedMaps,
    normal_obj: Float[Array, "triangles 3"], tolerances: Tolerances, size: int, stride: Int[Array, ""] | int,
) -> Verdict:
    """The verdict on one hypothesis at the pixels of its window."""
    window = look_up(observed, predicted.origin_uv, size, stride)
    hit = (predicted.triangle >= 0) & (window.depth > 0)
    blind = (predicted.triangle >= 0) & (window.depth <= 0) & (tolerances.edge > 0)
    normal = normal_obj[predicted.triangle] @ R_cam_obj.T
    gap = window.depth - predicted.depth
    across = gap * jnp.maximum(jnp.abs(normal[..., 2]), 0.2)
    near = hit & (jnp.abs(across) < tolerances.depth)
    needle = window.needle_weight > 0
    cosine = jnp.sum(window.normals * normal, axis=-1)
    same = cosine > jnp.cos(tolerances.needle)
    agree = near & (~needle | same)
    contradict = hit & ((across >= tolerances.depth) | (near & needle & ~same))
    hidden = hit & (across <= -tolerances.depth)
    lit, too_bright = shading_support(normal, window.uv, observed)
    alike = blind & ~too_bright & jnp.where(needle, same, lit)
    unlike = blind & (too_bright | (needle & ~same))

    found, missed = contour_support(predicted, observed, tolerances, size)

    def total(mask: Bool[Array, "s s"]) -> Float[Array, ""]:
        return jnp.sum(mask.astype(jnp.float32))

    turn = jnp.clip((1.0 - cosine) / (1.0 - jnp.cos(tolerances.needle)), 0.0, 1.0)
    close = 1.0 - 0.5 * jnp.square(jnp.clip(across / tolerances.depth, -1.0, 1.0)) - 0.5 * jnp.where(needle, turn, 0.5)
    closeness = jnp.sum(jnp.where(agree, close, 0.0)) + BLIND * jnp.sum(jnp.where(alike, 1.0 - 0.5 * turn, 0.0))
    of_pixels = (
        total(agree) + BLIND * total(alike), closeness, total(agree & needle) + BLIND * total(alike & needle),
        total(contradict) + BLIND * total(unlike), total(hidden),
    )
    values: Any = (*of_pixels, found, missed)
    return Verdict(*values)


def shading_support(
    normal: Float[Array, "s s 3"], uv: Float[Array, "s s 2"], observed: ObservedMaps
) -> tuple[Bool[Array, "s s"], Bool[Array, "s s"]]:
    """Where two lights or more show what the pose's normal predicts, and where one shows more than it can.

    A light that shows less may be in shadow there: it says nothing.
    """
    height, width, lights = observed.shading.shape
    if lights == 0:
        nothing = jnp.zeros(normal.shape[:2], bool)
        return nothing, nothing
    u, v = jnp.moveaxis(uv, -1, 0).astype(jnp.int32)
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    seen = observed.shading[jnp.clip(v, 0, height - 1), jnp.clip(u, 0, width - 1)]
    expected = jnp.maximum(normal @ observed.light_directions.T, 0.0)
    shown = (jnp.abs(seen - expected) < SAME_SHADING) & (expected > LIT_SHADING)
    return inside & (shown.sum(-1) >= 2), inside & ((seen - expected).max(-1) > TOO_BRIGHT)


def contour_support(
    predicted: Predicted, observed: ObservedMaps, tolerances: Tolerances, size: int
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Contour points outside of which the observed surface ends, and those where it goes on."""
    z = predicted.contour_depth
    if z.size == 0:
        return jnp.zeros(()), jnp.zeros(())
    hit = predicted.triangle >= 0
    depth = jnp.where(hit, predicted.depth, jnp.inf)
    right = jnp.concatenate([depth[:, 1:], jnp.full((size, 1), jnp.inf)], axis=1)
    below = jnp.concatenate([depth[1:], jnp.full((1, size), jnp.inf)], axis=0)
    toward = jnp.stack([jnp.where(depth <= right, 1.0, -1.0), jnp.where(depth <= below, 1.0, -1.0)])
    axis = jnp.stack([jnp.array([1.0, 0.0]), jnp.array([0.0, 1.0])])[:, None, None, :]
    shift = CONTOUR_STEP * toward[..., None] * axis
    height, width = observed.depth.shape

    def depth_at(uv):
        ij = jnp.round(uv).astype(jnp.int32)
        inside = (ij[..., 0] >= 0) & (ij[..., 0] < width) & (ij[..., 1] >= 0) & (ij[..., 1] < height)
        value = observed.depth[jnp.clip(ij[..., 1], 0, height - 1), jnp.clip(ij[..., 0], 0, width - 1)]
        return jnp.where(inside, value, 0.0)

    inner = depth_at(predicted.contour_uv - shift)
    outer = depth_at(predicted.contour_uv + shift)
    # only where the contour itself is seen: inside of it the scene is at the pose's depth
    seen = (z > 0) & (inner > 0) & (jnp.abs(inner - z) < tolerances.jump)
    steps = (outer > 0) & (jnp.abs(outer - inner) > 0.5 * tolerances.jump)
    # depth sensors lose the far side of a step: where nothing was measured outside, the surface has ended
    by_depth = steps | (outer <= 0)
    # depth from two cameras isn't known where no needle is: there an edge in the images has to tell
    at_edge = edge_distance(predicted.contour_uv, observed) < tolerances.edge
    ends = jnp.where(tolerances.edge > 0, steps | at_edge, by_depth)
    blind = (z > 0) & (inner <= 0) & (tolerances.edge > 0)

    def total(known: Bool[Array, "*n"], unknown: Bool[Array, "*n"]) -> Float[Array, ""]:
        return jnp.sum(known.astype(jnp.float32)) + BLIND * jnp.sum(unknown.astype(jnp.float32))

    return total(seen & ends, blind & at_edge), total(seen & ~ends, blind & ~at_edge)


def edge_distance(uv: Float[Array, "*n 2"], observed: ObservedMaps) -> Float[Array, "*n"]:
    """How far [px] the nearest observed edge point is; infinite outside of the image."""
    height, width = observed.edge_label.shape
    ij = jnp.round(2.0 * uv).astype(jnp.int32)
    inside = (ij[..., 0] >= 0) & (ij[..., 0] < width) & (ij[..., 1] >= 0) & (ij[..., 1] < height)
    label = observed.edge_label[jnp.clip(ij[..., 1], 0, height - 1), jnp.clip(ij[..., 0], 0, width - 1)]
    return jnp.where(inside, jnp.linalg.norm(uv - observed.edge_uv[label], axis=-1), jnp.inf)


@partial(jax.jit, static_argnames=("size",))
def verify_batch(
    R_cam_obj: Float[Array, "hypotheses 3 3"], predicted: Predicted, observed: ObservedMaps,
    normal_obj: Float[Array, "triangles 3"], tolerances: Tolerances, size: int, stride: Int[Array, ""] | int,
) -> Verdict:
    def one(R: Float[Array, "3 3"], seen: Predicted) -> Verdict:
        return verify_one(R, seen, observed, normal_obj, tolerances, size, stride)

    return jax.vmap(one)(R_cam_obj, predicted)


def verify(
    hypotheses: Hypotheses, model: RefineModel, observed: ObservedMaps, camera: Camera, tolerances: Tolerances,
    size: int, jump: float | None, others: Sequence[OtherView] = (),
) -> tuple[Verdict, Float[np.ndarray, "hypotheses 2"], int]:
    """Renders every hypothesis and compares. Returns the verdicts, window origins [px] and the stride [px].

    Without a `jump` contours aren't looked for, and none is found or missed. What other cameras say is added to the
    counts.
    """
    count = len(hypotheses.t_cam_obj)
    R, t = padded(hypotheses, size)
    stride = window_stride(camera, model.reach, float(np.median(t[:, 2])), size)
    verdict, origin = _verify_in(R, t, model, observed, camera, tolerances, size, stride, jump)
    for view in others:
        there, _ = _verify_in(*view.poses(R, t), model, view.observed, view.camera, tolerances, size, stride, jump)
        counts: Any = (here + other for here, other in zip(verdict, there, strict=True))
        verdict = Verdict(*counts)
    return Verdict(*(v[:count] for v in verdict)), origin[:count], stride


def _verify_in(
    R: Float[np.ndarray, "h 3 3"], t: Float[np.ndarray, "h 3"], model: RefineModel, observed: ObservedMaps,
    camera: Camera, tolerances: Tolerances, size: int, stride: int, jump: float | None,
) -> tuple[Verdict, Float[np.ndarray, "h 2"]]:
    origin = window_origins(camera, t, size, stride)
    found = correspondences(model.mesh, R, t, camera, origin, size, stride, model.reach, jump)
    verdict_of = partial(
        verify_batch, observed=observed, normal_obj=model.normal_obj, tolerances=tolerances, size=size,
        stride=jnp.int32(stride),
    )
    return in_batches(verdict_of, size, R, as_predicted(found, origin)), origin


def visible_centres(
    hypotheses: Hypotheses, model: RefineModel, camera: Camera, size: int
) -> Float[np.ndarray, "hypotheses 3"]:
    """Mean of the surface points that each pose shows, camera frame [mm]; its origin where it shows none."""
    count = len(hypotheses.t_cam_obj)
    R, t = padded(hypotheses, size)
    stride = window_stride(camera, model.reach, float(np.median(t[:, 2])), size)
    origin = window_origins(camera, t, size, stride)
    found = correspondences(model.mesh, R, t, camera, origin, size, stride, model.reach)
    j, i = np.meshgrid(np.arange(size), np.arange(size))
    uv = origin[:, None, None] + stride * np.stack([j, i], axis=-1)
    X_cam = camera.unproject(uv, found.depth)
    hit = (found.triangle >= 0)[..., None]
    number = hit.sum(axis=(1, 2))
    mean = np.where(hit, X_cam, 0.0).sum(axis=(1, 2)) / np.maximum(number, 1)
    return np.where(number > 0, mean, t)[:count].astype(np.float32)
