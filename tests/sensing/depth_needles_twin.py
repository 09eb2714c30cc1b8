"""The windows that compete for a pixel of a depth map, in NumPy: the twin of `itree_kernels.depth_normals`."""

from typing import NamedTuple

import numpy as np
from itree_kernels.camera import Camera
from jaxtyping import Bool, Float, Int

from itree_jax.sensing.depth_needles import RADIUS, SMALLER, DepthNeedles, _filled

from .curving_twin import added_by_third_order
from .window_fits_twin import WindowFits, window_fits

FITS = 3.0  # standard deviations of the sum of squared residuals above what noise gives: one window in a thousand
# The squares of the three curvature terms over the noise's variance sum to 3 on a plane, to less than 6.3 in nine of
# ten windows; on a cylinder of 10 px radius (0.3 mm of noise, 0.5 mm per pixel) to 20 and more.
FLAT = 6.3
BENT = 60.0  # of the same sum: a crease of 45 degrees or more. What curves as much is seldom flat beside.
MOST_ADDED = 0.06  # [rad] by the third order: the fourth, unknown, is then within a degree
BLOCK = 8192  # pixels whose curvature is looked at together: their numbers stay in the cache
LEAST_NOISE = 0.05  # of a pixel's size: what smooth surfaces depart from quadratic ones


class _Values(NamedTuple):
    """What is fitted: the depth, or its inverse, less its mean."""

    value: Float[np.ndarray, "height width"]
    full: Bool[np.ndarray, "height width"]  # the value may be used
    mean: float
    variance: Float[np.ndarray, "height width"]  # of its noise
    scale: Float[np.ndarray, "height width"]  # sizes of a pixel that the depth changes by per unit of it


class _Taken(NamedTuple):
    """What the pixels have so far."""

    slope: Float[np.ndarray, "height width 2"]  # of the value over u and v
    level: Float[np.ndarray, "height width"]  # the value
    side: Int[np.ndarray, "height width"]  # of the window [px]; 0 where none fits

    def put(self, pixels: Int[np.ndarray, "n"], slope: np.ndarray, level: np.ndarray, side: int) -> None:
        """Gives windows to pixels that have none, by their place in the flat image."""
        self.slope.reshape(-1, 2)[pixels], self.level.ravel()[pixels], self.side.ravel()[pixels] = slope, level, side


def depth_needles_twin(
    depth: Float[np.ndarray, "height width"], camera: Camera, noise: float, radius: int = RADIUS
) -> DepthNeedles:
    """Normals of a depth map [mm] (0 = none) with noise of this standard deviation [mm]. Runs on the host.

    `known` is False where no window fits: on surfaces that are narrower than the smallest one or curve within it.
    """
    there = depth > 0.0
    z = np.where(there, depth, np.median(depth[there]) if there.any() else 1.0).astype(np.float64)
    pitch = np.full_like(z, 1.0 / camera.fx) if camera.is_orthographic else z / camera.fx
    values = _values(z, there, pitch, camera, noise, radius)
    taken = _Taken(np.zeros((*z.shape, 2)), np.zeros_like(z), np.zeros(z.shape, np.int64))
    radii = range(radius, max(radius - SMALLER, 1) - 1, -1)
    fits = [window_fits(values.value, values.full, r) for r in radii]
    _take_around(taken, fits[0], values, camera, fits[0].curved <= BENT * values.variance)
    _take_beside(taken, fits[0], values)
    for fit in fits:
        _take_around(taken, fit, values, camera, values.full)
    normals = _normals(taken.slope, taken.level + values.mean, camera)
    known = there & (taken.side > 0) & (normals[..., 2] < 0.0)
    std = np.where(known, _turning(pitch, normals, noise, np.maximum(taken.side, 1)), 0.0)
    return DepthNeedles(np.where(known[..., None], normals, 0.0).astype(np.float32), known, std.astype(np.float32))


def _values(
    z: Float[np.ndarray, "height width"], there: Bool[np.ndarray, "height width"],
    pitch: Float[np.ndarray, "height width"], camera: Camera, noise: float, radius: int,
) -> _Values:
    value, per_mm = (z, np.ones_like(z)) if camera.is_orthographic else (1.0 / z, -(z**-2.0))
    mean = float(value.mean())
    filled, full = _filled(value - mean, there, radius)
    variance = (np.maximum(noise, LEAST_NOISE * pitch) * per_mm) ** 2
    return _Values(filled, full, mean, variance, 1.0 / (per_mm * pitch))


