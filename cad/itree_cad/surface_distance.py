"""Exact distance from points to a triangle mesh, and points spread evenly over it."""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from itree_cad.assemble import triangle_areas

CANDIDATES = (8, 96)  # triangles looked at first; the few points that these leave in doubt are asked of all triangles
SPREAD = 20000  # points that index the surface
BLOCK = 2_000_000  # point-triangle pairs computed at once


def surface_sample(
    vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "triangles 3"], count: int, seed: int
) -> Float[np.ndarray, "count 3"]:
    """Points spread evenly by area."""
    return _sample(vertices, triangles, count, seed)[0]


def _sample(vertices: np.ndarray, triangles: np.ndarray, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    total = np.cumsum(triangle_areas(vertices, triangles))
    steps = (np.arange(count) + rng.random(count)) / count  # stratified: no patch is missed
    chosen = np.minimum(np.searchsorted(total, steps * total[-1]), len(triangles) - 1)
    r, s = np.sqrt(rng.random(count))[:, None], rng.random(count)[:, None]
    a, b, c = (vertices[triangles[chosen, k]] for k in range(3))
    return (1 - r) * a + r * (1 - s) * b + r * s * c, chosen


def point_triangle_distance(
    points: Float[np.ndarray, "*n 3"], a: Float[np.ndarray, "*n 3"], b: Float[np.ndarray, "*n 3"],
    c: Float[np.ndarray, "*n 3"],
) -> Float[np.ndarray, "*n"]:  # fmt: skip
    """Distance of each point to its triangle: to the plane when its foot is inside, else to the nearest edge."""
    normal = np.cross(b - a, c - a)
    square = (normal**2).sum(axis=-1)
    inside = square > 0.0
    edges = []
    for start, end in ((a, b), (b, c), (c, a)):
        along, offset = end - start, points - start
        inside &= (np.cross(normal, along) * offset).sum(axis=-1) >= 0.0
        length = (along**2).sum(axis=-1)
        share = np.clip((offset * along).sum(axis=-1) / np.where(length > 0.0, length, 1.0), 0.0, 1.0)
        edges.append(np.linalg.norm(offset - share[..., None] * along, axis=-1))
    plane = np.abs(((points - a) * normal).sum(axis=-1)) / np.sqrt(np.where(square > 0.0, square, 1.0))
    return np.where(inside, plane, np.minimum(np.minimum(edges[0], edges[1]), edges[2]))


class SurfaceDistance:
    """Asks whether points lie on a surface."""

    def __init__(self, vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "triangles 3"]):
        self.corners = vertices[triangles]
        spread, owner = _sample(vertices, triangles, SPREAD, seed=1)
        every = np.arange(len(triangles))
        self.owner = np.concatenate([owner, every, np.repeat(every, 3)])
        index = np.concatenate([spread, self.corners.mean(axis=1), self.corners.reshape(-1, 3)])
        self.tree = KDTree(index)

    def near(self, points: Float[np.ndarray, "n 3"], candidate_count: int = CANDIDATES[0]) -> Float[np.ndarray, "n"]:
        """Upper bound of each point's distance, nearly always the distance itself."""
        candidates = self.owner[self.tree.query(points, k=candidate_count)[1]]
        a, b, c = (self.corners[candidates, k] for k in range(3))
        return point_triangle_distance(np.broadcast_to(points[:, None], a.shape), a, b, c).min(axis=1)

    def exact(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        """Distance of each point, by asking every triangle."""
        step = max(1, BLOCK // len(self.corners))
        found = []
        for start in range(0, len(points), step):
            block = points[start : start + step, None]
            shape = (len(block), len(self.corners), 3)
            a, b, c = (np.broadcast_to(self.corners[None, :, k], shape) for k in range(3))
            found.append(point_triangle_distance(np.broadcast_to(block, shape), a, b, c).min(axis=1))
        return np.concatenate(found) if found else np.zeros(0)

    def all_within(self, points: Float[np.ndarray, "n 3"], tolerance: float) -> bool:
        """Whether every point is within `tolerance` of the surface. Exact: doubt is resolved, the worst point first."""
        for count in CANDIDATES:
            bound = self.near(points, count)
            order = np.argsort(-bound, kind="stable")[: int((bound > tolerance).sum())]
            if len(order) == 0:
                return True
            if self.exact(points[order[:1]])[0] > tolerance:
                return False
            points = points[order[1:]]
        return not (self.exact(points) > tolerance).any()
