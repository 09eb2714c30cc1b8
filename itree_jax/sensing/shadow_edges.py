"""On which side of things an image's shadows end: tells the light of an image, whatever the surfaces are.

A shadow begins at the edge of the thing that casts it, which is seen under the other lights too, and ends somewhere on
the floor, where the other lights see nothing. So an edge that only one image has is where its shadow ends (or runs
along), and across it the image brightens in the direction away from its light. The sum of these directions points away
from the light; it needs neither normals nor depth, and holds for lights that are turned or mirrored into one another,
which photometric stereo on three symmetric lights cannot tell.
"""

import cv2
import numpy as np
from itree_kernels.camera import Camera
from jaxtyping import Float

from itree_jax.sensing.noise_model import intensity_std
from itree_jax.sensor import Sensor

SMOOTHING = 1.0  # [px] of the images before they are differentiated
GRADIENT_NOISE = 0.2  # of a pixel's noise: what is left of it in the gradient after that smoothing
LEAST_CONTRAST = 0.1  # [1/px] of the brightest image there: a full shadow's edge has 0.4, filled ones less
OWN = 4.0  # times the gradient of any other image: the edge belongs to this light
NOISE_SIGMAS = 6.0  # so rare among 300000 pixels that edges are not noise
LIT_BESIDE = 0.3  # of the brightest image: another light must see the place to say that nothing is there


def shadow_support(
    images: Float[np.ndarray, "lights height width"], sensor: Sensor
) -> Float[np.ndarray, "lights lights height width"]:
    """For image i and light j, what each pixel says for j being the light of i: minus the cosine of the brightening
    direction with the light's, times the light's distance from the line of sight; 0 but at shadow ends."""
    x = np.asarray(images, np.float32) / np.asarray(sensor.light_intensities, np.float32)[:, None, None]
    smooth = np.stack([cv2.GaussianBlur(a, (0, 0), SMOOTHING) for a in x])
    dv, du = np.gradient(smooth, axis=(1, 2))
    strength = np.hypot(du, dv)
    std = np.asarray(intensity_std(np.maximum(images, 0.0), sensor.noise)) / np.asarray(
        sensor.light_intensities, np.float32
    )[:, None, None]
    brightest = smooth.max(axis=0)
    toward = [toward_light(sensor.camera, light) for light in sensor.light_directions]
    count = len(images)
    support = np.zeros((count, count, *brightest.shape), np.float32)
    for i in range(count):
        others, beside = np.delete(strength, i, axis=0).max(axis=0), np.delete(smooth, i, axis=0).max(axis=0)
        ends = (strength[i] > LEAST_CONTRAST * brightest) & (strength[i] > OWN * others)
        ends &= (strength[i] > NOISE_SIGMAS * GRADIENT_NOISE * std[i]) & (beside > LIT_BESIDE * brightest)
        at = np.nonzero(ends)
        direction = np.stack([du[i][at], dv[i][at]], axis=-1) / strength[i][at][:, None]
        for j in range(count):
            support[i, j][at] = -np.sum(direction * toward[j][at], axis=-1)
    return support


def toward_light(
    camera: Camera, light: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "height width 2"]:
    """Image direction in which a point moves that moves toward a light, per unit of distance over depth."""
    v, u = np.indices((camera.height, camera.width), dtype=np.float64)
    ray = camera.viewing_ray(np.stack([u, v], axis=-1))
    return light[:2] - ray[..., :2] / ray[..., 2:] * light[2]
