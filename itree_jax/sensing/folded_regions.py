"""Regions that reach farther than any part are of several: they are cut where the surface folds.

Where parts touch no step of depth lies between them, and their faces make one region whose mean normal is neither's. A
part's own edges fold likewise, and a region may go on across them (Ikeuchi 1987, sec. 4.2): only what is longer than
any part is surely more than one.
"""

import numpy as np
from jaxtyping import Bool, Float

from itree_jax.sensing.regions import Regions, added
from itree_jax.sensing.segments import extents, faces_of_segments
from itree_jax.sensor import Sensor

LONGER = 0.05  # than a part: a depth map's noise at both ends of it, and of a pixel
ONE_PIECE = 0.9  # of a region's pixels


def parted_at_folds(
    found: Regions, normals: Float[np.ndarray, "height width 3"], depth: Float[np.ndarray, "height width"],
    sensor: Sensor, longest: float, R_w2c: Float[np.ndarray, "3 3"] | None = None,
) -> Regions:
    """The regions, of which those that reach farther than `longest` [mm], the diameter of the largest part, are cut.

    `normals` tell of folds, `depth` z [mm] (0 = none) how far a region reaches.
    """
    folded = too_long(found, depth, sensor, (1.0 + LONGER) * longest)
    if not folded.any():
        return found
    inside = found.labels >= 0
    inside[inside] = folded[found.labels[inside]]
    faces = faces_of_segments(np.where(inside, found.labels + 1, 0), normals)
    largest = np.zeros(found.count, int)
    pixels = np.bincount(faces[inside], minlength=2)
    there = inside & (faces > 0)
    np.maximum.at(largest, found.labels[there], pixels[faces[there]])
    folded &= largest < ONE_PIECE * found.area_px
    if not folded.any():
        return found
    inside[inside] = folded[found.labels[inside]]
    parted = added(
        found.take(np.flatnonzero(~folded)), np.where(inside, faces, 0), normals, depth, sensor, R_w2c
    )
    return parted.take(np.argsort(-np.nan_to_num(parted.height, nan=-np.inf), kind="stable"))


def too_long(
    found: Regions, depth: Float[np.ndarray, "height width"], sensor: Sensor, longest: float
) -> Bool[np.ndarray, "regions"]:
    """Regions that surely reach farther than this [mm]."""
    v, u = np.nonzero((found.labels >= 0) & (depth > 0.0))
    X_cam = sensor.camera.unproject(np.stack([u, v], axis=-1).astype(float), depth[v, u].astype(float))
    return extents(X_cam, found.labels[v, u], found.count) > longest
