"""Needles of a depth map: the normal of the plane through a pixel's neighbours, edges kept.

Under a pinhole a plane's inverse depth is linear in the image (n . X = d with X = z K^-1 (u, v, 1) gives
1/z = n . K^-1 (u, v, 1) / d), under an orthographic camera its depth is; so that one linear regression over a window
gives the normal of a plane exactly, whatever its slant. Windows beside the pixel compete with the one around it
(Nagao and Matsuyama 1979): at an edge the one that lies on one surface fits best.
"""

from typing import NamedTuple

import cv2
import numpy as np
from itree_kernels.camera import Camera
from jaxtyping import Bool, Float

RADIUS = 4  # [px]: 9 x 9 pixels; 0.3 mm of noise at half a millimetre per pixel turn a normal by 1.3 degrees
# A window fits when its residual is not above this times the noise: over 81 pixels the estimate of a deviation scatters
# by 1/sqrt(2 * 81) = 8 %, so that three such deviations are 1.24.
FIT = 1.25
LEAST_KNOWN = 0.6  # of a window's pixels must have depth
LEAST_NOISE = 1e-4  # [mm]: what float32 keeps of a metre


class DepthNeedles(NamedTuple):
    """Normals from depth."""

    normals: Float[np.ndarray, "height width 3"]  # unit, camera frame, toward the camera; 0 where none
    known: Bool[np.ndarray, "height width"]  # a plane fits the window as well as the noise allows
    normal_std: Float[np.ndarray, "height width"]  # rms angle [rad] by which the noise turns it; 0 where none


def depth_needles(
    depth: Float[np.ndarray, "height width"], camera: Camera, noise: float, radius: int = RADIUS
) -> DepthNeedles:
    """Normals of a depth map [mm] (0 = none) with noise of this standard deviation [mm]. Runs on the host.

    A pixel takes the normal of the window of (2 radius + 1)^2 pixels around it if that lies on one plane within the
    noise, else of the best of eight that have it on their border. `known` is False where none of them does: on surfaces
    that curve by more than the noise within a window.
    """
    there = depth > 0.0
    seen = np.where(there, depth, 1.0).astype(np.float64)
    plane, residual, share = _plane_fits(1.0 / seen if not camera.is_orthographic else seen, there, radius)
    if not camera.is_orthographic:
        residual = residual * np.where(there, depth, 0.0) ** 2  # dz = z^2 d(1/z)
    residual = np.where(there & (share >= LEAST_KNOWN), residual, np.inf)
    best, offset = _best_window(residual, radius, FIT * max(noise, LEAST_NOISE))
    normals = _normals(_taken(plane, offset, radius), camera)
    known = there & (best <= FIT * max(noise, LEAST_NOISE)) & (normals[..., 2] < 0.0)
    return DepthNeedles(
        np.where(known[..., None], normals, 0.0).astype(np.float32), known,
        np.where(known, _turning(depth, normals, camera, noise, radius), 0.0).astype(np.float32),
    )


def _plane_fits(
    value: Float[np.ndarray, "height width"], there: Bool[np.ndarray, "height width"], radius: int
) -> tuple[Float[np.ndarray, "height width 3"], Float[np.ndarray, "height width"], Float[np.ndarray, "height width"]]:
    """Of the window around each pixel: a, b, c of value = a u + b v + c, rms residual, share of known pixels."""
    v, u = np.indices(value.shape).astype(np.float64)
    mask = there.astype(np.float64)

    def mean(field: np.ndarray) -> np.ndarray:
        return cv2.boxFilter(field * mask, cv2.CV_64F, (2 * radius + 1,) * 2, borderType=cv2.BORDER_CONSTANT)

    share = mean(np.ones_like(mask))
    over = 1.0 / np.maximum(share, 1e-9)
    middle = float(value[there].mean()) if there.any() else 0.0
    w = value - middle  # the mean out of it: squares keep their digits
    mu, mv, mw = mean(u) * over, mean(v) * over, mean(w) * over
    uu, vv, uv = mean(u * u) * over - mu**2, mean(v * v) * over - mv**2, mean(u * v) * over - mu * mv
    uw, vw, ww = mean(u * w) * over - mu * mw, mean(v * w) * over - mv * mw, mean(w * w) * over - mw**2
    determinant = np.maximum(uu * vv - uv**2, 1e-9)
    a, b = (vv * uw - uv * vw) / determinant, (uu * vw - uv * uw) / determinant
    square = np.maximum(ww - a * uw - b * vw, 0.0)
    return np.stack([a, b, mw + middle - a * mu - b * mv], axis=-1), np.sqrt(square), share


def _offsets(radius: int) -> list[tuple[int, int]]:
    steps = (0, -radius, radius)
    return [(rows, columns) for rows in steps for columns in steps]


def _best_window(
    residual: Float[np.ndarray, "height width"], radius: int, fits: float
) -> tuple[Float[np.ndarray, "height width"], Float[np.ndarray, "height width"]]:
    """The residual of the window that a pixel takes, and which of `_offsets` that is: the first one, around the pixel,
    if it fits (on a curved surface the others have other normals), else the best.
    """
    height, width = residual.shape
    around = np.pad(residual, radius, constant_values=np.inf)
    candidates = np.stack([
        around[radius + r : radius + r + height, radius + c : radius + c + width] for r, c in _offsets(radius)
    ])
    offset = np.where(candidates[0] <= fits, 0, candidates.argmin(axis=0))
    return np.take_along_axis(candidates, offset[None], axis=0)[0], offset


def _taken(plane: Float[np.ndarray, "height width 3"], offset: np.ndarray, radius: int) -> np.ndarray:
    height, width = offset.shape
    rows, columns = np.array(_offsets(radius)).T
    v, u = np.indices(offset.shape)
    return plane[np.clip(v + rows[offset], 0, height - 1), np.clip(u + columns[offset], 0, width - 1)]


def _normals(plane: Float[np.ndarray, "height width 3"], camera: Camera) -> Float[np.ndarray, "height width 3"]:
    """Unit normals toward the camera of planes a, b, c in the image."""
    a, b, c = np.moveaxis(plane, -1, 0)
    if camera.is_orthographic:
        toward = np.stack([a * camera.fx, b * camera.fy, -np.ones_like(c)], axis=-1)  # z = a u + b v + c, u = fx x + cx
    else:
        toward = -np.stack([a * camera.fx, b * camera.fy, a * camera.cx + b * camera.cy + c], axis=-1)
    return toward / np.maximum(np.linalg.norm(toward, axis=-1, keepdims=True), 1e-12)


def _turning(
    depth: np.ndarray, normals: np.ndarray, camera: Camera, noise: float, radius: int
) -> Float[np.ndarray, "height width"]:
    """Angle [rad] from the regression's slope error: noise over the root of the window's squared distances, in two
    directions; a slanted surface's pixels lie farther apart, which its cosine takes into account.
    """
    side = 2 * radius + 1
    pitch = 1.0 / camera.fx if camera.is_orthographic else depth / camera.fx
    squares = side**2 * (side**2 - 1) / 12.0
    slope = noise / (np.maximum(pitch, 1e-9) * np.sqrt(squares))
    cosine = np.abs(normals[..., 2])
    return slope * cosine * np.sqrt(1.0 + cosine**2)  # across the tilt cos, along it cos^2
