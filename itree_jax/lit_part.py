"""A scene cut to the part of the image where a light shows parts, and its answers in the whole image again."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from itree_jax.detections import Detections
from itree_jax.sensing.box import Box, box_of, in_image, whole_of
from itree_jax.sensing.connected import NO_REGION
from itree_jax.sensing.lit import lit_by_any
from itree_jax.sensing.photometric import needle_map_on_host
from itree_jax.sensor import Sensor

GLANCE = 4  # every so manyth pixel is looked at first
AROUND = 32  # [px] beside what a light shows: how far a part's sides reach that no light does
WORTH_IT = 0.9  # of the image's pixels: to leave out fewer gains nothing


class Seen(NamedTuple):
    """One image under each light with its depth map [mm], and who took it."""

    images: Float[np.ndarray, "lights height width"]
    sensor: Sensor
    depth: Float[np.ndarray, "height width"]


def lit_box(seen: Seen) -> Box:
    """The part of the image in which a light shows what is as bright as parts, and what lies around it; all of it where
    that is not told, or nearly all is lit.

    Lights that stand near have another direction at each pixel of the whole image; it is not cut.
    """
    images, sensor, depth = seen
    camera = sensor.camera
    if sensor.is_depth_camera or sensor.light_positions is not None:
        return whole_of(camera)
    few = images[:, ::GLANCE, ::GLANCE]
    there = camera.cropped(0, 0, few.shape[2], few.shape[1], GLANCE)
    glance = replace(sensor, camera=there, region_of_interest=None)
    lit = lit_by_any(few, glance, needle_map_on_host(few, glance, depth[::GLANCE, ::GLANCE]))
    if lit is None:
        return whole_of(camera)
    shown = lit.repeat(GLANCE, axis=0).repeat(GLANCE, axis=1)[: camera.height, : camera.width]
    box = box_of(shown, camera, AROUND)
    return box if box.pixels < WORTH_IT * camera.height * camera.width else whole_of(camera)


def cut_to(seen: Seen, box: Box) -> Seen:
    """What was seen there."""
    images, sensor, depth = seen
    wanted = sensor.region_of_interest
    sensor = replace(
        sensor, camera=box.seen_by(sensor.camera), region_of_interest=None if wanted is None else box.of(wanted)
    )
    return Seen(box.of(images), sensor, box.of(depth))


def in_whole_image(found: Detections, box: Box, seen: Seen) -> Detections:
    """Answers of a part of the image, their places in the whole of it."""
    camera = seen.sensor.camera
    labels = None if found.labels is None else in_image(found.labels, box, camera, NO_REGION)
    moved = tuple(
        {**region, "uv": None if region["uv"] is None else [region["uv"][0] + box.left, region["uv"][1] + box.top]}
        for region in found.not_recognised
    )
    return replace(found, labels=labels, not_recognised=moved, depth=seen.depth)
