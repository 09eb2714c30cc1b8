"""Pictures of the part itself: representative attitudes with what is detectable, and the identifying faces."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from itree_cad.part import Part
from itree_kernels.apparent import cast_apparent_shapes
from itree_kernels.camera import Camera
from itree_kernels.mesh import RayMesh, ray_mesh
from jaxtyping import Bool, Float, Int, UInt8

from itree_jax.report.palette import GREY, Rgb, cycle
from itree_jax.report.scene_pictures import badge, innermost
from itree_jax.sensor import Sensor
from itree_jax.tree.tree import InterpretationTree

SIDE = 220  # [px] of a picture
FINER = 2  # it is drawn so many times as large and made smaller: smooth edges
FILL = 0.94  # of the picture that the part's sphere takes
LIGHT, DARK = 0.97, 0.62  # grey of surfaces that face the viewer, and of steep ones
SHADE = 0.30  # how much darker a coloured face gets with its slant
LEAST_BADGE = 0.004  # of the picture: smaller pieces of a face carry no number
MOST_FACE_VIEWS = 6  # from all sides

Cutout = UInt8[np.ndarray, "_ _ 4"]


@dataclass(frozen=True)
class PartView:
    """The part from one attitude under the sensor's lights."""

    face: Int[np.ndarray, "h w"]  # -1 where nothing
    facing: Float[np.ndarray, "h w"]  # cosine of the slant, 0 where nothing
    detectable: Bool[np.ndarray, "h w"]
    px_per_mm: float


def part_views(part: Part, sensor: Sensor, R_cam_obj: Float[np.ndarray, "views 3 3"]) -> list[PartView]:
    """Casts the part from attitudes by an orthographic camera that holds it whole."""
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle)
    return [part_view(mesh, part, sensor, R) for R in R_cam_obj]


def part_view(mesh: RayMesh, part: Part, sensor: Sensor, R: Float[np.ndarray, "3 3"]) -> PartView:
    side = SIDE * FINER
    middle = 0.5 * (part.vertices.min(axis=0) + part.vertices.max(axis=0))
    reach = float(np.linalg.norm(part.vertices - middle, axis=1).max())
    scale = FILL * side / (2.0 * reach)
    camera = Camera("orthographic", scale, scale, (side - 1) / 2, (side - 1) / 2, side, side)
    t = np.array([0.0, 0.0, 4.0 * reach]) - R @ middle
    shapes = cast_apparent_shapes(mesh, R[None], t[None], camera, sensor.light_directions, sensor.slant_limit)
    facing = np.maximum(-shapes.normal[0, ..., 2], 0.0)
    return PartView(shapes.face[0].astype(np.int32), facing, shapes.detectable[0], scale)


def colour_of_faces(tree: InterpretationTree) -> list[Rgb]:
    """Identifying faces in the colour of their digit, all others grey."""
    colours = [GREY] * tree.part.face_count
    for digit, face in enumerate(tree.groups.identifying_faces):
        colours[int(face)] = cycle(digit)
    return colours


def cutout(tree: InterpretationTree, view: PartView, coloured: Bool[np.ndarray, "h w"]) -> Cutout:
    """The part on a transparent ground; `coloured` pixels in the colours of their faces, the rest in grey.

    Coloured identifying faces carry their digit's number, counted from 1 as in the paper.
    """
    hit = view.face >= 0
    shade = DARK + (LIGHT - DARK) * view.facing
    rgb = np.repeat((255.0 * shade)[..., None], 3, axis=2)
    table = np.array(colour_of_faces(tree), float)
    paint = coloured & hit
    rgb[paint] = table[view.face[paint]] * (1.0 - SHADE * (1.0 - view.facing[paint]))[:, None]
    borders = edges(view.face)
    rgb[borders & hit] = 70.0
    rgb[edges(np.where(coloured, view.face, -2), 3) & grown(paint)] = 10.0
    picture = np.clip(rgb, 0, 255).astype(np.uint8)
    bare = picture.copy()
    for digit, face in enumerate(tree.groups.identifying_faces):
        number_pieces(picture, paint & (view.face == face), str(digit + 1), cycle(digit))
    opaque = grown(hit) | (picture != bare).any(axis=2)  # a number may stand out over the part's rim
    return shrunk(np.dstack([picture, np.where(opaque, 255, 0).astype(np.uint8)]))


