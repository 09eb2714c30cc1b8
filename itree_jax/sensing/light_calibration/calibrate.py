"""From folders of sphere photographs to lights: the story that the stages beside this file tell in pieces."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Float

from itree_jax.sensing.image_file import undistorted
from itree_jax.sensing.light_calibration.chrome import Highlights, find_highlights, lights_from_highlights
from itree_jax.sensing.light_calibration.matte import lights_from_shading, strengths_along
from itree_jax.sensing.light_calibration.near import refine_from_shading, triangulate
from itree_jax.sensing.light_calibration.sphere import Sphere, fit_sphere, uncalibrated_camera
from itree_jax.sensing.lights import checked_lights, directions_on_axis
from itree_jax.sensing.photographs import Channel, photograph_folder, read_mask, read_photographs
from itree_jax.sensor import Sensor

LEAST_LIGHTS = 3
Kind = Literal["chrome", "matte"]


@dataclass(frozen=True)
class SphereImages:
    """A sphere at one place, under each light."""

    folder: Path
    names: list[str]
    images: Float[np.ndarray, "lights height width"]  # linear, 1.0 = full scale, undistorted
    sphere: Sphere


@dataclass(frozen=True)
class Calibration:
    """Lights with what tells how far to trust them."""

    directions: Float[np.ndarray, "lights 3"]  # unit, camera frame; of near lights where the axis meets the distance
    intensities: Float[np.ndarray, "lights"]  # relative to their mean
    positions: Float[np.ndarray, "lights 3"] | None  # [mm], camera frame: near lights
    outline_rms: float  # [px] of the worst sphere
    highlights: list[Highlights] | None  # of each sphere place, from a mirror sphere
    shading_residuals: Float[np.ndarray, "lights"] | None  # robust std over the strength, of a matte sphere
    misses: Float[np.ndarray, "lights"] | None  # [mm] by which the rays of several places miss the position

    def to_json(self) -> dict[str, Any]:
        """What the sensor JSON's "lights" holds."""
        place = {"directions": self.directions.tolist()}
        if self.positions is not None:
            place = {"positions_mm": self.positions.tolist()}
        return {**place, "intensities": self.intensities.tolist()}


def load_sphere(
    folder: Path,
    sensor: Sensor | None = None,
    mask: Path | None = None,
    channel: Channel = "mean",
    radius_mm: float = 1.0,
) -> SphereImages:
    """The photographs of a sphere in `folder`, one under each light, and the sphere from its mask.

    `mask` defaults to the image in the folder that is named so. Without a sensor the camera is taken as orthographic.
    Raises `ItreeError`: fewer than three images, no mask, files that do not fit.
    """
    photographs = photograph_folder(folder)
    if len(photographs.images) < LEAST_LIGHTS:
        raise ItreeError(
            f"{folder}: {len(photographs.images)} images are too few: one under each of {LEAST_LIGHTS} lights or more "
            "is needed"
        )
    mask = photographs.mask if mask is None else mask
    if mask is None:
        raise ItreeError(
            f"{folder}: no mask of the sphere; put one beside the images (mask.png, the sphere white), or give one"
        )
    bit_depth, gamma = (None, 1.0) if sensor is None else (sensor.bit_depth, sensor.gamma)
    images = read_photographs(photographs, channel, bit_depth, gamma)
    height, width = images.shape[1:]
    inside = read_mask(mask, (height, width))
    camera = uncalibrated_camera(width, height) if sensor is None else sensor.camera
    if sensor is not None and any(sensor.distortion):
        images = np.stack([undistorted(image, camera, sensor.distortion) for image in images])
        inside = undistorted(inside.astype(np.float32), camera, sensor.distortion) > 0.5
    return SphereImages(folder, photographs.names, images, fit_sphere(inside, camera, radius_mm, str(mask)))


def calibrate(
    places: Sequence[SphereImages], kind: Kind, near_at: float | None = None, matte: SphereImages | None = None
) -> Calibration:
    """Lights from a mirror ("chrome") or a matte sphere at one place or more; near lights if `near_at` is given.

    Distant lights: the mean direction over the places. Near lights: positions by triangulation, of a matte sphere
    refined on its shading; `near_at` [mm] is the working distance that directions and intensities are told for, and
    spheres must be in mm. Intensities of a mirror sphere come from the `matte` sphere's images under the same lights if
    given (distant lights only), else they are 1. Raises `ItreeError`.
    """
    _check_counts([*places, *([matte] if matte else [])])
    highlights, shading = None, None
    if kind == "chrome":
        highlights = [find_highlights(place.images, place.sphere, place.names) for place in places]
        seen = [lights_from_highlights(h.uv, p.sphere) for h, p in zip(highlights, places, strict=True)]
        directions, points = (np.stack(arrays) for arrays in zip(*seen, strict=True))
    else:
        shading = [lights_from_shading(place.images, place.sphere, names=place.names) for place in places]
        directions = np.stack([s.directions for s in shading])
        points = np.repeat(np.stack([place.sphere.centre for place in places])[:, None], directions.shape[1], axis=1)
    positions = misses = residuals = None
    intensities = np.ones(directions.shape[1])
    if near_at is None:
        mean = directions.mean(0)
        direction = mean / np.linalg.norm(mean, axis=1, keepdims=True)
        if shading is not None:
            intensities = np.mean([s.intensities for s in shading], axis=0)
            residuals = np.max([s.residuals for s in shading], axis=0)
        elif matte is not None:
            known = strengths_along(matte.images, matte.sphere, direction)
            intensities, residuals = known.intensities, known.residuals
    else:
        positions, misses = triangulate(points, directions)
        if kind == "matte":
            images, spheres = np.stack([place.images for place in places]), [place.sphere for place in places]
            near = refine_from_shading(images, spheres, positions, near_at)
            positions, residuals = near.positions, near.residuals
            intensities = near.strengths / near.strengths.mean()
        direction = directions_on_axis(positions, near_at)
    direction, intensities = checked_lights(direction, intensities, "the lights found")
    rms = max(place.sphere.outline_rms for place in places)
    return Calibration(direction, intensities, positions, rms, highlights, residuals, misses)


def _check_counts(places: Sequence[SphereImages]) -> None:
    first = places[0]
    for place in places[1:]:
        if place.images.shape != first.images.shape:
            raise ItreeError(
                f"{place.folder}: its {_shape(place)} are not like the {_shape(first)} of {first.folder}: every place "
                "of the sphere needs one image under each light"
            )


def _shape(place: SphereImages) -> str:
    count, height, width = place.images.shape
    return f"{count} images of {width} x {height} px"
