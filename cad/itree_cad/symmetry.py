"""Rotations that carry a part into itself, found from its CAD model."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from itree_cad.assemble import shared_edges, signed_volume, triangle_areas
from itree_cad.part import Part
from itree_cad.surface_distance import SurfaceDistance, surface_sample

ORDERS = tuple(range(12, 1, -1))
TOLERANCE = 2e-3  # of the diameter: a smaller deviation is nothing that an image could show
PROBES = 24  # points that a rotation must carry onto the part before all are asked
SAMPLES = 1500  # points spread over the surface, and at most twice as many vertices, that are asked
GENERIC_ANGLES = (2.0 * np.pi * 0.381966, 1.0)  # [rad]: no fraction of a turn, so only a part of revolution passes
SAME_AXIS = np.radians(0.2)
DIRECTIONS = 12  # faces, largest first, whose directions are tried where the moments of inertia leave axes open
LARGEST_GROUP = 60  # the rotations of the icosahedron


@dataclass(frozen=True)
class Symmetries:
    """Symmetries in BOP's convention, model -> model. Mirrors do not count: no motion of the part does what they do."""

    discrete: Float[np.ndarray, "k 4 4"]  # rotation and translation [mm]; the identity first
    continuous: tuple[tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]], ...]  # unit axis, point on it [mm]

    def about(self, origin: Float[np.ndarray, "3"]) -> "Symmetries":
        """The same in a frame whose origin is this point [mm]; axes are told by their points nearest to it."""
        discrete = np.array(self.discrete, float)
        discrete[:, :3, 3] += discrete[:, :3, :3] @ origin - origin
        across = ((axis, np.asarray(point) - origin) for axis, point in self.continuous)
        return Symmetries(discrete, tuple((axis, point - (point @ axis) * axis) for axis, point in across))


def symmetries(part: Part, tolerance: float = TOLERANCE) -> Symmetries:
    """All rotations that carry the part's surface into itself, to `tolerance` of its diameter (plus the sagitta of its
    tessellation).

    A part of revolution has its axis in `continuous`, and in `discrete` what remains: the identity, and the flip end
    over end where there is one. A sphere has three axes. Orders up to 12 are looked for.
    """
    search = _Search(part, tolerance)
    axes = search.candidate_axes()
    round_axes = [axis for axis in axes if all(search.holds(rotation(axis, angle)) for angle in GENERIC_ANGLES)]
    if len(round_axes) > 1:  # two axes of revolution generate every rotation
        return _packed([], np.eye(3), search.centre)
    if round_axes:
        across = np.cross(round_axes[0], np.eye(3)[np.argmin(np.abs(round_axes[0]))])
        flip = rotation(across / np.linalg.norm(across), np.pi)
        return _packed([flip] if search.holds(flip) else [], np.stack(round_axes), search.centre)
    generators = []
    for axis in axes:
        turns = (
            rotation(axis, 2.0 * np.pi / order) for order in ORDERS
        )  # the largest order has the smaller ones in it
        generators += [next((turn for turn in turns if search.holds(turn)), np.eye(3))]
    return _packed(_generated(generators), np.zeros((0, 3)), search.centre)


