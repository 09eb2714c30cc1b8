"""The dodecagon that stands for a region's outline in the world model (Ikeuchi 1987, sec. 3.2)."""

import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError

SIDES = 12
TURNS = 15  # tried within the 30 degrees after which twelve directions repeat: 2 degrees change an area by 0.1 %


def dodecagon(points: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "12 2"]:
    """Corners, counter-clockwise, of the smallest dodecagon with equal angles that holds the points [mm].

    Its sides are the support lines of the points in twelve directions 30 degrees apart, turned together to where they
    enclose the least area. A side may have no length: a square's does. The paper says that the dodecagon approximates
    the region; it holds it here, since what it stands for is an obstacle.

    Raises ItreeError when there is no point.
    """
    if len(points) == 0:
        raise ItreeError("a dodecagon needs at least one point of a region's outline; the region has none")
    hull = hull_points(np.asarray(points, float))
    turns = np.arange(TURNS) / TURNS * (2 * np.pi / SIDES)
    candidates = [around(hull, float(turn)) for turn in turns]
    return min(candidates, key=polygon_area)


def around(points: Float[np.ndarray, "points 2"], turn: float) -> Float[np.ndarray, "12 2"]:
    """The dodecagon of the support lines whose first outward direction is at angle `turn` [rad]."""
    angle = turn + np.arange(SIDES) * (2 * np.pi / SIDES)
    outward = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    support = (points @ outward.T).max(axis=0)
    nxt, after = np.roll(outward, -1, axis=0), np.roll(support, -1)
    # the corner where support lines k and k + 1 meet; their directions' determinant is sin 30 degrees
    x = support * nxt[:, 1] - after * outward[:, 1]
    y = after * outward[:, 0] - support * nxt[:, 0]
    return np.stack([x, y], axis=-1) / np.sin(2 * np.pi / SIDES)


def polygon_area(corners: Float[np.ndarray, "corners 2"]) -> float:
    """Area [mm^2], positive counter-clockwise."""
    x, y = np.moveaxis(corners - corners[0], -1, 0)
    return float(0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum())


def hull_points(points: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "hull 2"]:
    """Corners of the convex hull; the points themselves when they lie on a line."""
    try:
        return points[ConvexHull(points).vertices]
    except (QhullError, ValueError):
        return points
