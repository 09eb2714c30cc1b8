"""The part of an image that holds what a light shows: there parts are looked for, and nowhere else."""

from typing import Any, NamedTuple

import numpy as np
from itree_kernels.camera import Camera
from jaxtyping import Bool, Int, Shaped


class Box(NamedTuple):
    """A part of an image [px]: rows top .. bottom - 1, columns left .. right - 1."""

    top: int
    bottom: int
    left: int
    right: int

    @property
    def pixels(self) -> int:
        """How many it has."""
        return (self.bottom - self.top) * (self.right - self.left)

    def of(self, maps: Shaped[np.ndarray, "*maps height width"]) -> Shaped[np.ndarray, "*maps rows columns"]:
        """This part of maps."""
        return np.ascontiguousarray(maps[..., self.top : self.bottom, self.left : self.right])

    def seen_by(self, camera: Camera) -> Camera:
        """The camera that sees this part alone."""
        return camera.cropped(self.left, self.top, self.right - self.left, self.bottom - self.top)


def box_of(shown: Bool[np.ndarray, "height width"], around: int, step: int = 1) -> Box:
    """The part of an image that holds all that is shown and what lies `around` it [px], its sides multiples of `step`
    [px] or the image's own; all of it where nothing is shown.
    """

    def span(there: Int[np.ndarray, "n"], size: int) -> tuple[int, int]:
        if not len(there):
            return 0, size
        first, last = max(int(there[0]) - around, 0), min(int(there[-1]) + 1 + around, size)
        length = min(-(-(last - first) // step) * step, size)
        first = min(first, size - length)
        return first, first + length

    rows, columns = (span(np.flatnonzero(shown.any(axis=1 - k)), size) for k, size in enumerate(shown.shape))
    return Box(*rows, *columns)


def in_image(
    values: Shaped[np.ndarray, "rows columns"], box: Box, camera: Camera, elsewhere: Any = 0.0
) -> Shaped[np.ndarray, "height width"]:
    """What is known of a part of an image, and around it what is so `elsewhere`."""
    whole = np.full((camera.height, camera.width), elsewhere, values.dtype)
    whole[box.top : box.bottom, box.left : box.right] = values
    return whole
