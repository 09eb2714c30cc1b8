"""A region that is larger than any face it could be: parts that lie flush side by side make one region."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.cluster.vq import kmeans2

MOST_PIECES = 4  # more parts in one region are found one after the other, as what is explained is taken out
MOST_PIXELS = 2000  # that pieces are found by
STEPS = 10


def pieces_of(
    mask: Bool[np.ndarray, "height width"], depth: Float[np.ndarray, "height width"] | None, face_pixels: float
) -> Float[np.ndarray, "pieces 3"]:
    """Image point and depth (u, v [px], z [mm]; NaN where no depth tells it) of the middle of every piece.

    As many pieces as faces of `face_pixels` fill the region; one if the region is no larger than a face and a half.
    They start in a row along the region and settle where their pixels are nearest (k-means).
    """
    v, u = np.nonzero(mask)
    uv = np.stack([u, v], axis=-1).astype(float)
    count = int(np.clip(np.round(len(uv) / max(face_pixels, 1.0)), 1, MOST_PIECES))
    piece = np.zeros(len(uv), int)
    if count > 1:
        some = uv[:: max(1, len(uv) // MOST_PIXELS)]
        along = np.linalg.svd(some - some.mean(axis=0), full_matrices=False)[2][0]
        row = np.argsort(some @ along, kind="stable")
        start = np.stack([some[part].mean(axis=0) for part in np.array_split(row, count)])
        centre, _ = kmeans2(some, start, iter=STEPS, minit="matrix", missing="warn")
        piece = np.square(uv[:, None] - centre).sum(axis=-1).argmin(axis=1)
    z = np.full(len(uv), np.nan) if depth is None else np.where(depth[v, u] > 0.0, depth[v, u], np.nan)
    return np.stack([_middle(uv[piece == k], z[piece == k]) for k in np.unique(piece)])


def _middle(uv: Float[np.ndarray, "n 2"], z: Float[np.ndarray, "n"]) -> Float[np.ndarray, "3"]:
    known = np.isfinite(z)
    return np.append(uv.mean(axis=0), np.median(z[known]) if known.any() else np.nan)
