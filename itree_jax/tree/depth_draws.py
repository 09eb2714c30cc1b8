"""What a depth camera's noise does to the needles of a draw.

A draw's window has pixels some times larger than the camera's, so that its needles cannot be fitted in it as
`depth_needles` does in an image. They are drawn from the error of that fit instead: the slope of each pixel errs by
what the noise does to a regression over the camera's window, and neighbours that share the window share the error.
Near creases and on surfaces of small radius the real fit errs by more and loses a pixel or two of the camera, which is
less than one of a draw: `experiments/depth_camera.py` measures both.
"""

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from itree_jax.sensing.depth_camera import depth_needle_deviation, depth_noise_of
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
    """Errors [mm per mm] of the slopes along x and y, alike within the fit's window of (2 RADIUS + 1) camera pixels.

    As a box of that width spreads, so does the Gaussian that smooths them.
    """
    deviation = depth_needle_deviation(depth_noise_of(sensor), sensor.mm_per_px) / np.sqrt(2.0)
    spread = (2 * RADIUS + 1) * sensor.mm_per_px / np.sqrt(12.0) / pitch  # [px of the draw]
    impulse = np.zeros(2 * int(np.ceil(4.0 * spread)) + 3)
    impulse[len(impulse) // 2] = 1.0
    kept = (gaussian_filter1d(impulse, spread, mode="constant") ** 2).sum()  # of white noise's variance, per axis
    smooth = gaussian_filter(rng.normal(size=(*shape, 2)), (0.0, spread, spread, 0.0), mode="wrap")
    return deviation * smooth / kept