def rotation(axis: Float[np.ndarray, "3"], angle: float) -> Float[np.ndarray, "3 3"]:
    """Rotation about a unit axis by an angle [rad] (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)


class _Search:
    """One part about its centre of mass, and the test of a rotation. Every axis passes through the centre."""

    def __init__(self, part: Part, tolerance: float):
        self.centre, self.moments = _mass_properties(part)
        self.part = part
        self.relative = tolerance
        self.tolerance = tolerance * part.diameter + _sagitta(part)
        vertices = part.vertices - self.centre
        self.surface = SurfaceDistance(vertices, part.triangles)
        sample = surface_sample(vertices, part.triangles, SAMPLES, seed=0)
        far = np.argsort(-np.linalg.norm(vertices, axis=1), kind="stable")[: PROBES // 2]
        self.probes = np.concatenate([vertices[far], sample[:: 2 * SAMPLES // PROBES]])
        self.points = np.concatenate([vertices[:: 1 + len(vertices) // (2 * SAMPLES)], sample])

    def holds(self, R: Float[np.ndarray, "3 3"]) -> bool:
        """Whether the rotated part lies on the part."""
        return self.surface.all_within(self.probes @ R.T, self.tolerance) and self.surface.all_within(
            self.points @ R.T, self.tolerance
        )

    def candidate_axes(self) -> list[np.ndarray]:
        """Unit axes that can be axes of symmetry.

        Where the three second moments differ, only their own axes can be. Where two or three agree, the axes in that
        plane or space are fixed by the faces: by their normals, by the axes of curved faces, by the direction of their
        centroids, and by the bisectors of any two of these.
        """
        values, frame = np.linalg.eigh(self.moments)
        # a deviation of the surface by the tolerance moves a moment by some four times its share of the diameter
        low, high = np.diff(values) < 4.0 * self.relative * values[2]
        if not low and not high:
            return _distinct(frame.T)
        directions = np.stack(_distinct(self._face_directions()))
        bisectors = (directions[:, None] + np.concatenate([directions, -directions])[None]).reshape(-1, 3)
        axes = np.stack(_distinct(np.concatenate([frame.T, directions, bisectors])))
        if not (low and high):
            along = np.abs(axes @ frame[:, 2 if low else 0])
            axes = axes[(along > np.cos(np.radians(1.0))) | (along < np.sin(np.radians(1.0)))]
        return list(axes)

    def _face_directions(self) -> np.ndarray:
        part = self.part
        areas = triangle_areas(part.vertices, part.triangles)
        corners = (part.vertices - self.centre)[part.triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        found = []
        for face in range(min(DIRECTIONS, part.face_count)):
            mine = part.face_of_triangle == face
            spread = np.linalg.eigh((normals[mine] * areas[mine, None]).T @ normals[mine])[1]
            found.append(spread[:, 2] if part.face_types[face] == "plane" else spread[:, 0])
            found.append(areas[mine] @ corners[mine].mean(axis=1) / areas[mine].sum())
        return np.array(found)


def _mass_properties(part: Part) -> tuple[np.ndarray, np.ndarray]:
    """Centre of mass [mm] and second moments about it, normalised; of the volume, or of the surface when it is open."""
    origin = part.vertices.mean(axis=0)
    corners = part.vertices[part.triangles] - origin
    solid = part.watertight and signed_volume(part.vertices, part.triangles) > 0.0
    weight = np.linalg.det(corners) if solid else triangle_areas(part.vertices, part.triangles)
    # a tetrahedron from the origin has its centre at sum / 4, a triangle at sum / 3
    total = corners.sum(axis=1)
    centre = weight @ total / ((4.0 if solid else 3.0) * weight.sum())
    products = np.einsum("n,ni,nj->ij", weight, total, total) + np.einsum("n,nki,nkj->ij", weight, corners, corners)
    moments = products / ((20.0 if solid else 12.0) * weight.sum()) - np.outer(centre, centre)
    return origin + centre, moments


def _sagitta(part: Part) -> float:
    """How far the facets of curved faces are from the surface that they stand for [mm]."""
    pairs, edges = shared_edges(part.triangles)
    curved = np.array([kind != "plane" for kind in part.face_types])[part.face_of_triangle]
    mine = (part.face_of_triangle[pairs[:, 0]] == part.face_of_triangle[pairs[:, 1]]) & curved[pairs[:, 0]]
    pairs, edges = pairs[mine], edges[mine]
    corners = part.vertices[part.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(double, 1e-300)[:, None]
    bend = np.arccos(np.clip((normals[pairs[:, 0]] * normals[pairs[:, 1]]).sum(axis=1), -1.0, 1.0))
    length = np.linalg.norm(part.vertices[edges[:, 0]] - part.vertices[edges[:, 1]], axis=1)
    width = double[pairs].max(axis=1) / np.maximum(length, 1e-300)
    smooth = bend < np.radians(30.0)  # a crease inside a face made of several surfaces is not a chord
    worst = float((width * bend / 8.0)[smooth].max()) if smooth.any() else 0.0
    return min(worst, 0.005 * part.diameter)


def _distinct(axes: Float[np.ndarray, "n 3"]) -> list[np.ndarray]:
    """Unit axes without repetition up to sign, in the given order; null vectors are left out."""
    found: list[np.ndarray] = []
    for axis in axes:
        length = np.linalg.norm(axis)
        if length < 1e-6:
            continue
        axis = axis / length
        if not found or (np.linalg.norm(np.cross(np.stack(found), axis), axis=1) > SAME_AXIS).all():
            found.append(axis)
    return found


def _generated(generators: list[np.ndarray]) -> list[np.ndarray]:
    """The group generated by some rotations, without the identity. Elements of such groups are 30 degrees apart or
    more, so two within a few degrees are one."""
    group = [np.eye(3)]
    queue = [R for R in generators if np.trace(R) < 3.0 - 1e-9]
    while queue and len(group) < LARGEST_GROUP:
        R = queue.pop(0)
        if any(np.trace(R.T @ S) > 1.0 + 2.0 * np.cos(np.radians(8.0)) for S in group):
            continue
        group.append(R)
        queue += [R @ S for S in group] + [S @ R for S in group]
    return group[1:]


def _packed(rotations: list[np.ndarray], axes: Float[np.ndarray, "n 3"], centre: np.ndarray) -> Symmetries:
    discrete = np.tile(np.eye(4), (1 + len(rotations), 1, 1))
    for T, R in zip(discrete[1:], rotations, strict=True):
        T[:3, :3], T[:3, 3] = R, centre - R @ centre
    return Symmetries(discrete, tuple((axis + 0.0, centre + 0.0) for axis in axes))
