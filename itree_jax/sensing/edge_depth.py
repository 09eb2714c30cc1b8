"""Steps of a depth map: at edge points of the images, and where no light shows one."""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float

from itree_jax.sensing.depth_steps import depth_step_limit
from itree_jax.sensing.edge_points import EdgePoints, joined, nearest, sampled
from itree_jax.sensor import Sensor

DEPTH_BOX = 5  # [px] depth is averaged over so much: 0.3 mm of noise becomes 0.06
# [px] where depth is looked up: the nearest box stays on its side of the edge; over 3 px a slope errs by 3 degrees.
DEPTH_PLACES = ((2.5, 5.5), (2.0, 4.0), (3.5, 7.5))
ACROSS = 1.5  # [px] to each side of a depth step: it has room for the half pixel that depth and image may differ by
UNLIT = 2.5  # [px] from the edge points of the images: the depth map's step and theirs are one within that


class DepthSides(NamedTuple):
    """NaN where the depth map has a hole."""

    step: Float[np.ndarray, "points"]  # [mm] beyond what the slopes of both sides allow; > 0 if `direction` goes back
    is_step: Bool[np.ndarray, "points"]
    turn: Float[np.ndarray, "points"]  # [rad] between the slopes across the edge: > 0 convex, < 0 concave


def depth_sides(
    depth: Float[np.ndarray, "height width"], sensor: Sensor, uv: Float[np.ndarray, "points 2"],
    direction: Float[np.ndarray, "points 2"],
) -> DepthSides:
    """A step is what the depth changes by across the edge beyond the slopes of its two sides."""
    known = depth > 0.0
    smooth = _mean_of_known(depth, known)
    median = cv2.medianBlur(np.ascontiguousarray(depth, np.float32), 3)
    near, far = (nearest(median, uv + t * direction) for t in (-ACROSS, ACROSS))
    middle = 0.5 * (near + far) if sensor.camera.kind == "pinhole" else np.ones_like(near)
    mm = sensor.camera.mm_per_px(1.0) * np.where(middle > 0.0, middle, 1.0)
    slopes = [_slopes(smooth, uv, direction, *places) for places in DEPTH_PLACES]
    turns = np.stack([np.arctan(b / mm) - np.arctan(a / mm) for a, b in slopes])
    turn = np.take_along_axis(turns, np.argmin(np.abs(turns), axis=0)[None], axis=0)[0]  # NaN if one is
    before, after = slopes[0]
    least, most = 2.0 * ACROSS * np.minimum(before, after), 2.0 * ACROSS * np.maximum(before, after)
    change = np.where((near > 0.0) & (far > 0.0), far - near, np.nan)
    step = np.maximum(change - most, 0.0) - np.maximum(least - change, 0.0)
    is_step = np.nan_to_num(np.abs(step)) > depth_step_limit(depth, known, sensor)
    return DepthSides(step, is_step, turn)


def unlit_steps(
    depth: Float[np.ndarray, "height width"], sensor: Sensor, lit: EdgePoints
) -> EdgePoints:
    """Depth steps farther than `UNLIT` from every edge point of the images: half-pixel places, `change` 0."""
    known = depth > 0.0
    limit = depth_step_limit(depth, known, sensor)
    median = cv2.medianBlur(np.ascontiguousarray(depth, np.float32), 3)
    free = np.ones(depth.shape, np.uint8)
    column, row = np.round(lit.uv.T).astype(int)
    free[row, column] = 0
    free = cv2.distanceTransform(free, cv2.DIST_L2, 5) > UNLIT
    blurred = cv2.GaussianBlur(median, (0, 0), 1.0)
    back = np.stack([cv2.Sobel(blurred, cv2.CV_32F, *d, ksize=3) for d in ((1, 0), (0, 1))])
    found = []
    for axis, aside in ((1, np.array([0.5, 0.0])), (0, np.array([0.0, 0.5]))):
        step = np.abs(np.diff(median, axis=axis))
        both = known & np.roll(known, -1, axis=axis) & free
        both = np.delete(both, -1, axis=axis)
        around = (1, 3) if axis == 1 else (3, 1)
        thin = step >= cv2.dilate(step, np.ones(around, np.uint8))  # a steep face makes several in a row
        rows, columns = np.nonzero(both & thin & (step > limit))
        g = back[:, rows, columns].T.astype(np.float64)
        length = np.linalg.norm(g, axis=1)
        # Along a step nearly parallel to the axis, the other axis has the better place.
        main = (length > 0.0) & (np.abs(g[:, 1 - axis]) >= np.sqrt(0.5) * length)
        uv = np.stack([columns, rows], axis=-1) + aside
        found.append(EdgePoints(uv[main], g[main] / length[main, None], np.zeros(int(main.sum()))))
    points = joined(*found)
    real = depth_sides(depth, sensor, points.uv, points.direction).is_step
    return EdgePoints(*(a[real] for a in points))


def _slopes(
    smooth: Float[np.ndarray, "height width"], uv: Float[np.ndarray, "points 2"],
    direction: Float[np.ndarray, "points 2"], near: float, far: float,
) -> tuple[Float[np.ndarray, "points"], Float[np.ndarray, "points"]]:
    """Change of depth per pixel [mm] along the direction, on the side before the edge and after it; NaN at holes."""
    z = [sampled(smooth, uv + t * direction) for t in (-far, -near, near, far)]
    there = np.all([nearest(smooth, uv + t * direction) > 0.0 for t in (-far, -near, near, far)], axis=0)
    before, after = (z[1] - z[0]) / (far - near), (z[3] - z[2]) / (far - near)
    return np.where(there, before, np.nan), np.where(there, after, np.nan)


def _mean_of_known(
    depth: Float[np.ndarray, "height width"], known: Bool[np.ndarray, "height width"]
) -> Float[np.ndarray, "height width"]:
    """Mean of the known depths in a box, 0 where it has none."""
    box, weight = (DEPTH_BOX, DEPTH_BOX), known.astype(np.float32)
    total = cv2.boxFilter(np.where(known, depth, 0.0).astype(np.float32), -1, box, normalize=False)
    count = cv2.boxFilter(weight, -1, box, normalize=False)
    return np.where(count > 0.5, total / np.maximum(count, 1.0), 0.0)
