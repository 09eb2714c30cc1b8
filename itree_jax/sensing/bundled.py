"""The sensors that come with the project."""

import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError

from itree_jax.sensing.depth_camera import depth_camera
from itree_jax.sensor import Noise, Sensor

LIGHTS_OFF_AXIS = np.radians(35.0)
SLANT_LIMIT = np.radians(42.0)
SMALLEST_REGION = 60.0  # [mm^2]

DEPTH_NOISE = 0.3  # [mm]: what a good structured-light camera has at a metre

BUNDLED_SENSORS = ("ikeuchi-1987", "bench", "depth-bench")


def bundled_sensor(name: str) -> Sensor:
    """A sensor by name, one of `BUNDLED_SENSORS`.

    `ikeuchi-1987`: the orthographic camera of the paper, 640 x 480 px at 2 px/mm, three lights 35 degrees off the
    axis, the first one above in the image, slant limit 42 degrees, smallest region 60 mm^2. `bench`: a pinhole camera,
    f = 1815 px, 900 mm above the floor, with the same lights and limits.
    `depth-bench`: that camera as a depth camera without lights, 0.3 mm of noise. Raises `ItreeError` for another name.
    """
    if name == "ikeuchi-1987":
        return _with_three_lights(Camera("orthographic", 2.0, 2.0, 319.5, 239.5, 640, 480), working_distance=500.0)
    if name == "bench":
        return _with_three_lights(Camera("pinhole", 1815.0, 1815.0, 319.5, 239.5, 640, 480), working_distance=900.0)
    if name == "depth-bench":
        return depth_camera(bundled_sensor("bench"), DEPTH_NOISE)
    raise ItreeError(f"no bundled sensor is called '{name}'; there are {', '.join(BUNDLED_SENSORS)}")


def _with_three_lights(camera: Camera, working_distance: float) -> Sensor:
    azimuth = np.radians([270.0, 150.0, 30.0])  # image up is -y
    sin, cos = np.sin(LIGHTS_OFF_AXIS), np.cos(LIGHTS_OFF_AXIS)
    L = np.stack([sin * np.cos(azimuth), sin * np.sin(azimuth), np.full(3, -cos)], axis=1)
    L[0, 0] = 0.0  # cos 270 degrees, exactly
    return Sensor(
        camera=camera,
        light_directions=L,
        light_intensities=np.ones(3),
        noise=Noise(),
        slant_limit=float(SLANT_LIMIT),
        smallest_region=SMALLEST_REGION,
        working_distance=working_distance,
    )
