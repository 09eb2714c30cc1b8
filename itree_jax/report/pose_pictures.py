"""Pictures of what was recognised: contours of the poses on the image, and the residuals in three colours."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from itree_jax.report.palette import AGREE, BLACK, CONTRADICT, HIDDEN, TRUTH, Rgb
from itree_jax.report.pose_render import RenderedPose
from itree_jax.report.residuals import AGREES, CONTRADICTS, IS_HIDDEN, Codes
from itree_jax.report.scene_pictures import Picture, badge, innermost, scaled

CREASE_STRENGTH = 0.55  # edges inside of the silhouette are drawn weaker
HIDDEN_STRENGTH = 0.5  # ... and so is a silhouette behind something nearer
CROP_MARGIN = 10  # [px] around a pose in its own picture
CROP_HEIGHT = 200  # [px]
DASH = 7  # [px] of the truth's dashed lines
BADGE_SIZE = 0.55  # of OpenCV's font, on a picture 640 px wide
LEAST_BADGE_SIZE = 0.4  # smaller digits cannot be read
CODE_COLOURS = ((AGREES, AGREE), (CONTRADICTS, CONTRADICT), (IS_HIDDEN, HIDDEN))

Line = Int[np.ndarray, "_ 1 2"]


class Outlined(NamedTuple):
    """A pose to be drawn at the scale of the picture."""

    pose: RenderedPose
    name: str
    colour: Rgb
    tolerance: float  # [mm] something must be nearer by this to hide the contour


def overlay(
    background: Picture, poses: Sequence[Outlined], in_front: Float[np.ndarray, "h w"], truth: Sequence[RenderedPose]
) -> Picture:
    """Contours with a badge each on a picture of the poses' scale; true poses in dashed white.

    `in_front`: z [mm] of what is nearest to the camera at each pixel of the image, inf where that is not known.
    Silhouettes behind it are thin and weak.
    """
    picture = background.copy()
    width = max(1, round(picture.shape[1] / 640))
    nearest = cv2.resize(in_front.astype(np.float32), picture.shape[1::-1], interpolation=cv2.INTER_NEAREST)
    for shown in poses:
        draw_creases(picture, shown.pose, shown.colour, nearest, shown.tolerance)
        draw_silhouette(picture, shown, nearest, width)
    for pose in truth:
        pieces = [piece for line in silhouettes(pose) for piece in dashes(line)]
        cv2.polylines(picture, pieces, False, TRUTH, width, cv2.LINE_AA)
    for shown in poses:
        spot = innermost(shown.pose.hit & ~behind(shown.pose, nearest, shown.tolerance))
        uv = spot + np.array([shown.pose.left, shown.pose.top])
        badge(picture, uv, shown.name, shown.colour, max(LEAST_BADGE_SIZE, BADGE_SIZE * picture.shape[1] / 640))
    return picture


def behind(pose: RenderedPose, nearest: Float[np.ndarray, "h w"], tolerance: float) -> Bool[np.ndarray, "h2 w2"]:
    """Pixels of the pose's window where something else is nearer."""
    return pose.hit & (nearest[pose.window] < pose.depth - tolerance)


def draw_creases(
    picture: Picture, pose: RenderedPose, colour: Rgb, nearest: Float[np.ndarray, "h w"], tolerance: float
) -> None:
    """Thin lines between component faces where they are seen."""
    inside = cv2.erode(pose.hit.astype(np.uint8), np.ones((3, 3))).astype(bool)
    crease = face_borders(pose.face) & inside & ~behind(pose, nearest, tolerance)
    view = picture[pose.window]
    view[crease] = ((1 - CREASE_STRENGTH) * view[crease] + CREASE_STRENGTH * np.array(colour)).astype(np.uint8)


