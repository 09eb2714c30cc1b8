"""Verification by rendering: which pixels agree with a pose, contradict it, or are hidden by something nearer."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from itree_kernels.agreement import agreement_kernel, count_rows, limits_of, row_counts, summed
from itree_kernels.camera import Camera
from itree_kernels.scene_maps import SeenBy
from itree_kernels.shown_centre import centre_kernel, centres, mean_shown
from itree_kernels.windows import Windows
from jaxtyping import Float, Int

from itree_jax.refinement.observed import ObservedMaps, seen_by
from itree_jax.refinement.optimise import (
    Hypotheses,
    OtherView,
    RefineModel,
    cast_in,
    window_stride,
)
from itree_jax.sensing.needle import Array


class Tolerances(NamedTuple):
    """What still counts as the same."""

    depth: Float[Array, ""]  # along the normal [mm]
    needle: Float[Array, ""]  # [rad]
    jump: Float[Array, ""]  # step between two surfaces [mm]
    # [px] from an observed edge within which a contour counts as found; 0: where depth ends or isn't known, it is found
    edge: Float[Array, ""] | float = 0.0


class Verdict(NamedTuple):
    """Counts of window pixels and of contour points per hypothesis. A pixel or a contour point without depth, where
    only needles, shading or an edge tell, counts half (see `itree_kernels.agreement`)."""

    agreeing: Float[np.ndarray, "*h"]  # depth agrees, and so do the needles where there are any
    closeness: Float[np.ndarray, "*h"]  # sum over agreeing pixels of 1 - (gap / tolerance)^2, half depth, half needle
    needles_agreeing: Float[np.ndarray, "*h"]  # of these, pixels with an agreeing needle
    contradicting: Float[np.ndarray, "*h"]  # the scene is behind the pose, or its needle points elsewhere
    hidden: Float[np.ndarray, "*h"]  # something is nearer
    contour_found: Float[np.ndarray, "*h"]  # contour points outside of which the surface ends
    contour_missed: Float[np.ndarray, "*h"]  # contour points outside of which it goes on as if there were no contour
    contour_flush: Float[np.ndarray, "*h"]  # of these, where the face itself goes on: in its plane

    def take(self, index: Int[np.ndarray, "kept"]) -> "Verdict":
        return Verdict(*(counts[index] for counts in self))


def verify(
    hypotheses: Hypotheses, model: RefineModel, observed: ObservedMaps | SeenBy, camera: Camera,
    tolerances: Tolerances, size: int, jump: float | None, others: Sequence[OtherView] = (),
) -> tuple[Verdict, Float[np.ndarray, "hypotheses 2"], int]:
    """Renders every hypothesis and compares. Returns the verdicts, window origins [px] and the stride [px].

    Without a `jump` contours aren't looked for, and none is found or missed. What other cameras say is added to the
    counts.
    """
    R, t = (np.asarray(a, np.float32) for a in hypotheses)
    stride = window_stride(camera, model.reach, float(np.median(t[:, 2])), size)
    counts, origin = _counts_in(R, t, model, seen_by(observed, camera), tolerances, size, stride, jump)
    for view in others:
        counts = counts + _counts_in(*view.poses(R, t), model, view.seen_by, tolerances, size, stride, jump)[0]
    verdict: Any = counts.T
    return Verdict(*verdict), origin, stride


def _counts_in(
    R: Float[np.ndarray, "h 3 3"], t: Float[np.ndarray, "h 3"], model: RefineModel, by: SeenBy, tolerances: Tolerances,
    size: int, stride: int, jump: float | None,
) -> tuple[Float[np.ndarray, "h 8"], Float[np.ndarray, "h 2"]]:
    limits = limits_of(*(float(v) for v in tolerances), off=0.5 * stride if model.rough else 0.0)
    counts = row_counts(len(t), size, model.mesh.device)

    def count(seen, first: int, last: int) -> None:
        count_rows(seen, by, model.mesh.normals_obj, limits, first, last, counts)

    seen = cast_in(by.camera, R, t, model, size, stride, jump, count, agreement_kernel)
    return summed(counts), seen.origin_uv.numpy()


def visible_centres(
    hypotheses: Hypotheses, model: RefineModel, camera: Camera, size: int
) -> Float[np.ndarray, "hypotheses 3"]:
    """Mean of the surface points that each pose shows, camera frame [mm]; its origin where it shows none."""
    R, t = (np.asarray(a, np.float32) for a in hypotheses)
    stride = window_stride(camera, model.reach, float(np.median(t[:, 2])), size)
    centre = centres(len(t), model.mesh.device)

    def mean(seen: Windows, first: int, last: int) -> None:
        mean_shown(seen, camera, first, last, centre)

    cast_in(camera, R, t, model, size, stride, None, mean, centre_kernel)
    return centre.numpy()
