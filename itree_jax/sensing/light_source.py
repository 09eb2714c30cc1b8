"""Where a stage that works on plain images finds its lights: a JSON file, a scene folder, or DiLiGenT's text files."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError
from itree_kernels.json_file import read_json
from jaxtyping import Float

from itree_jax.sensing.bundled import SMALLEST_REGION
from itree_jax.sensing.json_check import check_json
from itree_jax.sensing.lights import Lights, checked_lights, lights_of_entry, slant_limit_of
from itree_jax.sensing.reaching import DEFAULT_SLANT_LIMIT
from itree_jax.sensing.sensor_file import SENSOR_SCHEMA, exposed, load_sensor
from itree_jax.sensor import Noise, Sensor

DIRECTIONS, INTENSITIES = "light_directions.txt", "light_intensities.txt"
FROM_VIEWER = np.array([1.0, -1.0, -1.0])  # DiLiGenT's x right, y up, z toward the viewer -> x right, y down, z forward


@dataclass(frozen=True)
class LightSource:
    """Lights, and the sensor if the source tells one."""

    lights: Lights
    sensor: Sensor | None
    colour_intensities: Float[np.ndarray, "lights 3"] | None = None  # red, green, blue, if it tells them

    def sensor_for(self, width: int, height: int) -> Sensor:
        """The source's sensor; else one with its lights and an uncalibrated orthographic camera (1 px/mm).

        The slant limit is then `slant_limit_of` the lights, or the default where lights are too low for it.
        """
        if self.sensor is not None:
            return self.sensor
        try:
            slant_limit = slant_limit_of(self.lights.directions)
        except ItreeError:
            slant_limit = DEFAULT_SLANT_LIMIT
        camera = Camera("orthographic", 1.0, 1.0, (width - 1) / 2, (height - 1) / 2, width, height)
        return Sensor(
            camera, self.lights.directions, self.lights.intensities, Noise(), slant_limit, SMALLEST_REGION,
            working_distance=1.0, light_positions=self.lights.positions,
        )  # fmt: skip


def light_source(source: str | Path) -> LightSource:
    """The lights at `source`: a sensor JSON, the object that its "lights" holds, a scene folder, `bundled:NAME`, or a
    folder with light_directions.txt (and light_intensities.txt) in DiLiGenT's frame.

    Raises `ItreeError` that names the file.
    """
    path = Path(source)
    if (path / DIRECTIONS).is_file():
        return _text_files(path)
    if path.is_dir() and not any(path.glob("**/scene_lights.json")):
        raise ItreeError(
            f"{path}: the folder tells no lights: neither {DIRECTIONS} nor scene_lights.json is in it; give --lights a "
            "JSON file (made by `itree calibrate-lights`, or a sensor's)"
        )
    if path.is_file():
        lights = _lights_object(path)
        if lights is not None:
            return LightSource(lights, None)
    elif not path.is_dir() and not str(source).startswith("bundled:"):
        raise ItreeError(f"{path}: there is no such file or folder of lights")
    sensor = load_sensor(source)
    return LightSource(Lights(sensor.light_directions, sensor.light_intensities, sensor.light_positions), sensor)


def with_lights(sensor: Sensor, lights: Lights) -> Sensor:
    return replace(
        sensor, light_directions=lights.directions, light_intensities=lights.intensities,
        light_positions=lights.positions,
    )  # fmt: skip


def _lights_object(path: Path) -> Lights | None:
    """The lights of a file that is a "lights" object alone; None of another JSON object, which is a sensor's."""
    data = read_json(path)
    if isinstance(data, dict) and "camera" in data:
        return None
    check_json(data, SENSOR_SCHEMA["properties"]["lights"], str(path))
    lights = lights_of_entry(data, None, str(path))
    return lights._replace(intensities=exposed(lights, data, str(path)))


def _text_files(folder: Path) -> LightSource:
    directions = _numbers(folder / DIRECTIONS, (3,)) * FROM_VIEWER
    directions /= np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-12)
    path = folder / INTENSITIES
    if not path.is_file():
        return LightSource(Lights(*checked_lights(directions, None, str(folder / DIRECTIONS)), None), None)
    rgb = _numbers(path, (1, 3))
    lights = Lights(*checked_lights(directions, rgb.mean(1), str(path)), None)
    if not (rgb > 0.0).all():
        raise ItreeError(f"{path}: intensities must be positive")
    return LightSource(lights, None, rgb if rgb.shape[1] == 3 else None)


def _numbers(path: Path, columns: tuple[int, ...]) -> Float[np.ndarray, "lights columns"]:
    try:
        numbers = np.loadtxt(path, ndmin=2)
    except (OSError, ValueError) as error:
        raise ItreeError(f"{path}: cannot be read as a table of numbers ({error})") from error
    if numbers.shape[1] not in columns or not np.isfinite(numbers).all():
        raise ItreeError(f"{path}: {' or '.join(map(str, columns))} numbers a line, a line a light, are expected")
    return numbers
