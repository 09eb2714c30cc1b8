"""Intensities on both sides of an edge point, under each light."""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float

from itree_jax.sensing.edge_points import SMOOTHING, sampled
from itree_jax.sensor import Sensor

# [px] from the edge. Nearer, the smoothed step reaches to the sample (2 % of it at 2 px); farther, the next edge does.
PLACES = (2.0, 3.0, 4.0)
SHOWN = 0.05  # change under a light, of its bright side, that counts as showing the edge


class LightSides(NamedTuple):
    """Intensities divided by those of the lights."""

    bright: Float[np.ndarray, "points lights"]  # on the brighter side, for each light by itself
    dark: Float[np.ndarray, "points lights"]
    change: Float[np.ndarray, "points lights"]  # absolute, shading that goes on across the edge taken off
    # cos of the angle in the image between the way to the darker side and the way to the light.
    toward: Float[np.ndarray, "points lights"]
    share: Float[np.ndarray, "points"]  # of the lights whose intensity changes


def light_sides(
    images: Float[np.ndarray, "lights height width"], sensor: Sensor, uv: Float[np.ndarray, "points 2"],
    direction: Float[np.ndarray, "points 2"],
) -> LightSides:
    """The change is the smaller of two: between the nearest samples, which another edge beside disturbs least, and of a
    step on a slope that both sides share, which the shading of a curved face doesn't disturb."""
    steps = np.array([*(-t for t in PLACES[::-1]), *PLACES])
    places = uv[:, None] + steps[None, :, None] * direction[:, None]
    profile = np.empty((len(uv), len(images), len(steps)))
    for k, (image, e) in enumerate(zip(images, sensor.light_intensities, strict=True)):
        profile[:, k] = sampled(cv2.GaussianBlur(np.asarray(image, np.float32), (0, 0), SMOOTHING), places) / e
    a, b = profile[:, :, len(PLACES) - 1], profile[:, :, len(PLACES)]
    bright, dark = np.maximum(a, b), np.minimum(a, b)
    design = np.stack([np.ones(len(steps)), steps, steps > 0], axis=1)
    on_slope = profile @ np.linalg.pinv(design)[2]
    change = np.minimum(bright - dark, np.abs(on_slope))
    share = (change > SHOWN * np.maximum(bright.max(axis=1, keepdims=True), 1e-9)).mean(axis=1)
    to_light = sensor.light_directions[:, :2] / np.maximum(
        np.linalg.norm(sensor.light_directions[:, :2], axis=1, keepdims=True), 1e-9
    )
    toward = np.where(b < a, 1.0, -1.0) * (direction @ to_light.T)
    return LightSides(bright, dark, change, toward, share)
