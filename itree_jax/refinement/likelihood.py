"""The log-likelihood of a pose, pixel by pixel: how much better it explains what was seen than if it were not there.

Counts of agreeing pixels rank rough poses. Two poses of one place that differ by a small feature are told apart by the
pixels in which they differ, at the image's own resolution, under the sensor's errors. Something else may lie at any
depth within reach and face any way; a pixel that something nearer hides says nothing; one behind the pose says that the
pose is not there.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

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
)
from itree_jax.refinement.residuals import Predicted, look_up
from itree_jax.refinement.verify import LIT_SHADING, edge_distance
from itree_jax.sensing.needle import Array

SIZE = 192  # window pixels: the image's own for parts of up to 90 pixels' reach
WINDOW = 2.25  # of the part's reach: also where it lies an eighth nearer than the working distance
SEEN_THROUGH = 0.005  # share of pixels at which a sensor sees farther than a surface that is there
OUTLIERS = 0.15  # share of needles and brightnesses that reflected light or a highlight makes anything
IN_SHADOW = 0.4  # share of a surface's pixels that a light doesn't reach, about: half is lit by all of three
SHADING_STD = 0.06  # of full albedo: what reflected light and needles' noise add
BRIGHTEST = 1.3  # of full albedo: something else shades anywhere between 0 and this
EDGE_FOUND = 0.85  # share of a true contour's points with an observed edge beside them
EDGE_BY_CHANCE = 0.3  # share of other points that have one
BLIND = 0.3  # weight of a pixel without depth: the shading of neighbours errs together
BORDER = 0.2  # [px] by which a pose's own error moves a slanted surface


class SensorErrors(NamedTuple):
    """What the likelihood reckons with: standard deviations, and how far apart things may lie."""

    depth: Float[Array, ""]  # [mm] of one pixel
    needle: Float[Array, ""]  # [rad]
    reach: Float[Array, ""]  # [mm] of depth over which something else may lie: the part's diameter
    pitch: Float[Array, ""]  # [mm] of a pixel at the working distance
    edge: Float[Array, ""]  # [px] as in `Tolerances`; 0: contours are steps of depth, which the pixels tell


class Support(NamedTuple):
    """Log-likelihood ratios [nats] of a batch of poses, in windows of the first camera."""

    pixels: Float[np.ndarray, "h s s"]  # above 0: the pose explains the pixel; below: it contradicts it
    hidden: Bool[np.ndarray, "h s s"]  # pixels of the pose behind something nearer
    lit: Float[np.ndarray, "h"]  # window pixels that speak for the pose and that a light shows
    beside: Float[np.ndarray, "h"]  # of contours and of other cameras
    origin_uv: Float[np.ndarray, "h 2"]  # image point of window pixel (0, 0) [px]
    stride: int  # [px]

    def joined(self, other: "Support") -> "Support":
        """Both lists, one after the other; of one part, so of one stride."""
        assert self.stride == other.stride
        arrays = (np.concatenate(pair) for pair in zip(self[:-1], other[:-1], strict=True))
        return Support(*arrays, stride=self.stride)

    def take(self, index: Int[np.ndarray, "kept"]) -> "Support":
        return Support(*(values[index] for values in self[:-1]), stride=self.stride)


def likelihood_one(
    R_cam_obj: Float[Array, "3 3"], predicted: Predicted, observed: ObservedMaps,
    normal_obj: Float[Array, "triangles 3"], errors: SensorErrors, size: int, stride: Int[Array, ""] | int,
) -> tuple[Float[Array, "s s"], Bool[Array, "s s"], Float[Array, ""], Float[Array, ""]]:
    """Log-likelihood ratio [nats] of each window pixel, which are hidden, how many speak for the pose and are lit, and
    the log-likelihood ratio of the contour.
    """
    window = look_up(observed, predicted.origin_uv, size, stride)
    inner = (predicted.triangle >= 0) & ~steps(predicted.depth, 4.0 * errors.pitch * stride)
    normal = normal_obj[predicted.triangle] @ R_cam_obj.T
    facing = jnp.clip(jnp.abs(normal[..., 2]), 0.15, 1.0)
    gap = window.depth - predicted.depth
    std = jnp.hypot(errors.depth, BORDER * errors.pitch / facing)
    known = window.depth > 0
    by_depth = depth_ratio(gap, std, errors.reach)
    near = known & (jnp.abs(gap) < 4.0 * std)
    needle = window.needle_weight > 0
    by_needle = needle_ratio(jnp.sum(window.normals * normal, axis=-1), errors.needle)
    by_shading, lit = shading_ratio(normal, window.uv, observed)
    alone = jnp.where(needle, by_needle, by_shading)  # of a pixel without depth
    pixels = jnp.where(known, by_depth + jnp.where(near & needle, by_needle, 0.0), BLIND * alone)
    pixels = jnp.where(inner, pixels, 0.0)
    hidden = inner & known & (gap < -4.0 * std)
    shown = jnp.sum((lit & (pixels > 0.0)).astype(jnp.float32))
    return pixels, hidden, shown, contour_ratio(predicted, observed, errors)


def contour_ratio(predicted: Predicted, observed: ObservedMaps, errors: SensorErrors) -> Float[Array, ""]:
    """log p(edges beside the contour | pose) / p(edges | anything); 0 where no contours were looked for.

    Contour points are counted along rows and along columns: each has half a vote.
    """
    if predicted.contour_depth.size == 0:
        return jnp.zeros(())
    found = edge_distance(predicted.contour_uv, observed) < errors.edge
    seen = (predicted.contour_depth > 0) & (errors.edge > 0)
    yes, no = jnp.log(EDGE_FOUND / EDGE_BY_CHANCE), jnp.log((1.0 - EDGE_FOUND) / (1.0 - EDGE_BY_CHANCE))
    return 0.5 * jnp.sum(jnp.where(seen, jnp.where(found, yes, no), 0.0))


def steps(depth: Float[Array, "s s"], jump: Float[Array, ""] | float) -> Bool[Array, "s s"]:
    """Pixels beside which the predicted depth steps by more than `jump` [mm] or ends: their raster tells nothing."""
    far = jnp.pad(depth, 1)
    around = [far[1:-1, 2:], far[1:-1, :-2], far[2:, 1:-1], far[:-2, 1:-1]]
    return jnp.stack([jnp.abs(a - depth) > jump for a in around]).any(axis=0)


def depth_ratio(
    gap: Float[Array, "*n"], std: Float[Array, "*n"], reach: Float[Array, ""]
) -> Float[Array, "*n"]:
    """log p(depth | pose) / p(depth | something else) of observed less predicted depth [mm]."""
    fits = reach / (std * jnp.sqrt(2.0 * jnp.pi)) * jnp.exp(-0.5 * jnp.square(gap / std))
    other = jnp.where(gap < 0.0, 1.0, SEEN_THROUGH)
    return jnp.log((1.0 - SEEN_THROUGH) * fits + other)


def needle_ratio(cosine: Float[Array, "*n"], std: Float[Array, ""]) -> Float[Array, "*n"]:
    """log p(needle | normal) / p(needle | anything): an isotropic Gaussian among outliers, against the half sphere."""
    squared = 2.0 * (1.0 - cosine)  # angle^2, where it matters
    return jnp.log((1.0 - OUTLIERS) / jnp.square(std) * jnp.exp(-0.5 * squared / jnp.square(std)) + OUTLIERS)


def shading_ratio(
    normal: Float[Array, "s s 3"], uv: Float[Array, "s s 2"], observed: ObservedMaps
) -> tuple[Float[Array, "s s"], Bool[Array, "s s"]]:
    """log p(brightness | normal) / p(brightness | anything) over the lights, and where any of them shows something.

    A light either reaches the surface, which then shows n . l, or doesn't, and it shows anything less.
    """
    height, width, lights = observed.shading.shape
    if lights == 0:
        return jnp.zeros(normal.shape[:2]), jnp.zeros(normal.shape[:2], bool)
    u, v = jnp.moveaxis(uv, -1, 0).astype(jnp.int32)
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    seen = observed.shading[jnp.clip(v, 0, height - 1), jnp.clip(u, 0, width - 1)]
    expected = jnp.maximum(normal @ observed.light_directions.T, 0.0)
    lit = jnp.exp(-0.5 * jnp.square((seen - expected) / SHADING_STD)) / (SHADING_STD * jnp.sqrt(2.0 * jnp.pi))
    less = jax.nn.sigmoid((expected - seen) / (0.5 * SHADING_STD)) / jnp.maximum(expected, SHADING_STD)
    ratio = BRIGHTEST * ((1.0 - IN_SHADOW) * lit + IN_SHADOW * less)
    total = jnp.sum(jnp.log((1.0 - OUTLIERS) * ratio + OUTLIERS), axis=-1)
    return jnp.where(inside, total, 0.0), inside & (seen.max(axis=-1) > LIT_SHADING)


@partial(jax.jit, static_argnames=("size",))
def likelihood_batch(
    R_cam_obj: Float[Array, "hypotheses 3 3"], predicted: Predicted, observed: ObservedMaps,
    normal_obj: Float[Array, "triangles 3"], errors: SensorErrors, size: int, stride: Int[Array, ""] | int,
) -> tuple[Float[Array, "h s s"], Bool[Array, "h s s"], Float[Array, "h"], Float[Array, "h"]]:
    def one(R: Float[Array, "3 3"], seen: Predicted):
        pixels, hidden, lit, contour = likelihood_one(R, seen, observed, normal_obj, errors, size, stride)
        return pixels.astype(jnp.float16), hidden, lit, contour

    return jax.vmap(one)(R_cam_obj, predicted)


def support(
    hypotheses: Hypotheses, model: RefineModel, observed: ObservedMaps, camera: Camera, errors: SensorErrors,
    jump: float, others: Sequence[OtherView] = (), size: int = SIZE,
) -> Support:
    """Renders every hypothesis and weighs each of its pixels. `jump` [mm]: least depth step of a contour."""
    count = len(hypotheses.t_cam_obj)
    R, t = padded(hypotheses, size)
    stride = max(1, int(np.ceil(WINDOW * model.reach / float(errors.pitch) / size)))
    edges = jump if float(errors.edge) > 0 else None  # where depth ends contours, the pixels have told already
    (pixels, hidden, lit, beside), origin = _seen_by(R, t, model, observed, camera, errors, size, stride, edges)
    for view in others:
        (there, _, _, contour), _ = _seen_by(
            *view.poses(R, t), model, view.observed, view.camera, errors, size, stride, edges
        )
        beside = beside + contour + np.sum(there, axis=(1, 2), dtype=np.float32)
    return Support(pixels[:count], hidden[:count], lit[:count], beside[:count], origin[:count], stride)


def _seen_by(
    R: Float[np.ndarray, "h 3 3"], t: Float[np.ndarray, "h 3"], model: RefineModel, observed: ObservedMaps,
    camera: Camera, errors: SensorErrors, size: int, stride: int, edges: float | None,
):
    origin = window_origins(camera, t, size, stride)
    found = correspondences(model.mesh, R, t, camera, origin, size, stride, model.reach, edges)
    of = partial(
        likelihood_batch, observed=observed, normal_obj=model.normal_obj, errors=errors, size=size,
        stride=jnp.int32(stride),
    )
    return in_batches(of, size, R, as_predicted(found, origin)), origin
