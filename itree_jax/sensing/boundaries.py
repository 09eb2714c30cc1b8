"""What the boundary of a region is made of: outline, crease, cast shadow, or needles that end without an edge.

Only outlines and creases are the part's shape. Where a cast shadow, the outline of something in front, the image or the
slant limit ends a region, its surface goes on, so that a distance from the mass centre to there (`features.outline`) is
but the least it can be: in simulated bins the face goes on beyond nine of ten shadows, and one of seven creases.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int
from scipy.spatial import KDTree

from itree_jax.sensing.connected import NO_REGION
from itree_jax.sensing.edges import SceneEdges
from itree_jax.sensing.regions import Regions
from itree_jax.sensor import Sensor

NO_EDGE = -1
# [px] from a boundary pixel's centre to its edge: pixels that mix both sides, one to each side of an edge after the
# optics, are uninterpretable, and the boundary's own half width comes on top.
REACH = 2.5


class BoundaryLabel(IntEnum):
    """The first five are those of `EdgeLabel`."""

    UNKNOWN = 0
    OUTLINE = 1
    CREASE = 2
    SHADOW = 3
    GEOMETRIC = 4  # outline or crease
    RIM = 5  # of the image or of the region of interest
    FADED = 6  # no edge: a curved surface turns away, or its needles end
    HIDDEN = 7  # the outline of what lies in front; known where there is a depth map


IS_SHAPE = (BoundaryLabel.OUTLINE, BoundaryLabel.CREASE, BoundaryLabel.GEOMETRIC)


class Boundary(NamedTuple):
    """The boundary pixels of all regions: those of a region with a pixel of another one, or of none, beside them."""

    pixel: Int[np.ndarray, "pixels 2"]  # row, column; in the order of the image
    region: Int[np.ndarray, "pixels"]
    label: Int[np.ndarray, "pixels"]  # `BoundaryLabel`, int8
    edge: Int[np.ndarray, "pixels"]  # the edge point that it ends at, for its place to a part of a pixel; or NO_EDGE

    @property
    def is_shape(self) -> Bool[np.ndarray, "pixels"]:
        """Whether the part ends there or its face does."""
        return np.isin(self.label, IS_SHAPE)

    def of(self, region: int) -> "Boundary":
        return Boundary(*(a[self.region == region] for a in self))


def boundary_labels(found: Regions, edges: SceneEdges, sensor: Sensor) -> Boundary:
    """The boundary of every region, pixel by pixel, with the label of the nearest edge point. Host code.

    Args:
        found: of `regions`.
        edges: of the same image.
        sensor: its region of interest ends regions too.
    """
    labels = found.labels
    rows, columns = np.nonzero(_at_boundary(labels))
    label = np.full(len(rows), BoundaryLabel.FADED, np.int8)
    edge = np.full(len(rows), NO_EDGE)
    if len(rows) and len(edges.uv):
        distance, nearest = map(np.asarray, KDTree(edges.uv).query(np.stack([columns, rows], axis=-1)))
        close = distance <= REACH
        edge[close] = nearest[close]
        label[close] = edges.label[nearest[close]]
        aside = np.stack([columns, rows], axis=-1) - edges.uv[nearest]
        behind = (aside * edges.direction[nearest]).sum(axis=-1) > 0.0
        oriented = np.isfinite(found.mean_depth)[labels[rows, columns]]  # else outlines point to the darker side
        label[(label == BoundaryLabel.OUTLINE) & behind & oriented] = BoundaryLabel.HIDDEN
    label[_beside_nothing(labels.shape, sensor)[rows, columns]] = BoundaryLabel.RIM
    return Boundary(np.stack([rows, columns], axis=-1), labels[rows, columns], label, edge)


def _at_boundary(labels: Int[np.ndarray, "height width"]) -> Bool[np.ndarray, "height width"]:
    """Pixels of a region with one of their four neighbours outside of it or of the image."""
    framed = np.pad(labels, 1, constant_values=NO_REGION)
    beside = (framed[:-2, 1:-1], framed[2:, 1:-1], framed[1:-1, :-2], framed[1:-1, 2:])
    return (labels != NO_REGION) & np.any([labels != other for other in beside], axis=0)


def _beside_nothing(shape: tuple[int, ...], sensor: Sensor) -> Bool[np.ndarray, "height width"]:
    """Pixels that touch the outside of the image or of the region of interest."""
    interest = np.ones(shape, bool) if sensor.region_of_interest is None else sensor.region_of_interest
    framed = np.pad(interest, 1)
    beside = (framed[:-2, 1:-1], framed[2:, 1:-1], framed[1:-1, :-2], framed[1:-1, 2:])
    return ~np.all(beside, axis=0)
