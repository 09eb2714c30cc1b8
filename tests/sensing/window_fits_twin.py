"""Planes and quadratic surfaces fitted to windows of an image, around every pixel at once.

Over a full square window the six terms 1, u, v, uv, u^2, v^2 (u, v from the window's middle, the squares less their
mean) are orthogonal, so that each coefficient is one sum of its own: the quadratic surface has the same slope in the
middle as the plane, and how much better it fits is the sum of three squares (Haralick's facet model).
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int


class WindowFits(NamedTuple):
    """Of the window of (2 radius + 1)^2 pixels around each pixel. Where `full` is False the rest means nothing."""

    radius: int
    mean: Float[np.ndarray, "height width"]
    slope: Float[np.ndarray, "height width 2"]  # of the value over u and over v, of the plane and of the quadric
    bend: Float[np.ndarray, "height width 3"]  # second derivatives uu, uv, vv of the quadric
    planar: Float[np.ndarray, "height width"]  # sum of squared residuals of the plane
    curved: Float[np.ndarray, "height width"]  # how much of it the quadric explains: of three terms
    full: Bool[np.ndarray, "height width"]  # the window lies within the image and its pixels are known

    @property
    def pixels(self) -> int:
        return (2 * self.radius + 1) ** 2

    def middle(self, pixels: Int[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """The quadric's value in the middle of the windows around pixels, by their place in the flat image."""
        square, bend = _spreads(self.radius)[0], self.bend.reshape(-1, 3)[pixels]
        return self.mean.ravel()[pixels] - 0.5 * square * (bend[:, 0] + bend[:, 2])


def _spreads(radius: int) -> tuple[float, float]:
    """Means of u^2 and u^4 over -radius..radius."""
    steps = np.arange(-radius, radius + 1.0)
    return float((steps**2).mean()), float((steps**4).mean())


def window_fits(
    value: Float[np.ndarray, "height width"], known: Bool[np.ndarray, "height width"], radius: int
) -> WindowFits:
    """The fits of a map; all of a window's pixels must be `known`. Best with the map's mean taken out: digits."""
    steps = np.arange(-radius, radius + 1.0)
    ones, squares = np.ones_like(steps), steps**2
    value = np.where(known, value, 0.0)

    def total(over_v: np.ndarray, over_u: np.ndarray, field: np.ndarray = value) -> np.ndarray:
        return cv2.sepFilter2D(field, cv2.CV_64F, over_u, over_v, borderType=cv2.BORDER_CONSTANT)

    count, (m2, m4) = len(steps) ** 2, _spreads(radius)
    mean = total(ones, ones) / count
    u, v = total(ones, steps) / (count * m2), total(steps, ones) / (count * m2)
    uv = total(steps, steps) / (count * m2**2)
    uu, vv = ((total(*k) / count - m2 * mean) / (m4 - m2**2) for k in ((ones, squares), (squares, ones)))
    around = total(ones, ones, value**2) - count * mean**2
    curved = count * (m2**2 * uv**2 + (m4 - m2**2) * (uu**2 + vv**2))
    full = total(ones, ones, known.astype(np.float64)) > count - 0.5
    return WindowFits(
        radius, mean, np.stack([u, v], axis=-1), np.stack([2.0 * uu, uv, 2.0 * vv], axis=-1),
        np.maximum(around - count * m2 * (u**2 + v**2), 0.0), curved, full,
    )
