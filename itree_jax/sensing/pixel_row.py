"""Maps of any size as one row of pixels, of few lengths: what is compiled for single pixels is compiled for few."""

import numpy as np
from jaxtyping import Shaped

from itree_jax.batches import few_sizes_above

STEP = 4096  # pixels: lengths are four to seven times a power of two of these


def as_row(maps: Shaped[np.ndarray, "*maps height width"]) -> Shaped[np.ndarray, "*maps 1 pixels"]:
    """Row after row, filled up with zeros."""
    *before, height, width = maps.shape
    row = np.zeros((*before, 1, few_sizes_above(height * width, STEP)), maps.dtype)
    row[..., 0, : height * width] = maps.reshape(*before, height * width)
    return row


def as_map(
    row: Shaped[np.ndarray, "*maps 1 pixels"], height: int, width: int
) -> Shaped[np.ndarray, "*maps height width"]:
    """The same pixels as a map of this size."""
    return row[..., 0, : height * width].reshape(*row.shape[:-2], height, width)
