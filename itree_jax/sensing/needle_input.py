"""What photometric stereo needs, from whatever holds it: a scene folder, or a folder of photographs with its lights."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Bool, Float

from itree_jax.sensing.ambient import subtract_ambient
from itree_jax.sensing.exposure import check_light
from itree_jax.sensing.image_file import undistorted, warn_of_gamma
from itree_jax.sensing.light_source import LightSource, light_source, with_lights
from itree_jax.sensing.photographs import (
    Channel,
    photograph_folder,
    read_mask,
    read_photograph,
    read_photographs,
)
from itree_jax.sensing.scene_folder import load_scene
from itree_jax.sensor import Sensor


@dataclass(frozen=True)
class NeedleInput:
    """Images under each light, and the sensor that took them."""

    images: Float[np.ndarray, "lights height width"]  # linear, 1.0 = full scale, ambient light subtracted
    sensor: Sensor
    mask: Bool[np.ndarray, "height width"]  # where a normal is asked for
    depth: Float[np.ndarray, "height width"] | None  # [mm], 0 = none


def load_needle_input(
    images: Path, lights: str | Path | None = None, channel: Channel | None = None, ambient: Path | None = None
) -> NeedleInput:
    """A scene folder, or a folder of one photograph per light (`photograph_folder`), with lights from `light_source`.

    `lights` defaults to the folder itself. Colour is refused unless `channel` says what to take of it, or the folder
    tells the lights' colours, as DiLiGenT's do: then it is the mean of the channels, each over its intensity. Raises
    `ItreeError`: files that are missing or do not fit each other.
    """
    if (images / "scene_camera.json").is_file():
        return _of_scene(images, lights, channel, ambient)
    photographs = photograph_folder(images)
    source = light_source(images if lights is None else lights)
    if len(photographs.images) != len(source.lights.directions):
        raise ItreeError(
            f"{images}: there are {len(photographs.images)} images for {len(source.lights.directions)} lights of "
            f"{images if lights is None else lights}"
        )
    if channel is None and source.colour_intensities is not None:
        channel = "mean"
    colours, source = _colours(source, channel)
    bit_depth = None if source.sensor is None else source.sensor.bit_depth
    gamma = 1.0 if source.sensor is None else source.sensor.gamma
    stored = read_photographs(photographs, channel, bit_depth, gamma, colours)
    warn_of_gamma(photographs.images[0], bit_depth, gamma)
    height, width = stored.shape[1:]
    sensor = source.sensor_for(width, height)
    _check_size(images, stored, sensor)
    mask = np.ones((height, width), bool)
    if photographs.mask is not None:
        mask = read_mask(photographs.mask, (height, width))
    elif sensor.region_of_interest is not None:
        mask = sensor.region_of_interest
    check_light(stored, sensor.noise, photographs.names)
    if ambient is not None:
        each = [None] * len(stored) if colours is None else list(colours)
        dark = np.stack([read_photograph(ambient, channel, bit_depth, gamma, colour) for colour in each])
        stored = _less(stored, dark, sensor, ambient)
    ideal = np.stack([undistorted(image, sensor.camera, sensor.distortion) for image in stored])
    return NeedleInput(ideal, sensor, mask, None)


def _of_scene(
    folder: Path, lights: str | Path | None, channel: Channel | None, ambient: Path | None
) -> NeedleInput:
    if channel is not None:
        raise ItreeError(f"{folder}: the images of a scene folder have one channel; leave out the channel")
    source = None if lights is None else light_source(lights)
    scene = load_scene(folder, sensor=None if source is None else source.sensor)
    sensor, images = scene.sensor, scene.images
    if source is not None:
        if len(source.lights.directions) != len(images):
            raise ItreeError(
                f"{folder}: there are {len(images)} images for {len(source.lights.directions)} lights of {lights}"
            )
        sensor = with_lights(sensor, source.lights)
    if ambient is not None:
        dark = read_photograph(ambient, None, sensor.bit_depth, sensor.gamma)
        images = _less(images, undistorted(dark, sensor.camera, sensor.distortion), sensor, ambient)
    mask = np.ones(images.shape[1:], bool) if sensor.region_of_interest is None else sensor.region_of_interest
    return NeedleInput(images, sensor, mask, scene.depth)


def _colours(
    source: LightSource, channel: Channel | None
) -> tuple[Float[np.ndarray, "lights 3"] | None, LightSource]:
    """The light colours to divide by for the mean, or the intensities of the one channel that is taken."""
    rgb = source.colour_intensities
    if rgb is None or channel in (None, "mean"):
        return rgb, source
    one = rgb[:, ("red", "green", "blue").index(channel)]
    return None, replace(source, lights=source.lights._replace(intensities=one))


def _check_size(folder: Path, images: np.ndarray, sensor: Sensor) -> None:
    camera = sensor.camera
    if images.shape[1:] != (camera.height, camera.width):
        raise ItreeError(
            f"{folder}: images are {images.shape[2]} x {images.shape[1]} px, the sensor's camera has {camera.width} x "
            f"{camera.height} px"
        )


def _less(images: np.ndarray, dark: np.ndarray, sensor: Sensor, ambient: Path) -> np.ndarray:
    try:
        return subtract_ambient(images, dark, sensor.noise)
    except ItreeError as error:
        raise ItreeError(f"{ambient}: {error}") from error
