"""Which component face a moved piece of surface comes to lie on."""

import numpy as np
from jaxtyping import Float, Int

from itree_cad.assemble import triangle_areas
from itree_cad.part import Part
from itree_cad.surface_distance import SurfaceDistance, point_triangle_distance

SAMPLES = 64  # points per face: shares of a face are known to some 5 %
CANDIDATES = 24  # nearby triangles that are looked at for each point
SAME_SIDE = 0.7  # cosine: the two sides of a thin wall or the faces at a sharp edge are not taken for each other


class FaceAt:
    """One part's faces, each as points spread over it, and the question of where such points come to lie."""

    def __init__(self, part: Part):
        self.part = part
        self.surface = SurfaceDistance(part.vertices, part.triangles)
        corners = part.vertices[part.triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self.normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        triangles, self.points = self._spread()
        self.point_normals = self.normals[triangles]

    def _spread(self) -> tuple[Int[np.ndarray, "points"], Float[np.ndarray, "points 3"]]:
        """`SAMPLES` points on every face, evenly by area; those of a face follow each other."""
        rng = np.random.default_rng(0)
        areas = triangle_areas(self.part.vertices, self.part.triangles)
        chosen = []
        for face in range(self.part.face_count):
            mine = np.flatnonzero(self.part.face_of_triangle == face)
            total = np.cumsum(areas[mine])
            steps = (np.arange(SAMPLES) + 0.5) / SAMPLES * total[-1]
            chosen.append(mine[np.minimum(np.searchsorted(total, steps), len(mine) - 1)])
        triangles = np.concatenate(chosen)
        weight = rng.dirichlet(np.ones(3), len(triangles))
        return triangles, np.einsum("pc,pcx->px", weight, self.part.vertices[self.part.triangles[triangles]])

    def share(self, T: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "faces faces"]:
        """Share of face i that the motion T lays on face j."""
        points = self.points @ T[:3, :3].T + T[:3, 3]
        normals = self.point_normals @ T[:3, :3].T
        candidates = self.surface.owner[self.surface.tree.query(points, k=CANDIDATES)[1]]
        a, b, c = (self.surface.corners[candidates, k] for k in range(3))
        distance = point_triangle_distance(np.broadcast_to(points[:, None], a.shape), a, b, c)
        turned_away = (self.normals[candidates] * normals[:, None]).sum(axis=-1) < SAME_SIDE
        nearest = np.where(turned_away, distance + self.part.diameter, distance).argmin(axis=1)
        face = self.part.face_of_triangle[candidates[np.arange(len(points)), nearest]]
        count = self.part.face_count
        own = np.repeat(np.arange(count), SAMPLES)
        return np.bincount(own * count + face, minlength=count * count).reshape(count, count) / SAMPLES