def draw_silhouette(picture: Picture, shown: Outlined, nearest: Float[np.ndarray, "h w"], width: int) -> None:
    """A bold line with a dark rim where it is seen, a thin weak one where it is hidden."""
    hidden: np.ndarray = behind(shown.pose, nearest, shown.tolerance)
    seen_pieces, hidden_pieces = [], []
    for line in silhouettes(shown.pose):
        at = line[:, 0] - np.array([shown.pose.left, shown.pose.top])
        flag = np.asarray(hidden[at[:, 1], at[:, 0]])
        for piece, is_hidden in runs(line, flag):
            (hidden_pieces if is_hidden else seen_pieces).append(piece)
    weak = picture.copy()
    cv2.polylines(weak, hidden_pieces, False, shown.colour, max(1, width - 1), cv2.LINE_AA)
    cv2.addWeighted(weak, HIDDEN_STRENGTH, picture, 1 - HIDDEN_STRENGTH, 0, dst=picture)
    cv2.polylines(picture, seen_pieces, False, BLACK, width + 2, cv2.LINE_AA)
    cv2.polylines(picture, seen_pieces, False, shown.colour, width, cv2.LINE_AA)


def silhouettes(pose: RenderedPose) -> list[Line]:
    """Closed lines along the border pixels of a pose, holes included, in the picture's pixels."""
    lines, _ = cv2.findContours(pose.hit.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    return [line + np.array([pose.left, pose.top], np.int32) for line in lines]


def runs(line: Line, flag: Bool[np.ndarray, "points"]) -> list[tuple[Line, bool]]:
    """Pieces of a closed line in which the flag does not change, each with its flag."""
    change = np.flatnonzero(flag != np.roll(flag, 1))
    start = int(change[0]) if len(change) else 0
    line, flag = np.roll(line, -start, axis=0), np.roll(flag, -start)
    cuts = [0, *(np.flatnonzero(np.diff(flag)) + 1).tolist(), len(line)]
    closed = np.concatenate([line, line[:1]])
    return [(closed[a : b + 1], bool(flag[a])) for a, b in pairwise(cuts)]


def dashes(line: Line) -> list[Line]:
    """Every other piece of a closed line."""
    return [line[k : k + DASH] for k in range(0, len(line), 2 * DASH)]


def face_borders(face: Int[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Pixels whose right or lower neighbour shows another face."""
    change = np.zeros(face.shape, bool)
    change[:, :-1] |= face[:, 1:] != face[:, :-1]
    change[:-1] |= face[1:] != face[:-1]
    return change


def residual_picture(background: Picture, codes: Codes) -> Picture:
    """Agreeing, contradicting and hidden pixels in their colours on a dim background."""
    picture = background.astype(float) * 0.55
    for code, colour in CODE_COLOURS:
        mask = codes == code
        # some of the image stays, so that one sees what disagrees
        picture[mask] = 0.72 * np.array(colour) + 0.28 * background[mask]
    return np.clip(picture, 0, 255).astype(np.uint8)


def pose_picture(background: Picture, pose: RenderedPose, codes: Codes, colour: Rgb) -> Picture:
    """One pose alone, from its rendering at scale 1: contour on the image, beside its residuals."""
    rows, columns = (slice(max(0, s.start - CROP_MARGIN), s.stop + CROP_MARGIN) for s in pose.window)
    everywhere = np.zeros(background.shape[:2], np.uint8)
    everywhere[pose.window] = codes
    crop = background[rows, columns]
    scale = max(1.0, CROP_HEIGHT / crop.shape[0])
    contour = scaled(crop, scale)
    corner = np.array([columns.start, rows.start])
    lines = [np.round((line - corner + 0.5) * scale - 0.5).astype(np.int32) for line in silhouettes(pose)]
    cv2.polylines(contour, lines, True, BLACK, 4, cv2.LINE_AA)
    cv2.polylines(contour, lines, True, colour, 2, cv2.LINE_AA)
    residual = scaled(residual_picture(crop, everywhere[rows, columns]), scale)
    gap = np.full((contour.shape[0], 6, 3), 128, np.uint8)
    return np.concatenate([contour, gap, residual], axis=1)


def magnification(width: int, target: int) -> float:
    """So that a picture of this width [px] becomes about `target` wide: 1, 2, 3.. times, or smaller."""
    return float(round(target / width)) if width < target else target / width
