"""The world model: recognised parts as CAD solids, everything else that is seen as prisms, and the bin
(Ikeuchi 1987, sec. 3.2, figures 6d-6f).

All of it is in one frame, the camera's [mm]; `R_cam_up` tells which way is up.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from itree_cad.part import Part
from jaxtyping import Bool, Float

from itree_jax.detections import TOO_DARK, Detection, Detections
from itree_jax.sensor import Sensor
from itree_jax.tree.tree import InterpretationTree
from itree_jax.world.bin_walls import BinWalls
from itree_jax.world.dodecagon import dodecagon
from itree_jax.world.explained import BIN_AGREES, explained, without_specks
from itree_jax.world.prism import NO_REGION_NUMBER, Prism, corners_of_pixels, prisms_over

MOSTLY = 0.5  # of a region's pixels: explained when the placed parts and the bin show so many of them
LOWEST = 0.5  # [%] percentile of heights that is taken for the floor where no bin tells it: noise reaches lower
NO_NEEDLES = "no region: seen by depth alone, too steep, shadowed or small for needles"


@dataclass(frozen=True)
class PlacedPart:
    """A recognised part as a solid in the world."""

    index: int  # in `Detections.by_offer`: part 0 is the one to be picked first
    detection: Detection
    part: Part

    @property
    def T_cam_obj(self) -> Float[np.ndarray, "4 4"]:
        return self.detection.T_cam_obj

    @property
    def X_cam(self) -> Float[np.ndarray, "vertices 3"]:
        """The part's vertices [mm]."""
        return self.part.vertices @ self.detection.R_cam_obj.T + self.detection.t_cam_obj


