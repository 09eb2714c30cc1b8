"""A magnified piece of a picture that is drawn on in the image's own coordinates."""

from collections.abc import Sequence
from itertools import pairwise

import cv2
import numpy as np
from jaxtyping import Bool, Float

from itree_jax.report.palette import BLACK, WHITE, Rgb
from itree_jax.report.scene_pictures import SUBPIXEL_BITS, Picture, badge, scaled, scaled_uv, subpixel

WIDTH = 760  # [px] of a picture, which a page shows at about 600
DASH = 9.0  # [px]
FONT = 0.55


class Canvas:
    """Pixel (u, v) of the image is drawn at ((u - left + 0.5) scale - 0.5, ...)."""

    def __init__(self, image: Picture, box: tuple[int, int, int, int], width: int = WIDTH) -> None:
        """`box`: left, top, right, bottom [px], which the image is cut to."""
        left, top, right, bottom = box
        self.corner = np.array([left, top], float)
        self.scale = width / (right - left)
        self.picture = scaled(image[top:bottom, left:right], self.scale)

    def place(self, uv: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        return scaled_uv(np.asarray(uv, float) - self.corner, self.scale)

    def line(
        self, uv: Float[np.ndarray, "n 2"], colour: Rgb, width: int = 2, dashed: bool = False, rim: bool = True
    ) -> None:
        """A line through image points, with a thin dark rim."""
        pieces = _dashes(self.place(uv)) if dashed else [self.place(uv)]
        fixed = [np.array([subpixel(p) for p in piece], np.int32) for piece in pieces]
        for ink, w in ((BLACK, width + 2), (colour, width))[0 if rim else 1 :]:
            cv2.polylines(self.picture, fixed, False, ink, w, cv2.LINE_AA, SUBPIXEL_BITS)

    def outline(
        self, uv: Float[np.ndarray, "n 2"], colour: Rgb, width: int = 2, dashed: bool = False, rim: bool = True
    ) -> None:
        """A closed line."""
        self.line(np.concatenate([uv, uv[:1]]), colour, width, dashed, rim)

    def fill(self, polygons: Sequence[Float[np.ndarray, "n 2"]], colours: Sequence[Rgb], strength: float) -> None:
        """Polygons over the picture, which shines through."""
        painted = self.picture.copy()
        for polygon, colour in zip(polygons, colours, strict=True):
            points = np.array([subpixel(p) for p in self.place(polygon)], np.int32)
            cv2.fillPoly(painted, [points], colour, cv2.LINE_8, SUBPIXEL_BITS)
        cv2.addWeighted(painted, strength, self.picture, 1.0 - strength, 0, dst=self.picture)

    def stroke(self, uv: Float[np.ndarray, "2 2"], colour: Rgb, width: int = 2) -> None:
        """A short line without a rim."""
        a, b = (subpixel(p) for p in self.place(uv))
        cv2.line(self.picture, a, b, colour, width, cv2.LINE_AA, SUBPIXEL_BITS)

    def dot(self, uv: Float[np.ndarray, "2"], colour: Rgb = WHITE, radius: float = 5.0) -> None:
        at = subpixel(self.place(uv))
        for ink, r in ((BLACK, radius + 1.5), (colour, radius)):
            cv2.circle(self.picture, at, round(r * 2**SUBPIXEL_BITS), ink, -1, cv2.LINE_AA, SUBPIXEL_BITS)

    def label(self, uv: Float[np.ndarray, "2"], words: str, colour: Rgb) -> None:
        badge(self.picture, self.place(uv), words, colour, FONT)

    def arrow(self, tail: Float[np.ndarray, "2"], tip: Float[np.ndarray, "2"], colour: Rgb, width: int) -> None:
        a, b = (tuple(int(x) for x in np.round(self.place(p))) for p in (tail, tip))
        for ink, w in ((BLACK, width + 4), (colour, width)):
            cv2.arrowedLine(self.picture, a, b, ink, w, cv2.LINE_AA, tipLength=0.3)


def dimmed(image: Picture, mask: Bool[np.ndarray, "h w"]) -> Picture:
    """The picture at less contrast outside of a mask."""
    return np.where(mask[..., None], image, (0.5 * image).astype(np.uint8))


def box_around(
    mask: Bool[np.ndarray, "h w"], margin: float = 0.25, aspect: float = 1.25
) -> tuple[int, int, int, int]:
    """Left, top, right, bottom of a window of this aspect around a mask, moved inside of the image."""
    v, u = np.nonzero(mask)
    height, width = mask.shape
    middle = np.array([u.min() + u.max() + 1, v.min() + v.max() + 1]) / 2.0
    tall = max(np.ptp(v) + 1, (np.ptp(u) + 1) / aspect) * (1.0 + 2.0 * margin)
    size = np.minimum(np.array([aspect * tall, tall]), [width, height])
    low = np.clip(middle - size / 2.0, 0, np.array([width, height]) - size)
    (left, top), (right, bottom) = low.astype(int).tolist(), (low + size).astype(int).tolist()
    return left, top, right, bottom


def _dashes(points: Float[np.ndarray, "n 2"]) -> list[Float[np.ndarray, "2 2"]]:
    """Short pieces along a line, with gaps of the same length between them."""
    pieces = []
    for a, b in pairwise(points):
        count = max(1, round(float(np.linalg.norm(b - a)) / (2.0 * DASH)))
        at = np.linspace(0.0, 1.0, 2 * count + 1)[:-1].reshape(-1, 2)
        pieces += [a + t[:, None] * (b - a) for t in at]
    return pieces
