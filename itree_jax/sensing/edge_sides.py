"""What lies on both sides of an edge point: intensities under each light, normals."""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float

from itree_jax.sensing.edge_points import SMOOTHING, EdgePoints, nearest, sampled
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensor import Sensor

# [px] from the edge. Nearer, the smoothed step reaches to the sample (2 % of it at 2 px); farther, the next edge does.
PLACES = (2.0, 3.0, 4.0)
SHOWN = 0.05  # change under a light, of its bright side, that counts as showing the edge


class LightSides(NamedTuple):
    """Intensities divided by those of the lights."""

    bright: Float[np.ndarray, "points lights"]  # on the brighter side, for each light by itself
    dark: Float[np.ndarray, "points lights"]
    change: Float[np.ndarray, "points lights"]  # absolute, shading that goes on across the edge taken off
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
    return LightSides(bright, dark, change, share)


def needle_turn(needle: NeedleMap, points: EdgePoints) -> Float[np.ndarray, "points"]:
    """Angle [rad] between the normals on both sides of an edge, NaN where one of them is uninterpretable."""
    known = np.asarray(needle.interpretable, np.float32)
    places = [points.uv + t * points.direction for t in (-PLACES[1], PLACES[1])]
    both = np.all([nearest(known, place) > 0.5 for place in places], axis=0)
    normals = np.asarray(needle.normals, np.float32)
    a, b = (np.stack([nearest(normals[..., k], place) for k in range(3)], axis=-1) for place in places)
    cosine = np.clip((a * b).sum(axis=-1), -1.0, 1.0)
    return np.where(both, np.arccos(cosine), np.nan)