@dataclass(frozen=True)
class World:
    """What lies where, in the camera's frame [mm]."""

    parts: tuple[PlacedPart, ...]
    prisms: tuple[Prism, ...]
    bin: BinWalls | None
    R_cam_up: Float[np.ndarray, "3 3"]  # upright frame (x, y level, z up, origin at the camera) -> camera
    floor: float  # [mm] height of the floor in the upright frame: below the camera, so negative

    @property
    def up_cam(self) -> Float[np.ndarray, "3"]:
        """Unit, upward, in the camera frame."""
        return self.R_cam_up[:, 2]

    def height(self, X_cam: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Of points above the floor [mm]."""
        return X_cam @ self.up_cam - self.floor


def world_model(
    detections: Detections,
    trees: Sequence[InterpretationTree],
    sensor: Sensor,
    depth: Float[np.ndarray, "height width"] | None = None,
    R_w2c: Float[np.ndarray, "3 3"] | None = None,
    bin_: BinWalls | None = None,
) -> World:
    """The world as one image and its interpretation tell it.

    Args:
        detections: with their `labels`, as `recognize` returns them.
        trees: of the parts that were looked for.
        sensor: that took the image.
        depth: z [mm] per pixel, 0 = none; None: what `detections` were found by, a map or two cameras' match.
        R_w2c: world (z up) to camera; None: the camera looks straight down.
        bin_: walls and floor, if they are known; else the floor is the lowest that is seen, and walls are prisms.

    Every region without a pose is a prism from its height (the 90th percentile) down to the floor, unless placed parts
    or the bin show most of it. Surface that is seen in depth but belongs to no such region (a steep side, a shadow, the
    half of a region that another part's pose leaves over) is prisms too: the paper leaves it out, a gripper must not.

    Where a region has no depth, its height isn't known. It is taken to be as high as the highest placed part (or, with
    none, one diameter above the floor), and its prism holds the region's outline at any depth from there to the floor;
    without any depth that is the plane at the working distance, or lower where a placed part reaches lower. Regions
    called darker than the parts are then taken for bin and floor.
    """
    depth = detections.depth if depth is None else depth
    R_cam_up = np.diag([1.0, -1.0, -1.0]) if R_w2c is None else np.asarray(R_w2c, float)
    of_object = {tree.obj_id: tree.part for tree in trees}
    parts = tuple(PlacedPart(k, d, of_object[d.obj_id]) for k, d in enumerate(detections.by_offer))
    floor = _floor(parts, depth, sensor, R_cam_up, bin_)
    labels = detections.labels
    prisms: list[Prism] = []
    if labels is not None:
        placed = [(p.part, p.T_cam_obj) for p in parts]
        known = explained(depth, placed, bin_, sensor.camera)
        diameter = max((part.diameter for part in of_object.values()), default=0.0)
        top = max((float((p.X_cam @ R_cam_up[:, 2]).max()) for p in parts), default=floor + diameter)
        prisms = _prisms_of_unknown_height(detections, known, depth, sensor, R_cam_up, floor, top)
        if depth is not None:
            prisms += _prisms_by_depth(detections, known, np.asarray(depth, float), sensor, R_cam_up, floor)
    return World(parts, tuple(prisms), bin_, R_cam_up, floor)


def _floor(
    parts: Sequence[PlacedPart], depth: Float[np.ndarray, "height width"] | None, sensor: Sensor,
    R_cam_up: Float[np.ndarray, "3 3"], bin_: BinWalls | None,
) -> float:
    """Height [mm] of the floor in the upright frame."""
    up = R_cam_up[:, 2]
    if bin_ is not None:
        return float(bin_.T_cam_bin[:3, 3] @ up)
    if depth is not None and (depth > 0).any():
        corners = corners_of_pixels(depth > 0, depth, sensor.camera, R_cam_up)
        return float(np.percentile(corners[:, 0, 2], LOWEST))
    level = sensor.working_distance * float(up[2])
    return min([level, *(float((p.X_cam @ up).min()) for p in parts)])


def _prisms_by_depth(
    detections: Detections, known: Bool[np.ndarray, "height width"], depth: Float[np.ndarray, "height width"],
    sensor: Sensor, R_cam_up: Float[np.ndarray, "3 3"], floor: float,
) -> list[Prism]:
    """Of the regions without a pose, and of all other surface that nothing explains."""
    labels, least = detections.labels, sensor.smallest_region
    assert labels is not None
    rest = (depth > 0) & ~known
    prisms: list[Prism] = []
    for one in detections.not_recognised:
        seen = (labels == one["region"]) & (depth > 0)
        if not seen.any() or known[seen].mean() > MOSTLY:
            continue
        pixels = corners_of_pixels(seen, depth, sensor.camera, R_cam_up)
        prisms += prisms_over(pixels, int(one["region"]), floor, str(one["reason"]), least)
        rest &= ~seen
    pieces, label = cv2.connectedComponents(without_specks(rest).astype(np.uint8), connectivity=8)
    for piece in range(1, pieces):
        pixels = corners_of_pixels(label == piece, depth, sensor.camera, R_cam_up)
        prisms += prisms_over(pixels, NO_REGION_NUMBER, floor, NO_NEEDLES, least)
    return [p for p in prisms if p.height > BIN_AGREES]  # what is as low as that is the floor itself


def _prisms_of_unknown_height(
    detections: Detections, known: Bool[np.ndarray, "height width"], depth: Float[np.ndarray, "height width"] | None,
    sensor: Sensor, R_cam_up: Float[np.ndarray, "3 3"], floor: float, top: float,
) -> list[Prism]:
    """Of the regions without a pose of which no depth was measured: as tall as anything that is known."""
    labels = detections.labels
    assert labels is not None
    prisms: list[Prism] = []
    for one in detections.not_recognised:
        seen = labels == one["region"]
        if depth is not None and (depth[seen] > 0).any():
            continue
        if one["reason"] == TOO_DARK or not seen.any() or known[seen].mean() > MOSTLY:
            continue
        # the region's outline at any depth between: its hull is that of the outlines at both ends
        pixels = np.concatenate([_at_height(seen, level, sensor, R_cam_up) for level in (floor, top)])
        outline = dodecagon(pixels[..., :2].reshape(-1, 2))
        prisms.append(Prism(int(one["region"]), outline, top, floor, str(one["reason"])))
    return prisms


def _at_height(
    mask: Bool[np.ndarray, "height width"], level: float, sensor: Sensor, R_cam_up: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "pixels 4 3"]:
    """Corners of pixels whose viewing rays are cut at a height [mm] of the upright frame, in that frame."""
    corners = corners_of_pixels(mask, np.ones(mask.shape), sensor.camera, R_cam_up)
    beyond = corners_of_pixels(mask, np.full(mask.shape, 2.0), sensor.camera, R_cam_up)
    ray = beyond - corners
    return corners + (level - corners[..., 2:]) / ray[..., 2:] * ray
