"""Where a light shows the parts, and not only a dark bin."""

import numpy as np
from jaxtyping import Bool, Float

from itree_jax.sensing.albedo import dominant_albedo
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensor import Sensor

LIT = 0.2  # of the parts' albedo: bins are darker, and reflected light fills most shadows with less


def lit_by_any(
    images: Float[np.ndarray, "lights height width"], sensor: Sensor, needle: NeedleMap
) -> Bool[np.ndarray, "height width"] | None:
    """Where a light shows more than a dark bin: a fifth of what the parts' material shows head-on. None for a camera
    without lights.
    """
    if sensor.is_depth_camera:
        return None
    albedo = float(dominant_albedo(needle))
    brightest = (images / sensor.light_intensities[:, None, None]).max(axis=0)
    return np.asarray(brightest > LIT * albedo) if albedo > 0 else None
