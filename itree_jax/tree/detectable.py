"""What the sensor detects of a part from many attitudes: the table the shape labels are read from.

Seen by an orthographic camera at the sensor's pixel size, as in the paper; a pinhole sensor is compiled at its working
distance.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from itree_cad.part import Part
from itree_kernels.apparent import ApparentShapes, cast_apparent_shapes
from itree_kernels.camera import Camera
from itree_kernels.mesh import RayMesh
from jaxtyping import Bool, Float, Int

from itree_jax.sensor import Sensor

# (views done, views in all)
Progress = Callable[[int, int], None]
# Finer pixels than this share of the part change no area by more than about a percent, but cost time.
MOST_PIXELS_ACROSS = 256
# Pixels cast in one launch: under 50 MB, in pieces that the allocator gives back. With four times as many 3840 views
# held 0.8 GB more and took as long (`experiments/benchmarks/compile_scaling.py`).
PIXELS_AT_ONCE = 2_000_000
MARGIN = 2  # [px] around the part
# Below this the two moments of a section are equal but for its pixels, and it has no direction of its own.
LEAST_UNIQUENESS = 0.02


@dataclass(frozen=True)
class Detectable:
    """What is detectable from each view."""

    face_area: Float[np.ndarray, "views faces"]  # detectable area of each component face in the image plane [mm^2]
    region_count: Int[np.ndarray, "views"]  # regions over the sensor's smallest, whatever faces they are made of


def part_camera(part: Part, sensor: Sensor) -> Camera:
    """An orthographic camera that holds the part in any attitude, its centre of view on the optical axis."""
    pitch = max(sensor.mm_per_px, part.diameter / MOST_PIXELS_ACROSS)
    size = int(np.ceil(2.0 * _reach(part) / pitch)) + 2 * MARGIN
    centre = (size - 1) / 2.0
    return Camera("orthographic", 1.0 / pitch, 1.0 / pitch, centre, centre, size, size)


def detectable(
    mesh: RayMesh,
    part: Part,
    sensor: Sensor,
    R_cam_obj: Float[np.ndarray, "views 3 3"],
    progress: Progress | None = None,
) -> Detectable:
    """Casts every view and counts what is detectable in it."""
    pixel = part_camera(part, sensor).mm_per_px(1.0) ** 2
    views, done = len(R_cam_obj), 0
    seen = Detectable(np.zeros((views, part.face_count)), np.zeros(views, np.int32))
    for shapes in cast_views(mesh, part, sensor, R_cam_obj):
        for face, mask in zip(shapes.face, shapes.detectable, strict=True):
            seen.face_area[done] = np.bincount(face[mask], minlength=part.face_count) * pixel
            seen.region_count[done] = count_regions(mask, smallest_region_px(part, sensor))
            done += 1
        if progress is not None:
            progress(done, views)
    return seen


def cast_views(
    mesh: RayMesh, part: Part, sensor: Sensor, R_cam_obj: Float[np.ndarray, "views 3 3"]
) -> Iterator[ApparentShapes]:
    """Apparent shapes in chunks of bounded memory, the part's middle on the optical axis of `part_camera`."""
    camera = part_camera(part, sensor)
    views_at_once = max(1, PIXELS_AT_ONCE // (camera.width * camera.height))
    for first in range(0, len(R_cam_obj), views_at_once):
        R = np.asarray(R_cam_obj[first : first + views_at_once])
        t = -R @ part.middle + np.array([0.0, 0.0, part.diameter])
        yield cast_apparent_shapes(mesh, R, t, camera, sensor.light_directions, sensor.slant_limit)


def smallest_region_px(part: Part, sensor: Sensor) -> float:
    """The sensor's smallest region in pixels of `part_camera`."""
    return sensor.smallest_region / part_camera(part, sensor).mm_per_px(1.0) ** 2


def count_regions(mask: Bool[np.ndarray, "h w"], smallest_px: float) -> int:
    """Number of 8-connected sets of more than `smallest_px` pixels."""
    stats = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)[2]
    return int(np.count_nonzero(stats[1:, cv2.CC_STAT_AREA] > smallest_px))


def section_direction(mask: Bool[np.ndarray, "h w"]) -> float:
    """Direction [rad] of the larger moment of a section in the image plane, x right, y down; 0 if it has none."""
    v, u = np.nonzero(mask)
    if len(u) < 2:
        return 0.0
    (xx, xy), (_, yy) = np.cov(np.stack([u, v]), bias=True)
    if np.hypot(xx - yy, 2.0 * xy) <= LEAST_UNIQUENESS * (xx + yy):
        return 0.0
    return 0.5 * float(np.arctan2(2.0 * xy, xx - yy))


def _reach(part: Part) -> float:
    return float(np.linalg.norm(part.vertices - part.middle, axis=1).max())
