"""Parts that a lathe made and a mill spoilt: all the surface but a flat, a keyway or some holes turns into itself."""

import numpy as np
from itree_cad.part import Part
from jaxtyping import Float
from scipy.spatial.transform import Rotation

FEWEST_NORMALS = 6  # of a curved face
FLAT_CIRCLE = 0.02  # the normals of a cylinder or cone lie on a circle, to this
ON_AXIS = 0.01  # of the diameter: normals meet the axis, to this
ALONG = float(np.cos(np.radians(2.0)))
LEAST_CURVED, LEAST_TURNING = 0.25, 0.6  # of the surface: that curves about the axis; and with the planes across it
Axis = tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]  # unit direction, point on it [mm]


def revolved_axis(part: Part) -> Axis | None:
    """The axis about which most of the part's surface turns into itself, if there is one."""
    corners = np.asarray(part.vertices, float)[np.asarray(part.triangles)]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1) / 2.0
    normal = cross / np.maximum(2.0 * area, 1e-12)[:, None]
    middle = corners.mean(axis=1)
    axes = [axis for face in range(part.face_count) if (axis := _axis_of(part, face, normal, area, middle)) is not None]
    shares = [_shares(axis, part.diameter, normal, area, middle) for axis in axes]
    turning = [curved + across if curved >= LEAST_CURVED else 0.0 for curved, across in shares]
    best = int(np.argmax(turning)) if axes else 0
    return axes[best] if axes and turning[best] >= LEAST_TURNING else None


def turns_about(axis: Axis, angles: Float[np.ndarray, "turns"]) -> Float[np.ndarray, "turns 4 4"]:
    """Turns by these angles [rad], model -> model [mm]."""
    direction, point = axis
    T = np.tile(np.eye(4), (len(angles), 1, 1))
    T[:, :3, :3] = Rotation.from_rotvec(angles[:, None] * direction).as_matrix()
    T[:, :3, 3] = point - T[:, :3, :3] @ point
    return T


def _axis_of(
    part: Part, face: int, normal: Float[np.ndarray, "n 3"], area: Float[np.ndarray, "n"],
    middle: Float[np.ndarray, "n 3"],
) -> Axis | None:
    """Of a face that is part of a cylinder or a cone."""
    mine = (np.asarray(part.face_of_triangle) == face) & (area > 0.0)
    n, c, w = normal[mine], middle[mine], np.sqrt(area[mine] / area[mine].sum())[:, None]
    if len(np.unique(np.round(n, 2), axis=0)) < FEWEST_NORMALS:
        return None
    spread = np.linalg.svd(w * (n - (w**2 * n).sum(axis=0)), full_matrices=False)
    direction = spread[2][2]
    if spread[1][2] > FLAT_CIRCLE:
        return None
    # the line from a point along its normal meets the axis: (point - p) . (direction x normal) = 0
    across = np.cross(direction, n)
    rows = np.concatenate([w * across, direction[None]])
    point = np.linalg.lstsq(rows, np.append(w[:, 0] * (across * c).sum(axis=1), 0.0), rcond=None)[0]
    off = np.abs(((c - point) * across).sum(axis=1))
    return (direction, point) if (w[:, 0] ** 2 * off).sum() < ON_AXIS * part.diameter else None


def _shares(
    axis: Axis, diameter: float, normal: Float[np.ndarray, "n 3"], area: Float[np.ndarray, "n"],
    middle: Float[np.ndarray, "n 3"],
) -> tuple[float, float]:
    """Of the surface: what curves about the axis, and what is a plane across it."""
    direction, point = axis
    across = np.abs(normal @ direction) > ALONG
    arm = middle - point
    off = np.abs((arm * np.cross(direction, normal)).sum(axis=1))
    outward = np.linalg.norm(np.cross(arm, direction), axis=1)
    turning = ~across & (off < ON_AXIS * diameter) & (outward > ON_AXIS * diameter)
    return float(area[turning].sum() / area.sum()), float(area[across].sum() / area.sum())