def number_pieces(picture: UInt8[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"], label: str, colour: Rgb) -> None:
    """A badge on each connected piece of a face that is large enough for it."""
    count, pieces, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    for k in range(1, count):
        if stats[k, cv2.CC_STAT_AREA] > LEAST_BADGE * mask.size:
            badge(picture, innermost(pieces == k), label, colour, 0.5 * FINER)


def shrunk(picture: Cutout) -> UInt8[np.ndarray, "side side 4"]:
    """To its final size; colours are weighted by alpha, so that no dark rim appears."""
    alpha = picture[..., 3:].astype(np.float32) / 255.0
    premultiplied = np.concatenate([picture[..., :3] * alpha, alpha], axis=2).astype(np.float32)
    small = cv2.resize(premultiplied, (SIDE, SIDE), interpolation=cv2.INTER_AREA)
    rgb = small[..., :3] / np.maximum(small[..., 3:], 1e-6)
    return np.clip(np.round(np.concatenate([rgb, 255.0 * small[..., 3:]], axis=2)), 0, 255).astype(np.uint8)


def grown(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """By one pixel to all sides."""
    return cv2.dilate(mask.astype(np.uint8), np.ones((3, 3))).astype(bool)


def trimmed(pictures: Sequence[Cutout]) -> list[Cutout]:
    """Without the rows that are empty in all of them, so that their scale stays the same."""
    used = np.flatnonzero(np.any([p[..., 3].any(axis=1) for p in pictures], axis=0))
    if len(used) == 0:
        return list(pictures)
    return [p[used[0] : used[-1] + 1] for p in pictures]


def edges(ids: Int[np.ndarray, "h w"], width: int = 1) -> Bool[np.ndarray, "h w"]:
    """Pixels within `width` of a change of id."""
    change = np.zeros(ids.shape, np.uint8)
    change[:, 1:] |= ids[:, 1:] != ids[:, :-1]
    change[1:] |= ids[1:] != ids[:-1]
    return cv2.dilate(change, np.ones((width, width))).astype(bool)


def attitude_cutouts(tree: InterpretationTree) -> list[Cutout]:
    """Each group's representative attitude with its detectable regions in colour."""
    views = part_views(tree.part, tree.sensor, tree.groups.representative_rotations())
    return trimmed([cutout(tree, view, view.detectable) for view in views])


def face_cutouts(tree: InterpretationTree) -> tuple[list[int], list[Cutout]]:
    """The part from few views of the dome that together show the identifying faces: the views, and a picture each."""
    chosen = covering_views(tree)
    views = part_views(tree.part, tree.sensor, tree.groups.R_cam_obj[chosen])
    faces = tree.groups.identifying_faces
    return chosen, trimmed([cutout(tree, view, np.isin(view.face, faces)) for view in views])


def covering_views(tree: InterpretationTree) -> list[int]:
    """Views picked one after another, each the one that shows most of the area of faces not shown yet."""
    area = tree.groups.face_area[:, tree.groups.identifying_faces]
    share = area / np.maximum(area.max(axis=0), 1e-9)
    left, chosen = np.ones(area.shape[1], bool), []
    while left.any() and len(chosen) < MOST_FACE_VIEWS:
        gain = (share * left).sum(axis=1)
        best = int(np.argmax(gain))
        if gain[best] <= 0.0:
            break
        chosen.append(best)
        left &= share[best] < 0.5
    return chosen or [0]
