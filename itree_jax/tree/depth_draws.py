"""What a depth camera's noise does to the needles of a draw.

A draw's window has pixels some times larger than the camera's, so that its needles cannot be fitted in it as
`depth_needles` does in an image, and rendering it as fine as the camera sees it would cost ten times the rays. The
truth is smooth where the noise isn't: so the noise alone is drawn on the camera's pixels, and what a plane fitted to it
slopes by is added to the true slopes. On a plane that is the error of `depth_needles`, correlations included. Near
creases and on surfaces of small radius the real fit errs by more and loses a pixel or two of the camera, which is less
than one of a draw: `experiments/depth_camera.py` measures both.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float

from itree_jax.sensing.depth_camera import depth_noise_of
from itree_jax.sensing.depth_needles import RADIUS
from itree_jax.sensor import Sensor

LEAST_FACING = 0.05  # cosine: steeper than any slant limit, and a slope is still finite


def depth_camera_needles(
    there: Bool[np.ndarray, "n s s"], normal: Float[np.ndarray, "n s s 3"], pitch: float, sensor: Sensor,
    rng: np.random.Generator,
) -> tuple[Bool[np.ndarray, "n s s"], Float[np.ndarray, "n s s 3"]]:
    """Of a batch of orthographic windows with pixels of `pitch` [mm]: which are detectable, and their needles."""
    toward = np.maximum(-normal[..., 2], LEAST_FACING)
    slope = normal[..., :2] / toward[..., None] + slope_errors(there.shape, pitch, sensor, rng)
    needles = np.concatenate([slope, -np.ones((*there.shape, 1))], axis=-1)
    needles /= np.linalg.norm(needles, axis=-1, keepdims=True)
    seen = there & (-normal[..., 2] > LEAST_FACING)
    detectable = seen & (-needles[..., 2] > np.cos(sensor.slant_limit))
    return detectable, np.where(seen[..., None], needles, 0.0).astype(np.float32)


def slope_errors(
    shape: tuple[int, int, int], pitch: float, sensor: Sensor, rng: np.random.Generator
) -> Float[np.ndarray, "n s s 2"]:
    """Errors [mm per mm] of the slopes along x and y: those of planes fitted to noise on the camera's pixels, taken
    where the pixels of the windows lie. So neighbours are alike as far as their fits share pixels.
    """
    count, size, _ = shape
    steps = np.arange(-RADIUS, RADIUS + 1.0)
    ramp = steps / (len(steps) * (steps**2).sum() * sensor.mm_per_px)  # sum of ramp times depth: the slope
    ones = np.ones_like(steps)
    at = RADIUS + np.rint(np.arange(size) * pitch / sensor.mm_per_px).astype(np.int64)
    side = int(at[-1]) + RADIUS + 1
    noise = depth_noise_of(sensor)
    errors = np.empty((*shape, 2), np.float32)
    for k in range(count):
        jitter = noise * rng.standard_normal((side, side), dtype=np.float32)
        for axis, (over_x, over_y) in enumerate(((ramp, ones), (ones, ramp))):
            errors[k, ..., axis] = cv2.sepFilter2D(jitter, cv2.CV_32F, over_x, over_y)[np.ix_(at, at)]
    return errors
