"""A depth camera as a sensor: no lights, needles from the gradient of its depth map, and what is detectable then.

"Detectable" asks two things of a point (Ikeuchi 1987, sec. 2.1.1): that its slant is small enough and that no light is
blocked. Without lights the first one is left. The needle of a point comes from a window of pixels on one surface; the
noise says how large the window must be, and a slanted surface shows fewer pixels.
"""

from dataclasses import replace
from functools import cache

import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Float

from itree_jax.sensing.depth_needles import RADIUS, depth_needles
from itree_jax.sensing.lights import NO_LIGHTS
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensor import Sensor

# A needle that errs by more is of no use: faces of the dome's groups are some ten degrees apart.
NEEDLE_WANTED = float(np.radians(3.0))
# Structured light, stereo and time of flight keep their noise up to about 60 degrees of slant and lose the surface soon
# after. Ten degrees of guard, since a window on a curved face reaches that much farther.
STEEPEST = float(np.radians(50.0))
LEAST_SIDE = 3.0  # [px] of a window that tells a plane from noise at all


def depth_camera(sensor: Sensor, depth_noise: float, slant_limit: float | None = None) -> Sensor:
    """The camera of a sensor as a depth camera with this noise [mm]; without a slant limit [rad] of its own, it has
    `depth_slant_limit`.
    """
    if slant_limit is None:
        slant_limit = depth_slant_limit(depth_noise, sensor.mm_per_px, sensor.smallest_region)
    return replace(
        sensor, light_directions=NO_LIGHTS.directions, light_intensities=NO_LIGHTS.intensities, light_positions=None,
        depth_noise=depth_noise, slant_limit=slant_limit,
    )


def depth_slant_limit(depth_noise: float, mm_per_px: float, smallest_region: float) -> float:
    """The slant [rad] up to which a depth camera of this noise [mm] tells the needles of the smallest region [mm^2].

    A window of n x n pixels of size s turns a needle by noise * sqrt(12) / (s n^2), so that the noise asks for a window
    of so many pixels. The smallest region, as wide as high, is cos(slant) as wide in the image: beyond the limit it no
    longer holds the window. No more than `STEEPEST`. Raises `ItreeError` if it does not hold it face on.
    """
    side = max(LEAST_SIDE, np.sqrt(depth_noise * np.sqrt(12.0) / (mm_per_px * NEEDLE_WANTED)))
    region = np.sqrt(smallest_region)
    if side * mm_per_px >= region:
        raise ItreeError(
            f"a depth camera with {depth_noise:.3g} mm of noise and {mm_per_px:.3g} mm per pixel needs windows of "
            f"{side:.0f} x {side:.0f} pixels for needles within {np.degrees(NEEDLE_WANTED):.0f} degrees, "
            f"{side * mm_per_px:.1f} mm wide, but regions of {smallest_region:.3g} mm^2 are {region:.1f} mm wide. "
            "Raise the sensor's smallest region, or state its slant limit"
        )
    return float(min(STEEPEST, np.arccos(side * mm_per_px / region)))


@cache
def depth_needle_deviation(depth_noise: float, mm_per_px: float) -> float:
    """By how much [rad] noise turns the needle of a surface that faces the camera: rms angle over both directions."""
    side = 2 * RADIUS + 1
    return float(depth_noise * np.sqrt(2.0 * 12.0) / (mm_per_px * side * np.sqrt(side**2 - 1.0)))


def needles_of_depth(depth: Float[np.ndarray, "height width"], sensor: Sensor) -> NeedleMap:
    """The needle map of a depth camera's map [mm] (0 = none). NumPy arrays; there is no albedo, so it is 0."""
    found = depth_needles(depth, sensor.camera, depth_noise_of(sensor))
    nothing, no_light = np.zeros(depth.shape, np.float32), np.zeros((0, *depth.shape), bool)
    return NeedleMap(
        normals=found.normals, albedo=nothing, interpretable=found.known, shadowed=no_light, saturated=no_light,
        confidence=found.known.astype(np.float32), normal_std=found.normal_std, normal_bias=nothing,
        shadow_probability=no_light.astype(np.float32), reaching=no_light,
    )


def depth_noise_of(sensor: Sensor) -> float:
    """The noise that a depth camera states [mm]. Raises `ItreeError` if it states none."""
    if sensor.depth_noise is None:
        raise ItreeError("a sensor without lights is a depth camera and must state its noise (depth_noise, in mm)")
    return sensor.depth_noise
