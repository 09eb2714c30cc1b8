"""The geodesic dome: viewer directions spread evenly over the Gaussian sphere (Ikeuchi 1987, sec. 2.1.1, figure 2c).

A regular dodecahedron, each pentagon cut into five plane triangles: the one-frequency dome of 60 directions. The
f-frequency dome cuts each of these into f^2, so a dome of frequency f k refines that of frequency f.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Float, Int

GOLDEN = (1.0 + 5.0**0.5) / 2.0
TRIANGLES_PER_FREQUENCY_1 = 60
# A view this close to the part's z axis [unit vector difference] has no projected z: up is the part's y there.
ALONG_Z = 1e-6


@dataclass(frozen=True)
class Dome:
    """Tessellated sphere; cell k is looked at from `directions[k]`."""

    frequency: int
    directions: Float[np.ndarray, "cells 3"]  # unit, from the part toward the viewer, part frame
    triangles: Float[np.ndarray, "cells 3 3"]  # corners on the plane pentagons of a dodecahedron of inradius 1

    @property
    def cell_count(self) -> int:
        return len(self.directions)


@cache
def dome(frequency: int = 1) -> Dome:
    """The dome of 60 frequency^2 viewer directions.

    Direction = normalised centroid of the *plane* triangle: the pentagon's centre is not lifted to the sphere first
    (that would move the directions and merge other views into one group).

    Raises:
        ItreeError: the frequency is not a whole number of at least 1.
    """
    if frequency < 1:
        raise ItreeError(f"A dome's frequency is a whole number of at least 1, not {frequency}. Use 1 for 60 views.")
    corner_weights = _subdivision(frequency)
    triangles = np.einsum("tcb,pbx->ptcx", corner_weights, _pentagon_triangles()).reshape(-1, 3, 3)
    centroids = triangles.mean(axis=1)
    directions = centroids / np.linalg.norm(centroids, axis=1, keepdims=True)
    for array in (directions, triangles):
        array.flags.writeable = False
    return Dome(frequency, directions, triangles)


def parent_view(frequency: int, k: int) -> Int[np.ndarray, "cells"]:
    """For every cell of `dome(frequency * k)`, the cell of `dome(frequency)` that contains it."""
    fine = frequency * k
    # Barycentric coordinates of a small triangle's centroid in thirds of its own step, scaled to the coarse steps.
    thirds = np.array([[3 * a + 1 + down, 3 * b + 1 + down] for a, b, down in _small_triangles(fine)])
    third = 3 * fine - thirds.sum(axis=1)
    coarse = np.column_stack([thirds, third]) // (3 * k)
    down = (coarse.sum(axis=1) == frequency - 2).astype(int)
    index = {key: i for i, key in enumerate(_small_triangles(frequency))}
    inside = np.array([index[int(a), int(b), int(d)] for (a, b, _), d in zip(coarse, down, strict=True)])
    return (np.arange(TRIANGLES_PER_FREQUENCY_1)[:, None] * frequency**2 + inside[None, :]).ravel()


def camera_rotation(direction: Float[np.ndarray, "*views 3"]) -> Float[np.ndarray, "*views 3 3"]:
    """`R_cam_obj` of a camera that looks at the part from unit `direction` (part frame, toward the viewer).

    Image up is the part's +z projected, its +y where the view is along z; the camera's y points down, its z away.
    """
    direction = np.asarray(direction, dtype=float)
    z_cam = -direction
    z_obj, y_obj = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
    along_z = np.linalg.norm(direction[..., :2], axis=-1, keepdims=True) < ALONG_Z
    up = np.where(along_z, y_obj, z_obj)
    up = up - np.sum(up * z_cam, axis=-1, keepdims=True) * z_cam
    y_cam = -up / np.linalg.norm(up, axis=-1, keepdims=True)
    x_cam = np.cross(y_cam, z_cam)
    return np.stack([x_cam, y_cam, z_cam], axis=-2)


def _small_triangles(frequency: int) -> list[tuple[int, int, int]]:
    """(row along corner 0, row along corner 1, 1 if it points down) of the f^2 small triangles of one triangle."""
    up = [(a, b, 0) for a in range(frequency) for b in range(frequency - a)]
    down = [(a, b, 1) for a in range(frequency - 1) for b in range(frequency - 1 - a)]
    return sorted(up + down)


def _subdivision(frequency: int) -> Float[np.ndarray, "small corners barycentric"]:
    """Barycentric coordinates of the corners of the small triangles, in the large one's sense of turning."""
    corners = []
    for a, b, down in _small_triangles(frequency):
        c = frequency - 1 - a - b - down
        base = np.array([a + down, b + down, c + down])
        steps = -np.eye(3, dtype=int) if down else np.eye(3, dtype=int)
        corners.append(base + steps)
    return np.array(corners) / frequency


def _pentagon_triangles() -> Float[np.ndarray, "60 corners 3"]:
    """The five plane triangles of each pentagon (centre, corner, next corner), counter-clockwise from outside."""
    normals, vertices = _dodecahedron()
    triangles = []
    for normal in normals:
        height = vertices @ normal
        corners = vertices[height > height.max() - 1e-9]
        centre = corners.mean(axis=0)
        x_axis = corners[0] - centre
        angle = np.arctan2((corners - centre) @ np.cross(normal, x_axis), (corners - centre) @ x_axis)
        corners = corners[np.argsort(angle)]
        triangles += [(centre, corners[i], corners[(i + 1) % 5]) for i in range(5)]
    return np.array(triangles)


def _dodecahedron() -> tuple[Float[np.ndarray, "12 3"], Float[np.ndarray, "20 3"]]:
    """Unit face normals, along (0, +-1, +-g) and its cyclic turns, and vertices, scaled to inradius 1."""
    signs = [(s, t) for s in (1.0, -1.0) for t in (1.0, -1.0)]
    normals = [np.roll((0.0, s, t * GOLDEN), turn) for turn in range(3) for s, t in signs]
    cube = [(s, t, u) for s, t in signs for u in (1.0, -1.0)]
    others = [np.roll((0.0, s * GOLDEN, t / GOLDEN), turn) for turn in range(3) for s, t in signs]
    unit_normals = np.array(normals) / np.sqrt(1.0 + GOLDEN**2)
    vertices = np.array(cube + [tuple(v) for v in others])
    return unit_normals, vertices / (vertices @ unit_normals.T).max()
