"""Segments: surface that hangs together in the depth map, lit or not."""

import cv2
import numpy as np
from jaxtyping import Float, Int

from itree_jax.sensing.depth_steps import depth_step_limit
from itree_jax.sensor import Sensor


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
        votes = np.bincount(segments[mine], minlength=1)
        votes[0] = 0
        own = X_cam[mine & (depth > 0)]
        centres.append(mean[int(votes.argmax())] if votes.any() else own.mean(axis=0))
    return np.array(centres).reshape(-1, 3)
