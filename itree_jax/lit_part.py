"""A scene cut to the part of its images where a light shows parts, and its answers in the whole image again."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from itree_jax.detections import Detections
from itree_jax.sensing.box import Box, box_of, in_image
from itree_jax.sensing.connected import NO_REGION
from itree_jax.sensing.lit import lit_by_any
from itree_jax.sensing.needles_by_chunks import needle_map_on_host
from itree_jax.sensor import Sensor

GLANCE = 4  # every so manyth pixel is looked at first
AROUND = 32  # [px] beside what a light shows: how far a part's sides reach that no light does
WORTH_IT = 0.9  # of the image's pixels: to leave out fewer gains nothing


class Seen(NamedTuple):
    """One image under each light with its depth map [mm], and who took it."""

    images: Float[np.ndarray, "lights height width"]
    sensor: Sensor
    depth: Float[np.ndarray, "height width"]


def lit_part(seen: Seen) -> tuple[Seen, Box] | None:
    """What was seen where a light shows what is as bright as parts, and around it, and which part of the image that is.
    None where that is not told, or is nearly everywhere.

    Lights that stand near have another direction at each pixel of the whole image; it is not cut.
    """
    shown = shown_by_lights(seen.images, seen.sensor)
    if shown is None:
        return None
    box = box_of(shown, AROUND)
    if box.pixels > WORTH_IT * shown.size:
        return None
    wanted = seen.sensor.region_of_interest
    sensor = replace(
        seen.sensor, camera=box.seen_by(seen.sensor.camera),
        region_of_interest=None if wanted is None else box.of(wanted),
    )  # fmt: skip
    return Seen(box.of(seen.images), sensor, box.of(seen.depth)), box


def shown_by_lights(
    images: Float[np.ndarray, "lights height width"], sensor: Sensor
) -> Bool[np.ndarray, "height width"] | None:
    """`lit_by_any` at every fourth pixel, for all; None where that is not told, or nothing is lit."""
    if sensor.is_depth_camera or sensor.light_positions is not None:
        return None
    few = np.ascontiguousarray(images[:, ::GLANCE, ::GLANCE])
    camera = sensor.camera.cropped(0, 0, few.shape[2], few.shape[1], GLANCE)
    glance = replace(sensor, camera=camera, region_of_interest=None)
    lit = lit_by_any(few, glance, needle_map_on_host(few, glance, None))
    if lit is None or not lit.any():
        return None
    return lit.repeat(GLANCE, axis=0).repeat(GLANCE, axis=1)[: images.shape[1], : images.shape[2]]


def in_whole_image(found: Detections, box: Box, seen: Seen) -> Detections:
    """Answers of a part of the image, their places in the whole of it."""
    labels = None if found.labels is None else in_image(found.labels, box, seen.sensor.camera, NO_REGION)
    moved = tuple(
        {**region, "uv": None if region["uv"] is None else [region["uv"][0] + box.left, region["uv"][1] + box.top]}
        for region in found.not_recognised
    )
    return replace(found, labels=labels, not_recognised=moved, depth=seen.depth)
