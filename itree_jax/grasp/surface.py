"""The faces of a part that a gripper can hold: planes, and cylinders seen from outside, as points spread over them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from itree_cad.part import Part
from itree_cad.surfaces import fit_curved
from jaxtyping import Bool, Float
from scipy.spatial import KDTree

SPACING = 1.0  # [mm] between the points on a face: a tenth of a finger's width
ON_SURFACE = 2e-3  # of the diameter: by so much a tessellation's corners may leave the cylinder they stand for
FLAT = 1e-4  # of the diameter, that the corners of a plane may leave it


@dataclass(frozen=True)
class HoldableFace:
    """One component face."""

    face: int
    kind: str  # "plane" or "cylinder"
    points: Float[np.ndarray, "points 3"]  # spread over the face, `SPACING` apart or less [mm]
    tree: KDTree
    normal: Float[np.ndarray, "3"]  # of a plane, outward
    axis: Float[np.ndarray, "3"]  # of a cylinder, unit
    centre: Float[np.ndarray, "3"]  # on the plane, or on the cylinder's axis [mm]
    radius: float  # of a cylinder [mm]

    def has(self, X_obj: Float[np.ndarray, "*n 3"]) -> Bool[np.ndarray, "*n"]:
        """Whether points lie on the face, to `SPACING`."""
        return np.asarray(self.tree.query(X_obj)[0] <= SPACING)


def holdable_faces(part: Part) -> tuple[HoldableFace, ...]:
    """Planes and outer cylinders of a part; a hole's wall can't be held from outside, other surfaces not surely."""
    return tuple(
        found for face, kind in enumerate(part.face_types)
        if (found := _plane(part, face) if kind == "plane" else _cylinder(part, face) if kind == "cylinder" else None)
    )


def spread(corners: Float[np.ndarray, "triangles 3 3"], spacing: float = SPACING) -> Float[np.ndarray, "points 3"]:
    """Points on triangles, at most `spacing` [mm] apart, corners and edges included."""
    return np.concatenate([_on_triangle(corner, spacing) for corner in corners])


def _on_triangle(corner: Float[np.ndarray, "3 3"], spacing: float) -> Float[np.ndarray, "points 3"]:
    """Rows parallel to the shortest edge: a cylinder's facets are long and thin."""
    lengths = np.linalg.norm(corner - np.roll(corner, -1, axis=0), axis=1)
    a, b, c = np.roll(corner, -int(np.argmin(lengths)), axis=0)
    rows = int(np.ceil(max(np.linalg.norm(c - a), np.linalg.norm(c - b)) / spacing)) + 1
    along = np.linspace(0.0, 1.0, rows)
    columns = [np.linspace(0.0, 1.0, int(np.ceil((1 - s) * lengths.min() / spacing)) + 1) for s in along]
    return np.concatenate([
        (1 - s) * (a + t[:, None] * (b - a)) + s * c for s, t in zip(along.tolist(), columns, strict=True)
    ])


def _triangles(part: Part, face: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corners, outward unit normals and areas of a face's triangles; slivers of no area are left out."""
    corners = part.vertices[part.triangles[part.face_of_triangle == face]]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice = np.linalg.norm(across, axis=1)
    keep = twice > 1e-9 * part.diameter**2
    return corners[keep], across[keep] / twice[keep, None], 0.5 * twice[keep]


def _plane(part: Part, face: int) -> HoldableFace | None:
    corners, normals, areas = _triangles(part, face)
    if not len(corners):
        return None
    total = areas @ normals
    normal = total / np.linalg.norm(total)
    centre = areas @ corners.mean(axis=1) / areas.sum()
    if np.abs((corners - centre) @ normal).max() > FLAT * part.diameter:
        return None
    points = spread(corners)
    return HoldableFace(face, "plane", points, KDTree(points), normal, normal, centre, 0.0)


def _cylinder(part: Part, face: int) -> HoldableFace | None:
    corners, normals, areas = _triangles(part, face)
    if len(corners) < 3:
        return None
    fitted = fit_curved("cylinder", np.unique(corners.reshape(-1, 3), axis=0), corners.mean(axis=1), normals, areas,
                        ON_SURFACE * part.diameter, part.diameter)  # fmt: skip
    if fitted is None or not _faces_outward(fitted.normal(corners.mean(axis=1)), normals, areas):
        return None
    points = spread(corners)
    axis = fitted.axis
    middle = fitted.point + ((points - fitted.point) @ axis).mean() * axis
    return HoldableFace(face, "cylinder", points, KDTree(points), np.zeros(3), axis, middle, fitted.size_a)


def _faces_outward(radial: np.ndarray, normals: np.ndarray, areas: np.ndarray) -> bool:
    return bool(areas @ (radial * normals).sum(axis=1) > 0)


def thinned(points: Float[np.ndarray, "points 3"], spacing: float) -> Float[np.ndarray, "kept 3"]:
    """Some of the points, one in each cube of a grid [mm]: that nearest to the mean of its cube's points."""
    if not len(points):
        return points
    cell = np.floor((points - points.min(axis=0)) / spacing + 0.5).astype(int)
    _, label = np.unique(cell, axis=0, return_inverse=True)
    label = label.ravel()
    weight = np.bincount(label)
    mean = np.stack([np.bincount(label, points[:, k]) for k in range(3)], axis=-1) / weight[:, None]
    order = np.lexsort((np.linalg.norm(points - mean[label], axis=1), label))
    _, first = np.unique(label[order], return_index=True)
    return points[order[first]]


def faces_of_kind(faces: Sequence[HoldableFace], kind: str) -> list[HoldableFace]:
    return [face for face in faces if face.kind == kind]
