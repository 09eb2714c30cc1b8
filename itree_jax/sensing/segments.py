"""Segments: surface that hangs together in the depth map, lit or not."""

from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np
from jaxtyping import Float, Int

from itree_jax.sensing.depth_steps import depth_step_limit
from itree_jax.sensor import Sensor

COARSE = 2  # [px] of the pixels that tell how far a segment reaches
CORNERS = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if d > (0.0, 0.0, 0.0)])  # one of each two opposites
DIRECTIONS = CORNERS / np.linalg.norm(CORNERS, axis=1, keepdims=True)  # axes and diagonals of a cube: within 28 degrees
FOLD, FOLD_REACH = np.radians(20.0), 2  # between normals this many pixels apart: five deviations of a depth map's


def depth_segments(depth: Float[np.ndarray, "height width"], sensor: Sensor) -> Int[np.ndarray, "height width"]:
    """Label of the connected surface at each pixel; 0 at depth steps and where there is no depth.

    At a step is a pixel that differs from its right or lower neighbour by more than one surface can (after a median of
    3 x 3, which takes the worst of the noise out).
    """
    known = depth > 0
    limit = depth_step_limit(depth, known, sensor)
    smooth = cv2.medianBlur(np.ascontiguousarray(depth, np.float32), 3)
    inside = known.astype(np.uint8)
    inside[:-1][np.abs(np.diff(smooth, axis=0)) > limit] = 0
    inside[:, :-1][np.abs(np.diff(smooth, axis=1)) > limit] = 0
    return cv2.connectedComponents(inside, connectivity=4)[1]


def faces_of_segments(
    segments: Int[np.ndarray, "height width"], normals: Float[np.ndarray, "height width 3"]
) -> Int[np.ndarray, "height width"]:
    """Segments (0 = none) parted where their `normals` (0 = unknown) turn: in the folds in which parts touch one
    another, and at a part's own edges.
    """
    known = (normals != 0).any(axis=-1)
    inside = (segments > 0) & known
    for n, k, mask in ((normals, known, inside), (normals.swapaxes(0, 1), known.T, inside.T)):  # along columns, rows
        folded = (n[:-FOLD_REACH] * n[FOLD_REACH:]).sum(axis=-1) < np.cos(FOLD)
        folded &= k[:-FOLD_REACH] & k[FOLD_REACH:]
        for step in range(FOLD_REACH + 1):
            mask[step : step + len(folded)] &= ~folded
    pieces = cv2.connectedComponents(inside.astype(np.uint8), connectivity=4)[1]
    return np.where(inside, pieces, 0)


@dataclass(frozen=True)
class HeldBy:
    """Of every region, the segment that holds most of it."""

    segment: Int[np.ndarray, "regions"]  # regions of one segment have one number
    area_mm2: Float[np.ndarray, "regions"]  # of the segment, across the line of sight [mm^2]
    centre: Float[np.ndarray, "regions 3"]  # its mean surface point, camera frame [mm]
    extent_mm: Float[np.ndarray, "regions"]  # two of its points are at least so far apart [mm]; 0 where nothing tells


def held_by(
    labels: Int[np.ndarray, "height width"], depth: Float[np.ndarray, "height width"], sensor: Sensor,
    segments: Int[np.ndarray, "height width"] | None = None,
) -> HeldBy:
    """The segments that hold these regions; a region of which no pixel is on a segment stands for one itself.

    `segments`: those of the depth map, if they are known already.
    """
    camera, count = sensor.camera, int(labels.max(initial=-1)) + 1
    segments = depth_segments(depth, sensor) if segments is None else segments
    inside, some = labels >= 0, int(segments.max()) + 1
    votes = np.bincount(labels[inside] * some + segments[inside], minlength=count * some).reshape(count, some)
    votes[:, 0] = 0
    most = votes.argmax(axis=1)
    most[most == 0] = some + np.flatnonzero(most == 0)
    number = np.unique(most)
    place = np.full(some + count, -1)
    place[number] = np.arange(len(number))
    held = place[segments]
    for region in np.flatnonzero(most >= some):
        held[labels == region] = place[most[region]]
    v, u = np.nonzero((held >= 0) & (depth > 0))
    X_cam = camera.unproject(np.stack([u, v], axis=-1).astype(float), depth[v, u].astype(float))
    of = held[v, u]
    pixels = np.maximum(np.bincount(of, minlength=len(number)), 1)
    mean = np.stack([np.bincount(of, x, len(number)) for x in X_cam.T], axis=-1) / pixels[:, None]
    at = np.searchsorted(number, most)
    some_pixels = (v % COARSE == 0) & (u % COARSE == 0)
    extent = extents(X_cam[some_pixels], of[some_pixels], len(number))
    return HeldBy(most, pixels[at] * np.square(camera.mm_per_px(mean[at, 2])), mean[at], extent[at])


def extents(
    X_cam: Float[np.ndarray, "points 3"], of: Int[np.ndarray, "points"], count: int
) -> Float[np.ndarray, "count"]:
    """How far the points [mm] of each set reach in the one of 13 directions in which that is most; 0 without points."""
    order = np.argsort(of, kind="stable")
    there, first = np.unique(of[order], return_index=True)
    extent = np.zeros(count)
    if len(there):
        along = (X_cam @ DIRECTIONS.T)[order]
        reach = np.maximum.reduceat(along, first) - np.minimum.reduceat(along, first)
        extent[there] = reach.max(axis=1)
    return extent
