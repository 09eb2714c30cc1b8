"""Analytic surfaces fitted to the vertices of a patch: plane, cylinder, cone, sphere, torus.

Curved surfaces are all surfaces of revolution, so a point enters only by its radius rho from an axis and its height s
along it; every residual is a signed distance [mm]. A tessellation puts its vertices *on* the surface, so a good fit
leaves rounding only, and a fit with the wrong type leaves much more: that is what makes the types tell apart.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

STEPS = 12  # Gauss-Newton steps; from a start by closed form 3-5 are used
SAMPLE = 240  # points that a refinement uses; the check uses all
LARGEST_RADIUS = 3.0  # in part diameters: a flatter curve is a plane as far as an image can tell


@dataclass(frozen=True)
class FittedSurface:
    """A surface by its type, a point and a direction of its axis, and its sizes.

    plane: a point and the normal. cylinder: `size_a` radius. cone: `point` is the apex, `axis` points into the cone,
    `size_a` the half angle [rad]. sphere: `size_a` radius. torus: `size_a` radius of the spine, `size_b` of the tube.
    """

    type: str
    point: Float[np.ndarray, "3"]
    axis: Float[np.ndarray, "3"]
    size_a: float = 0.0
    size_b: float = 0.0

    def distance(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        """Signed distance of each point [mm]."""
        offset = points - self.point
        s = offset @ self.axis
        if self.type == "plane":
            return s
        if self.type == "sphere":
            return np.linalg.norm(offset, axis=-1) - self.size_a
        rho = np.linalg.norm(offset - s[..., None] * self.axis, axis=-1)
        if self.type == "cylinder":
            return rho - self.size_a
        if self.type == "cone":
            return rho * np.cos(self.size_a) - s * np.sin(self.size_a)
        return np.hypot(rho - self.size_a, s) - self.size_b

    def normal(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Unit normal of the surface nearest to each point (the gradient of `distance`)."""
        offset = points - self.point
        if self.type == "plane":
            return np.broadcast_to(self.axis, points.shape)
        if self.type == "sphere":
            return _unit(offset)
        s = offset @ self.axis
        across = offset - s[..., None] * self.axis
        rho = np.linalg.norm(across, axis=-1)
        radial = _unit(across)
        if self.type == "cylinder":
            return radial
        if self.type == "cone":
            return np.cos(self.size_a) * radial - np.sin(self.size_a) * self.axis
        return _unit((rho - self.size_a)[..., None] * radial + s[..., None] * self.axis)


def _unit(vectors: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0.0, length, 1.0)


