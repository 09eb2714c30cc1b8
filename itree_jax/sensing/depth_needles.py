"""Needles of a depth map: the normal of the surface through a pixel's neighbours, edges kept.

Under a pinhole a plane's inverse depth is linear in the image (n . X = d with X = z K^-1 (u, v, 1) gives
1/z = n . K^-1 (u, v, 1) / d), under an orthographic camera its depth is; so that one linear regression over a window
gives the normal of a plane exactly, whatever its slant. Windows compete for a pixel:

- the one around it, where a quadratic surface fits it: the slope in its middle is free of curvature, and what the
  third order adds follows from slope and curvature (`itree_kernels.window_fits`);
- beside a crease or a step, the best of eight that have the pixel on their border and lie on one plane (Nagao and
  Matsuyama 1979);
- where the surface curves too much for it, smaller ones around the pixel.
"""

from typing import NamedTuple

import cv2
import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.depth_normals import depth_normals
from jaxtyping import Bool, Float

RADIUS = 4  # [px]: 9 x 9 pixels; 0.3 mm of noise at half a millimetre per pixel turn a normal by 1.3 degrees
SMALLER = 2  # [px] that the smallest radius is less; 5 x 5 pixels turn a normal by four degrees
LEAST_KNOWN = 0.6  # of a window's pixels; the others take the plane through their neighbours


class DepthNeedles(NamedTuple):
    """Normals from depth."""

    normals: Float[np.ndarray, "height width 3"]  # unit, camera frame, toward the camera; 0 where none
    known: Bool[np.ndarray, "height width"]  # a surface fits a window as well as the noise allows
    normal_std: Float[np.ndarray, "height width"]  # rms angle [rad] by which the noise turns it; 0 where none


def depth_needles(
    depth: Float[np.ndarray, "height width"], camera: Camera, noise: float, radius: int = RADIUS
) -> DepthNeedles:
    """Normals of a depth map [mm] (0 = none) with noise of this standard deviation [mm]. Runs on the host.

    `known` is False where no window fits: on surfaces that are narrower than the smallest one or curve within it.
    """
    there = depth > 0.0
    z = np.where(there, depth, np.median(depth[there]) if there.any() else 1.0).astype(np.float64)
    value = z if camera.is_orthographic else 1.0 / z
    mean = float(value.mean())
    filled, full = _filled(value - mean, there, radius)
    least = max(radius - SMALLER, 1)
    return DepthNeedles(*depth_normals(z, there, filled, full, mean, camera, noise, radius, least))


def _filled(
    value: Float[np.ndarray, "height width"], there: Bool[np.ndarray, "height width"], radius: int
) -> tuple[Float[np.ndarray, "height width"], Bool[np.ndarray, "height width"]]:
    """Pixels without depth take the mean of a window's known ones; where those are too few, no window is to be used."""
    if there.all():
        return value, there
    side = (2 * radius + 1,) * 2

    def mean(field: np.ndarray) -> np.ndarray:
        return cv2.boxFilter(field, cv2.CV_64F, side, borderType=cv2.BORDER_CONSTANT)

    share = mean(there.astype(np.float64))
    around = mean(np.where(there, value, 0.0)) / np.maximum(share, 1e-9)
    return np.where(there, value, around), there | (share >= LEAST_KNOWN)
