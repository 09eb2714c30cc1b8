"""Segments: surface that hangs together in the depth map, lit or not."""

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from itree_jax.sensing.depth_steps import depth_step_limit
from itree_jax.sensor import Sensor

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


def segment_areas(
    labels: Int[np.ndarray, "height width"], depth: Float[np.ndarray, "height width"], sensor: Sensor
) -> Float[np.ndarray, "regions"]:
    """Area [mm^2], across the line of sight, of the segment that holds most of each region."""
    segments = depth_segments(depth, sensor)
    pixels = np.bincount(segments.ravel())
    mean_depth = np.bincount(segments.ravel(), depth.ravel().astype(float)) / np.maximum(pixels, 1)
    held_by = [_most_of(segments, labels == region) for region in range(int(labels.max(initial=-1)) + 1)]
    return np.array([pixels[k] * sensor.camera.mm_per_px(float(mean_depth[k])) ** 2 for k in held_by])


def _most_of(segments: Int[np.ndarray, "height width"], mask: Bool[np.ndarray, "height width"]) -> int:
    """The segment with most of the mask's pixels; 0 when none has any."""
    votes = np.bincount(segments[mask], minlength=1)
    votes[0] = 0
    return int(votes.argmax())


def segment_centres(
    labels: Int[np.ndarray, "height width"], depth: Float[np.ndarray, "height width"], sensor: Sensor
) -> Float[np.ndarray, "regions 3"]:
    """Mean surface point [mm] of the segment that holds most of each region, camera frame; the region's own if none."""
    segments = depth_segments(depth, sensor)
    v, u = np.indices(depth.shape)
    X_cam = sensor.camera.unproject(np.stack([u, v], axis=-1).astype(float), depth.astype(float))
    total = np.stack([np.bincount(segments.ravel(), X_cam[..., k].ravel()) for k in range(3)], axis=-1)
    mean = total / np.maximum(np.bincount(segments.ravel()), 1)[:, None]
    centres = []
    for region in range(int(labels.max(initial=-1)) + 1):
        mine = labels == region
        own = X_cam[mine & (depth > 0)]
        most = _most_of(segments, mine)
        centres.append(mean[most] if most else own.mean(axis=0))
    return np.array(centres).reshape(-1, 3)