def _across(axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors that complete an axis to a frame."""
    first = _unit(np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))]))
    return first, np.cross(axis, first)


def _circle(u: np.ndarray, v: np.ndarray) -> tuple[float, float, float] | None:
    """Algebraic circle through points of a plane: centre and radius."""
    solution, _, rank, _ = np.linalg.lstsq(np.c_[2 * u, 2 * v, np.ones_like(u)], u**2 + v**2, rcond=1e-12)
    square = solution[2] + solution[0] ** 2 + solution[1] ** 2
    return (float(solution[0]), float(solution[1]), float(np.sqrt(square))) if rank == 3 and square > 0 else None


def fit_plane(points: Float[np.ndarray, "n 3"]) -> FittedSurface:
    """Least-squares plane."""
    middle = points.mean(axis=0)
    return FittedSurface("plane", middle, np.linalg.svd(points - middle, full_matrices=False)[2][2])


def _start_cylinder(points, centres, normals, weights) -> FittedSurface | None:
    axis = np.linalg.eigh((normals * weights[:, None]).T @ normals)[1][:, 0]  # all normals are across the axis
    e1, e2 = _across(axis)
    circle = _circle(points @ e1, points @ e2)
    return None if circle is None else FittedSurface("cylinder", circle[0] * e1 + circle[1] * e2, axis, circle[2])


def _start_sphere(points, centres, normals, weights) -> FittedSurface | None:
    system = np.c_[2 * points, np.ones(len(points))]
    solution, _, rank, _ = np.linalg.lstsq(system, (points**2).sum(axis=1), rcond=1e-12)
    square = solution[3] + solution[:3] @ solution[:3]
    return FittedSurface("sphere", solution[:3], np.array([0.0, 0.0, 1.0]), float(np.sqrt(square))) if (
        rank == 4 and square > 0
    ) else None  # fmt: skip


def _start_cone(points, centres, normals, weights) -> FittedSurface | None:
    mean = weights @ normals / weights.sum()
    spread = normals - mean
    axis = np.linalg.eigh((spread * weights[:, None]).T @ spread)[1][:, 0]  # normals make one angle with the axis
    apex, _, rank, _ = np.linalg.lstsq(normals, (normals * centres).sum(axis=1), rcond=1e-9)
    if rank < 3:
        return None
    s = (points - apex) @ axis
    if s.mean() < 0.0:
        axis, s = -axis, -s
    rho = np.linalg.norm(points - apex - s[:, None] * axis, axis=1)
    return FittedSurface("cone", apex, axis, float(np.arctan2(rho.mean(), s.mean())))


def _start_torus(points, centres, normals, weights) -> FittedSurface | None:
    # every normal line meets the axis (a, m): a . (c x n) + m . n = 0
    middle = centres.mean(axis=0)
    scale = float(np.abs(centres - middle).max()) or 1.0
    lines = np.c_[np.cross((centres - middle) / scale, normals), normals]
    complex_ = np.linalg.svd(lines, full_matrices=False)[2][-1]
    axis, moment = complex_[:3], complex_[3:]
    length = np.linalg.norm(axis)
    if length < 1e-9:
        return None
    axis, moment = axis / length, moment / length
    foot = np.cross(axis, moment) * scale + middle
    offset = points - foot
    s = offset @ axis
    circle = _circle(np.linalg.norm(offset - s[:, None] * axis, axis=1), s)
    return None if circle is None else FittedSurface("torus", foot + circle[1] * axis, axis, circle[0], circle[2])


_START = {"cylinder": _start_cylinder, "sphere": _start_sphere, "cone": _start_cone, "torus": _start_torus}


def _refined(start: FittedSurface, points: np.ndarray) -> FittedSurface:
    """Gauss-Newton on the distances, from a start that is nearly right."""
    points = points[:: max(1, len(points) // SAMPLE)]
    count = {"sphere": 0, "cylinder": 5, "cone": 6, "torus": 7}[start.type]
    if not 0 < count <= len(points):
        return start
    length = float(np.abs(points - points.mean(axis=0)).max())
    unit = np.array([1.0, 1.0, length, length, 1.0 if start.type == "cone" else length, length, length])[:count]
    e1, e2 = _across(start.axis)

    def moved(change: np.ndarray) -> FittedSurface:
        change = change * unit
        axis = _unit(start.axis + change[0] * e1 + change[1] * e2)
        point = start.point + change[2] * e1 + change[3] * e2 + change[5:6].sum() * start.axis
        return FittedSurface(
            start.type, point, axis, float(start.size_a + change[4]), float(start.size_b + change[6:].sum())
        )

    change = np.zeros(count)
    residual = moved(change).distance(points)
    for _ in range(STEPS):
        ahead = [moved(change + row).distance(points) - residual for row in 1e-6 * np.eye(count)]
        update = np.linalg.lstsq(np.stack(ahead, axis=1) / 1e-6, -residual, rcond=1e-9)[0]
        new = moved(change + update).distance(points)
        if not new @ new < residual @ residual * (1.0 - 1e-6):
            break
        change, residual = change + update, new
    return moved(change)


def _plausible(surface: FittedSurface, diameter: float) -> bool:
    largest = LARGEST_RADIUS * diameter
    if surface.type == "cone":
        return bool(np.radians(0.5) < surface.size_a < np.radians(89.5))
    if surface.type == "torus":
        return bool(0.0 < surface.size_b <= surface.size_a < largest)
    return bool(0.0 < surface.size_a < largest)


def fit_curved(
    kind: str,
    points: Float[np.ndarray, "n 3"],
    centres: Float[np.ndarray, "m 3"],
    normals: Float[np.ndarray, "m 3"],
    areas: Float[np.ndarray, "m"],
    tolerance: float,
    diameter: float,
) -> FittedSurface | None:
    """The surface of type `kind` through all points within `tolerance` [mm], or None.

    `centres`, `normals` and `areas` of the facets between the points give the start of the fit; facets of a
    tessellated torus or freeform patch are only nearly parallel to the surface, so the points have the last word.
    """
    surface = _START[kind](points, centres, normals, areas)
    if surface is None or not np.abs(surface.distance(points)).max() < 0.1 * diameter:
        return None
    kept = np.ones(len(points), dtype=bool)
    for _ in range(3):
        distance = np.abs(surface.distance(points))
        if distance[kept].max() > 0.05 * tolerance:
            surface = _refined(surface, points[kept])
            distance = np.abs(surface.distance(points))
        within = distance <= tolerance
        if not _plausible(surface, diameter) or distance[kept].max() <= tolerance or within.sum() < 0.6 * len(points):
            break
        kept = within
    lowest, highest = chord_band(surface, surface.distance(centres), areas, tolerance)
    distance = surface.distance(points)
    fits = _plausible(surface, diameter) and (distance >= lowest).all() and (distance <= highest).all()
    return surface if fits and (np.abs(distance) <= tolerance).sum() >= 0.6 * len(points) else None


def chord_band(
    surface: FittedSurface, centre_distance: Float[np.ndarray, "m"], areas: Float[np.ndarray, "m"], tolerance: float
) -> tuple[float, float]:
    """Lowest and highest signed distance [mm] that a vertex may have.

    A mesh that was cut after it was tessellated has vertices on the chords, as far inside the surface as the facets'
    centres are (outside too on a torus, which is a saddle on its inner side).
    """
    order = np.argsort(np.abs(centre_distance), kind="stable")
    total = np.cumsum(areas[order])
    sagitta = 1.3 * float(np.abs(centre_distance)[order][np.searchsorted(total, 0.75 * total[-1])])
    inside = max(tolerance, sagitta)
    return -inside, inside if surface.type == "torus" else tolerance


def fit_any(
    points: Float[np.ndarray, "n 3"],
    centres: Float[np.ndarray, "m 3"],
    normals: Float[np.ndarray, "m 3"],
    areas: Float[np.ndarray, "m"],
    tolerance: float,
    diameter: float,
) -> FittedSurface | None:
    """The simplest surface through all points, or None: a freeform patch."""
    plane = fit_plane(points)
    if np.abs(plane.distance(points)).max() <= tolerance:
        return plane
    for kind in _START:
        surface = fit_curved(kind, points, centres, normals, areas, tolerance, diameter)
        if surface is not None:
            return surface
    return None