def _take_around(
    taken: _Taken, fit: WindowFits, values: _Values, camera: Camera, allowed: Bool[np.ndarray, "height width"]
) -> None:
    """Pixels without a window that a quadratic surface fits around take its slope, less what the third order adds."""
    here = (taken.side == 0) & allowed & _fits(fit, fit.planar - fit.curved, values.variance, 6)
    pixels = np.flatnonzero(here)
    for block in np.array_split(pixels, -(-len(pixels) // BLOCK)) if len(pixels) else ():
        slope, scale = fit.slope.reshape(-1, 2)[block], values.scale.ravel()[block]
        v, u = np.divmod(block, here.shape[1])
        sight = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy], axis=-1)
        sight = np.zeros_like(sight) if camera.is_orthographic else sight
        added = added_by_third_order(fit.radius, slope, fit.bend.reshape(-1, 3)[block], scale, sight)
        small = (np.abs(added * scale[:, None]) <= MOST_ADDED).all(axis=-1)
        taken.put(block[small], (slope - added)[small], fit.middle(block[small]), 2 * fit.radius + 1)


def _take_beside(taken: _Taken, fit: WindowFits, values: _Values) -> None:
    """Pixels without a window take the flattest one that has them on its border, if that is a plane."""
    flat = _fits(fit, fit.planar, values.variance, 3) & (fit.curved <= FLAT * values.variance)
    score = np.where(flat, fit.planar / values.variance, np.inf)
    r, (height, width) = fit.radius, score.shape
    pixels = np.flatnonzero(taken.side == 0)
    v, u = np.divmod(pixels, width)
    best, at, beside = np.full(len(pixels), np.inf), np.zeros_like(pixels), np.zeros((len(pixels), 2))
    for down, right in [(i, j) for i in (-r, 0, r) for j in (-r, 0, r) if (i, j) != (0, 0)]:
        # at the rim no window is full
        window = np.clip(v + down, 0, height - 1) * width + np.clip(u + right, 0, width - 1)
        value = score.ravel()[window]
        better = np.flatnonzero(value < best)
        best[better], at[better], beside[better] = value[better], window[better], (right, down)
    found = np.isfinite(best)
    slope = fit.slope.reshape(-1, 2)[at[found]]
    level = fit.mean.ravel()[at[found]] - (slope * beside[found]).sum(axis=-1)
    taken.put(pixels[found], slope, level, 2 * r + 1)


def _fits(
    fit: WindowFits, squares: Float[np.ndarray, "height width"], variance: Float[np.ndarray, "height width"], terms: int
) -> Bool[np.ndarray, "height width"]:
    """Whether residuals about a surface of so many terms are no larger than the noise makes them."""
    free = fit.pixels - terms
    return fit.full & (squares <= (free + FITS * np.sqrt(2.0 * free)) * variance)


def _normals(
    slope: Float[np.ndarray, "height width 2"], level: Float[np.ndarray, "height width"], camera: Camera
) -> Float[np.ndarray, "height width 3"]:
    """Unit normals toward the camera of planes with this value and slope of the value at each pixel."""
    a, b = np.moveaxis(slope, -1, 0)
    if camera.is_orthographic:
        toward = np.stack([a * camera.fx, b * camera.fy, -np.ones_like(a)], axis=-1)  # z = a u + b v + c, u = fx x + cx
    else:
        v, u = np.indices(level.shape)
        at_axis = level + a * (camera.cx - u) + b * (camera.cy - v)
        toward = -np.stack([a * camera.fx, b * camera.fy, at_axis], axis=-1)
    return toward / np.maximum(np.linalg.norm(toward, axis=-1, keepdims=True), 1e-12)


def _turning(
    pitch: Float[np.ndarray, "height width"], normals: np.ndarray, noise: float, side: Int[np.ndarray, "height width"]
) -> Float[np.ndarray, "height width"]:
    """Angle [rad] from the regression's slope error: noise over the root of the window's squared distances, in two
    directions; a slanted surface's pixels lie farther apart, which its cosine takes into account.
    """
    slope = noise / (pitch * np.sqrt(np.maximum(side**2 * (side**2 - 1.0) / 12.0, 1.0)))
    cosine = np.abs(normals[..., 2])
    return slope * cosine * np.sqrt(1.0 + cosine**2)  # across the tilt cos, along it cos^2
