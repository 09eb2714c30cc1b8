"""Which needles a region may be made of: those slanted to the line of sight by less than the limit (Ikeuchi 1987, sec.
4.1).
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float

from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensor import Sensor

IN_DOUBT = 3.0  # standard deviations of a needle beside the limit
AROUND = 5  # [px] of the window whose mean needle tells then: a fifth of the noise is left


def detectable(needle: NeedleMap, sensor: Sensor) -> Bool[np.ndarray, "height width"]:
    """Interpretable, slanted to its own viewing ray by less than the limit, and in the region of interest.

    Where a needle's error leaves open on which side of the limit it is, the mean of those around tells: a face that is
    slanted by about as much would else be strewn with holes.
    """
    normals, interpretable = np.asarray(needle.normals, np.float32), np.asarray(needle.interpretable)
    slant = slants(normals, sensor)
    error = IN_DOUBT * np.hypot(np.asarray(needle.normal_std), np.asarray(needle.normal_bias))
    open_ = interpretable & (np.abs(slant - sensor.slant_limit) < error)
    if open_.any():
        slant = np.where(open_, slants(cv2.blur(normals * interpretable[..., None], (AROUND, AROUND)), sensor), slant)
    mask = interpretable & (slant < sensor.slant_limit)
    return mask if sensor.region_of_interest is None else mask & sensor.region_of_interest


def slants(normals: Float[np.ndarray, "height width 3"], sensor: Sensor) -> Float[np.ndarray, "height width"]:
    """Angle [rad] of each pixel's normal, of any length, to its viewing ray; a right one where there is none."""
    camera = sensor.camera
    x, y = np.zeros(camera.width, np.float32), np.zeros((camera.height, 1), np.float32)
    if not camera.is_orthographic:
        x = ((np.arange(camera.width) - camera.cx) / camera.fx).astype(np.float32)
        y = ((np.arange(camera.height)[:, None] - camera.cy) / camera.fy).astype(np.float32)
    toward_viewer = -(normals[..., 0] * x + normals[..., 1] * y + normals[..., 2])
    length = np.sqrt(np.square(normals).sum(axis=-1) * (x**2 + y**2 + 1.0))
    return np.arccos(np.clip(toward_viewer / np.maximum(length, np.finfo(np.float32).tiny), -1.0, 1.0))
