"""Maps of any size as one row of pixels, of few lengths: what is compiled for single pixels is compiled for few."""

import numpy as np
from jaxtyping import Shaped


def as_row(maps: Shaped[np.ndarray, "*maps height width"], pixels: int) -> Shaped[np.ndarray, "*maps 1 pixels"]:
    """Row after row, filled up with zeros to so many `pixels`."""
    *before, height, width = maps.shape
    row = np.zeros((*before, 1, pixels), maps.dtype)
    row[..., 0, : height * width] = maps.reshape(*before, height * width)
    return row


def as_map(
    row: Shaped[np.ndarray, "*maps 1 pixels"], height: int, width: int
) -> Shaped[np.ndarray, "*maps height width"]:
    """The same pixels as a map of this size."""
    return row[..., 0, : height * width].reshape(*row.shape[:-2], height, width)
