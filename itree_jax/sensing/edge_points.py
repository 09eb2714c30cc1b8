"""Edge points of a scene: where the intensities of all lights together change fastest, to a fraction of a pixel.

"Three edge maps can be obtained by differentiating three intensity maps" (Ikeuchi 1987, sec. 3.1). Here the lights are
differentiated together: each is a channel of one image, and the direction across an edge is the one in which the
channels change most (Di Zenzo 1986). A place where that change has its largest value across the edge, which is where
the second derivative passes through zero, is an edge point, whichever lights it is seen by.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float

from itree_jax.sensing.noise_model import intensity_std
from itree_jax.sensor import Sensor

SMOOTHING = 1.0  # [px] standard deviation: steps drawn without antialiasing become straight, noise falls to 0.28
DIRECTION_SMOOTHING = 1.5  # [px] along and across: an edge of some pixels gives its direction within a degree
NOISE_GAIN = 0.2  # std of a central difference over 2 px after that smoothing, over that of a pixel: (8 pi s^4)^-1/2
NOISE_SIGMAS = 6.0  # over three channels and 300,000 pixels, pure noise then makes no point in an image
LEAST_CHANGE = 0.03  # per pixel, of the brightest intensity around: a step of 0.08, more than shading on small parts
CONFINED = 0.6  # a step of this smoothing falls to 0.32 of its largest change 1.5 px aside; a ramp of shading doesn't
ASIDE = 1.5  # [px]


class EdgePoints(NamedTuple):
    uv: Float[np.ndarray, "points 2"]  # [px], pixel centres at integers
    direction: Float[np.ndarray, "points 2"]  # unit, across the edge, to the side that is darker over all lights
    change: Float[np.ndarray, "points"]  # largest over the lights, as a share of the brightest intensity around: 0..1


def edge_points(images: Float[np.ndarray, "lights height width"], sensor: Sensor) -> EdgePoints:
    """The edge points of one image per light, in the order of the image's pixels. Host code.

    Args:
        images: linear intensities, 1.0 = full scale, not divided by those of the lights.
        sensor: its light intensities and its noise.
    """
    e = sensor.light_intensities.astype(np.float32)[:, None, None]
    stored = np.asarray(images, np.float32)
    noise = np.asarray(intensity_std(stored, sensor.noise)) / e
    smooth = np.stack([cv2.GaussianBlur(x, (0, 0), SMOOTHING) for x in stored / e])
    gx, gy = _derivatives(smooth)
    strength = np.sqrt(_larger_eigenvalue((gx**2).sum(0), (gx * gy).sum(0), (gy**2).sum(0)))
    direction = _direction(gx, gy)
    brightest = cv2.dilate(smooth.max(axis=0), np.ones((5, 5), np.uint8))
    worst = cv2.dilate(noise.max(axis=0), np.ones((3, 3), np.uint8))
    least = np.maximum(LEAST_CHANGE * brightest, NOISE_SIGMAS * NOISE_GAIN * worst)
    rows, columns = np.nonzero(_away_from_rim(strength > least))
    here = np.stack([columns, rows], axis=-1).astype(np.float32)
    across = direction[rows, columns]
    offset, found = _peak(strength, here, across)
    keep = found & (_beside(strength, here, across) < CONFINED * strength[rows, columns])
    here, across, rows, columns = here[keep], across[keep], rows[keep], columns[keep]
    slopes = np.abs(gx[:, rows, columns] * across[:, 0] + gy[:, rows, columns] * across[:, 1]).max(axis=0)
    step = slopes * np.sqrt(2.0 * np.pi) * SMOOTHING  # of a step that became a Gaussian ramp
    change = np.clip(step / np.maximum(brightest[rows, columns], 1e-9), 0.0, 1.0)
    uv = here + offset[keep, None] * across
    return EdgePoints(uv.astype(np.float64), across.astype(np.float64), change.astype(np.float64))


def joined(a: EdgePoints, b: EdgePoints) -> EdgePoints:
    return EdgePoints(*(np.concatenate(pair) for pair in zip(a, b, strict=True)))


def sampled(
    image: Float[np.ndarray, "height width"], uv: Float[np.ndarray, "*points 2"]
) -> Float[np.ndarray, "*points"]:
    """Bilinear values at image points [px]; the rim is repeated outward."""
    return _remapped(image, uv, cv2.INTER_LINEAR)


def nearest(
    image: Float[np.ndarray, "height width"], uv: Float[np.ndarray, "*points 2"]
) -> Float[np.ndarray, "*points"]:
    """Values of the pixels that image points [px] lie in."""
    return _remapped(image, uv, cv2.INTER_NEAREST)


def _remapped(image: np.ndarray, uv: np.ndarray, how: int) -> np.ndarray:
    """In columns of at most 30,000 points, since OpenCV's remap counts rows and columns by 16 bits."""
    x, y = np.ascontiguousarray(uv, np.float32).reshape(-1, 2).T
    if not len(x):
        return np.zeros(np.shape(uv)[:-1], np.float32)
    columns = -(-len(x) // 30000)
    x, y = (np.pad(a, (0, -len(a) % columns)).reshape(-1, columns) for a in (x, y))
    values = cv2.remap(np.ascontiguousarray(image, np.float32), x, y, how, borderMode=cv2.BORDER_REPLICATE)
    return values.reshape(-1)[: int(np.prod(np.shape(uv)[:-1]))].reshape(np.shape(uv)[:-1])


def _derivatives(smooth: Float[np.ndarray, "lights h w"]) -> tuple[np.ndarray, np.ndarray]:
    """Central differences [per px] along x and y; 0 on the rim."""
    gx, gy = np.zeros_like(smooth), np.zeros_like(smooth)
    gx[:, :, 1:-1] = 0.5 * (smooth[:, :, 2:] - smooth[:, :, :-2])
    gy[:, 1:-1] = 0.5 * (smooth[:, 2:] - smooth[:, :-2])
    return gx, gy


def _larger_eigenvalue(xx: np.ndarray, xy: np.ndarray, yy: np.ndarray) -> np.ndarray:
    return 0.5 * (xx + yy + np.sqrt((xx - yy) ** 2 + 4.0 * xy**2))


def _direction(gx: Float[np.ndarray, "lights h w"], gy: Float[np.ndarray, "lights h w"]) -> Float[np.ndarray, "h w 2"]:
    """Unit direction of the largest change in the neighbourhood, toward the side that is darker over all lights."""
    xx, xy, yy = (cv2.GaussianBlur(a.sum(axis=0), (0, 0), DIRECTION_SMOOTHING) for a in (gx * gx, gx * gy, gy * gy))
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    c, s = np.cos(angle), np.sin(angle)
    darker = np.where(gx.sum(axis=0) * c + gy.sum(axis=0) * s > 0.0, -1.0, 1.0).astype(np.float32)
    return np.stack([c * darker, s * darker], axis=-1)


def _away_from_rim(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    inside = np.zeros_like(mask)
    inside[2:-2, 2:-2] = mask[2:-2, 2:-2]
    return inside


def _peak(
    strength: Float[np.ndarray, "h w"], here: Float[np.ndarray, "n 2"], across: Float[np.ndarray, "n 2"]
) -> tuple[Float[np.ndarray, "n"], Bool[np.ndarray, "n"]]:
    """Where across the edge [px from the pixel] a parabola through the logarithms of three strengths has its top.

    The logarithm of a smoothed step's derivative is a parabola. Half a pixel to the side the neighbour has the point.
    """
    a, b, c = (np.log(np.maximum(sampled(strength, here + k * across), 1e-9)) for k in (-1.0, 0.0, 1.0))
    bend = a - 2.0 * b + c
    offset = np.where(bend < 0.0, 0.5 * (a - c) / np.where(bend < 0.0, bend, -1.0), np.inf)
    reach = 0.5 / np.maximum(np.abs(across).max(axis=-1), 1e-9)  # to the pixel's rim along its main axis
    found = (b >= a) & (b >= c) & (np.abs(offset) <= reach)
    return np.where(found, offset, 0.0), found


def _beside(
    strength: Float[np.ndarray, "h w"], here: Float[np.ndarray, "n 2"], across: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, "n"]:
    """The smaller of the strengths on both sides: shading that grows toward an edge is on one side of it."""
    return np.minimum(sampled(strength, here - ASIDE * across), sampled(strength, here + ASIDE * across))
