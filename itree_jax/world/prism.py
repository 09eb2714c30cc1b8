"""Prisms with a dodecagon as cross section: what the world model knows of a region that nobody has interpreted yet
(Ikeuchi 1987, sec. 3.2, figure 6d).

The frame of a prism is the upright one: the camera's origin, axes x and y level, z up. `R_cam_up` takes it to the
camera; with a camera pose it is `R_w2c`.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from itree_kernels.camera import Camera
from jaxtyping import Bool, Float

from itree_jax.sensing.regions import HEIGHT_PERCENTILE
from itree_jax.world.dodecagon import dodecagon, polygon_area

NO_REGION_NUMBER = -1  # surface that is seen but belongs to no region: too steep for needles, shadowed, too small
LEAST_FILLED = 0.5  # of a dodecagon: a region that fills less (a ring, an angle) is cut in two
LEAST_SURFACE = 0.2  # of the sensor's smallest region: a part shows more, what silhouettes leave over shows less
MOST_CUTS = 5  # halvings: a bin's rim then is some thirty short pieces


@dataclass(frozen=True)
class Prism:
    """An upright prism over the outline of a region, from `bottom` to `top`."""

    region: int  # number in `Detections.labels`, or NO_REGION_NUMBER
    outline_up: Float[np.ndarray, "12 2"]  # corners, counter-clockwise seen from above, upright frame [mm]
    top: float  # [mm] height in the upright frame: above the camera, so below 0
    bottom: float  # [mm]
    reason: str  # why it is a prism and no part

    @property
    def height(self) -> float:
        return self.top - self.bottom

    @property
    def volume(self) -> float:
        """[mm^3]"""
        return polygon_area(self.outline_up) * self.height


def corners_of_pixels(
    mask: Bool[np.ndarray, "height width"], depth: Float[np.ndarray, "height width"], camera: Camera,
    R_cam_up: Float[np.ndarray, "3 3"],
) -> Float[np.ndarray, "pixels 4 3"]:
    """The four corners of each pixel of a mask, at the pixel's depth [mm], in the upright frame."""
    v, u = np.nonzero(mask)
    offsets = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    uv = np.stack([u, v], axis=-1)[:, None] + offsets
    return camera.unproject(uv, np.broadcast_to(depth[v, u, None], uv.shape[:2]).astype(float)) @ R_cam_up


def prisms_over(
    pixels: Float[np.ndarray, "pixels 4 3"], region: int, bottom: float, reason: str, smallest_region: float
) -> Iterator[Prism]:
    """Prisms that stand for the pixels of one region, given by their corners in the upright frame [mm].

    One prism, as in the paper, when the region fills at least half of its dodecagon; else the region is cut across its
    longer axis, and each half stands for itself, down to `smallest_region` [mm^2]: the rim of a bin would else fill the
    bin. A prism is as tall as the region: the 90th percentile of its height. A speck makes none.
    """
    if np.abs(_areas(pixels)).sum() < LEAST_SURFACE * smallest_region:
        return
    for piece in _compact(pixels, smallest_region, MOST_CUTS):
        top = float(np.percentile(piece[:, 0, 2], HEIGHT_PERCENTILE))
        if top > bottom:
            yield Prism(region, dodecagon(piece[..., :2].reshape(-1, 2)), top, bottom, reason)


def _compact(
    pixels: Float[np.ndarray, "pixels 4 3"], least_area: float, cuts: int
) -> Iterator[Float[np.ndarray, "pixels 4 3"]]:
    if len(pixels) == 0:
        return
    filled = np.abs(_areas(pixels)).sum()
    outline = dodecagon(pixels[..., :2].reshape(-1, 2))
    if cuts == 0 or filled < 2 * least_area or filled >= LEAST_FILLED * polygon_area(outline):
        yield pixels
        return
    middle = pixels[:, :, :2].mean(axis=1)
    _, axes = np.linalg.eigh(np.cov(middle.T))
    along = middle @ axes[:, 1]
    half = along <= np.median(along)
    if half.all():
        yield pixels
        return
    for side in (half, ~half):
        yield from _compact(pixels[side], least_area, cuts - 1)


def _areas(pixels: Float[np.ndarray, "pixels 4 3"]) -> Float[np.ndarray, "pixels"]:
    """Of the pixels seen from above [mm^2]."""
    d1, d2 = (pixels[:, k + 2, :2] - pixels[:, k, :2] for k in (0, 1))
    return 0.5 * (d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0])
