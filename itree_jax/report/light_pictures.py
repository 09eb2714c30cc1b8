"""One picture that shows whether a light calibration fits: a tile for each light, with what was fitted drawn in.

Mirror sphere: the photograph with the outline, the highlight (ring) and the light's direction (line from the highlight,
as the camera would see it). Matte sphere: photograph with the outline, the shading that the light predicts, and what is
left of it (orange: brighter than predicted, blue: darker; full colour at `FULL_RESIDUAL`).
"""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float

from itree_jax.report.palette import BLACK, ORANGE, SKY, VERMILLION, WHITE, YELLOW
from itree_jax.report.scene_pictures import (
    NOTHING,
    SUBPIXEL_BITS,
    Picture,
    displayed,
    scaled,
    scaled_uv,
    subpixel,
)
from itree_jax.sensing.light_calibration.calibrate import Calibration, SphereImages
from itree_jax.sensing.light_calibration.matte import lit_by

TILE = 240  # [px] side
MARGIN = 0.12  # of the sphere's size, around it
CAPTION = 18  # [px]
WIDTH = 6  # tiles in a row
FULL_RESIDUAL = 0.15  # of the light's strength: three times what an ordinary painted ball leaves


def calibration_picture(
    places: Sequence[SphereImages], calibration: Calibration, matte: SphereImages | None = None
) -> Picture:
    """All lights at all places of the sphere; of a mirror sphere also the matte sphere that gave the intensities."""
    tiles = []
    for place_index, place in enumerate(places):
        for light in range(len(place.images)):
            title = f"light {light}" if len(places) == 1 else f"place {place_index} light {light}"
            if calibration.highlights is None:
                tiles += _matte_tiles(place, light, calibration, title)
            else:
                highlights = calibration.highlights[place_index]
                tiles.append(_chrome_tile(place, light, calibration, highlights.uv[light], title))
    for light in range(len(matte.images) if matte else 0):
        tiles += _matte_tiles(matte, light, calibration, f"light {light}") if matte else []
    return _sheet(tiles)


class _Tile:
    """The sphere's part of an image, magnified, to be drawn on in image points."""

    def __init__(self, picture: Picture, place: SphereImages) -> None:
        outline = place.sphere.outline()
        centre, half = (outline.min(0) + outline.max(0)) / 2, (0.5 + MARGIN) * np.ptp(outline, axis=0).max()
        low = np.floor(centre - half).astype(int)
        size = int(np.ceil(2 * half)) + 1
        window = np.zeros((size, size, 3), np.uint8)  # black beyond the image
        height, width = picture.shape[:2]
        a, b = np.maximum(low, 0), np.minimum(low + size, [width, height])
        window[a[1] - low[1] : b[1] - low[1], a[0] - low[0] : b[0] - low[0]] = picture[a[1] : b[1], a[0] : b[0]]
        self.low, self.scale = low.astype(float), TILE / size
        self.picture = scaled(window, self.scale)

    def points(self, uv: Float[np.ndarray, "n 2"]) -> np.ndarray:
        return np.array([subpixel(p) for p in scaled_uv(uv - self.low, self.scale)], np.int32)

    def closed(self, uv: Float[np.ndarray, "n 2"]) -> None:
        cv2.polylines(self.picture, [self.points(uv)], True, SKY, 1, cv2.LINE_AA, SUBPIXEL_BITS)

    def line(self, uv: Float[np.ndarray, "2 2"]) -> None:
        a, b = (tuple(int(x) for x in p) for p in self.points(uv))
        cv2.line(self.picture, a, b, YELLOW, 1, cv2.LINE_AA, SUBPIXEL_BITS)

    def ring(self, uv: Float[np.ndarray, "2"], radius: float) -> None:
        at = tuple(int(x) for x in self.points(uv[None])[0])
        cv2.circle(
            self.picture, at, round(radius * 2**SUBPIXEL_BITS), VERMILLION, 1, cv2.LINE_AA, SUBPIXEL_BITS
        )

    def captioned(self, words: str) -> Picture:
        strip = np.full((CAPTION, self.picture.shape[1], 3), BLACK, np.uint8)
        cv2.putText(strip, words, (3, CAPTION - 5), cv2.FONT_HERSHEY_SIMPLEX, 0.36, WHITE, 1, cv2.LINE_AA)
        return np.concatenate([self.picture, strip])


def _chrome_tile(
    place: SphereImages, light: int, calibration: Calibration, uv: Float[np.ndarray, "2"], title: str
) -> Picture:
    tile = _Tile(displayed(place.images[light], 1.0), place)
    sphere, toward = place.sphere, _directions_at(place, calibration)[light]
    tile.closed(sphere.outline())
    X_cam, _, _ = sphere.at(uv)
    tip = sphere.camera.project(np.stack([X_cam, X_cam + 0.5 * sphere.radius * toward]))
    tile.line(tip)
    tile.ring(uv, 9.0)
    return tile.captioned(f"{title}: {_xyz(toward)}")


def _matte_tiles(place: SphereImages, light: int, calibration: Calibration, title: str) -> list[Picture]:
    toward = _directions_at(place, calibration)[light]
    seen = lit_by(place.images[light], place.sphere, toward)
    photograph = _Tile(displayed(place.images[light], 1.0), place)
    photograph.closed(place.sphere.outline())
    shading = _Tile(displayed(seen.predicted, 1.0), place)
    shading.closed(place.sphere.outline())
    left = np.clip(seen.residual / seen.strength / FULL_RESIDUAL, -1.0, 1.0)
    left[~seen.used] = 0.0
    strong = np.abs(left)[..., None]
    colour = np.where(left[..., None] > 0, np.array(ORANGE), np.array(SKY)) * strong + NOTHING * (1.0 - strong)
    residual = _Tile(colour.astype(np.uint8), place)
    rms = 100.0 * float(np.sqrt((left[seen.used] ** 2).mean())) * FULL_RESIDUAL
    return [
        photograph.captioned(f"{title}: {_xyz(toward)}"),
        shading.captioned(f"predicted, strength {seen.strength:.3f}"),
        residual.captioned(f"left: rms {rms:.1f} %, full colour {100 * FULL_RESIDUAL:.0f} %"),
    ]


def _directions_at(place: SphereImages, calibration: Calibration) -> Float[np.ndarray, "lights 3"]:
    if calibration.positions is None:
        return calibration.directions
    away = calibration.positions - place.sphere.centre
    return away / np.linalg.norm(away, axis=1, keepdims=True)


def _xyz(direction: Float[np.ndarray, "3"]) -> str:
    return " ".join(f"{x:+.3f}" for x in direction)


def _sheet(tiles: list[Picture]) -> Picture:
    height, width = (max(t.shape[k] for t in tiles) for k in (0, 1))
    blank = np.zeros((height, width, 3), np.uint8)
    padded = [np.pad(t, ((0, height - t.shape[0]), (0, width - t.shape[1]), (0, 0))) for t in tiles]
    padded += [blank] * (-len(tiles) % WIDTH)
    return np.concatenate([np.concatenate(padded[k : k + WIDTH], axis=1) for k in range(0, len(padded), WIDTH)])
