"""What a depth map's noise is, and from which difference on two neighbouring pixels are on different surfaces."""

import numpy as np
from jaxtyping import Bool, Float

from itree_jax.sensor import Sensor

# A neighbour is cut off beyond two sigma of depth noise. One in twenty neighbours on the same surface is cut off too,
# which disconnects nothing (each has seven more); a higher limit lets one noisy pixel bridge a step.
DEPTH_SIGMAS = 2.0


def depth_noise(depth: Float[np.ndarray, "height width"], mask: Bool[np.ndarray, "height width"]) -> float:
    """Standard deviation [mm] of a depth map's noise: median absolute second difference along rows, within the mask.

    Second differences vanish on a plane, whatever its slant, and the median forgets the steps. 0 without pixels.
    """
    known = mask & (depth > 0.0)
    three = known[:, :-2] & known[:, 1:-1] & known[:, 2:]
    second = (depth[:, :-2] - 2.0 * depth[:, 1:-1] + depth[:, 2:])[three]
    if second.size == 0:
        return 0.0
    return float(np.median(np.abs(second)) / 0.6745 / np.sqrt(6.0))  # MAD of a Gaussian; variance 1 + 4 + 1


def depth_step_limit(
    depth: Float[np.ndarray, "height width"], mask: Bool[np.ndarray, "height width"], sensor: Sensor
) -> float:
    """How much [mm] two neighbouring pixels of one surface may differ in depth.

    One pixel of slope at the slant limit, plus two sigma of the noise of the difference, plus one step of the map's own
    quantisation (coarse steps hide the noise).
    """
    known = depth[mask & (depth > 0.0)]
    z = float(np.median(known)) if known.size else sensor.working_distance
    slope = sensor.camera.mm_per_px(z) * np.tan(sensor.slant_limit)
    return float(slope + DEPTH_SIGMAS * np.sqrt(2.0) * depth_noise(depth, mask) + _quantum(known))


def _quantum(known: Float[np.ndarray, "pixels"]) -> float:
    steps = np.diff(np.unique(known))
    return float(steps.min()) if steps.size else 0.0
