"""How a part's surface bends: needles of a curved surface change as it slides under a pixel."""

import numpy as np
from itree_kernels.mesh import RayMesh
from jaxtyping import Float, Int

from itree_jax.refinement.information import SmoothSurface

SMOOTH = float(np.cos(np.radians(30.0)))  # facets of one curved face meet at less; more is an edge


def smooth_surface(mesh: RayMesh) -> SmoothSurface:
    """Normals of the surface that the triangles stand for, linear over each: `bending @ X + offset`, model frame.

    Taken from the normals at the triangle's corners, each a mean over the facets of the same face around it, weighted
    by their angles there: exact on a cylinder, whatever its facets. No bending on planes.
    """
    X = mesh.vertices[mesh.triangles].astype(float)
    normal = mesh.triangle_normals.astype(float)
    corner = corner_normals(mesh, corner_angles(X))
    e1, e2 = X[:, 1] - X[:, 0], X[:, 2] - X[:, 0]
    frame = np.stack([e1, e2, normal], axis=-1)
    good = np.abs(np.linalg.det(frame)) > 1e-9 * np.maximum((e1**2).sum(-1), (e2**2).sum(-1))
    turned = np.stack([corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0], 0.0 * normal], axis=-1)
    bending = np.zeros((len(X), 3, 3))
    bending[good] = turned[good] @ np.linalg.inv(frame[good])
    across = np.eye(3) - normal[:, :, None] * normal[:, None, :]
    bending = across @ bending @ across
    bending = 0.5 * (bending + np.swapaxes(bending, -1, -2))
    offset = np.mean(corner - np.einsum("tij,tcj->tci", bending, X), axis=1)
    return SmoothSurface(bending, offset, mesh.face_of_triangle)


def corner_angles(X: Float[np.ndarray, "triangles 3 3"]) -> Float[np.ndarray, "triangles 3"]:
    """Angles [rad] of triangles at their corners."""
    ahead, behind = np.roll(X, -1, axis=1) - X, np.roll(X, 1, axis=1) - X
    return np.arctan2(np.linalg.norm(np.cross(ahead, behind), axis=-1), (ahead * behind).sum(-1))


def corner_normals(mesh: RayMesh, angles: Float[np.ndarray, "triangles 3"]) -> Float[np.ndarray, "triangles 3 3"]:
    """Unit normals at the corners of each triangle, smooth within a face."""
    normal = mesh.triangle_normals.astype(float)
    one, other = pairs_at_vertices(mesh.triangles)  # corners, numbered 3 * triangle + corner
    a, b = one // 3, other // 3
    same = (mesh.face_of_triangle[a] == mesh.face_of_triangle[b]) & ((normal[a] * normal[b]).sum(-1) > SMOOTH)
    total = np.zeros((3 * len(normal), 3))
    np.add.at(total, one[same], angles.reshape(-1)[other[same], None] * normal[b[same]])
    length = np.linalg.norm(total, axis=-1, keepdims=True)
    return (total / np.maximum(length, 1e-12)).reshape(-1, 3, 3)


def pairs_at_vertices(
    triangles: Int[np.ndarray, "triangles 3"],
) -> tuple[Int[np.ndarray, "pairs"], Int[np.ndarray, "pairs"]]:
    """All pairs of corners that share a vertex, each corner with itself too."""
    order = np.argsort(triangles.reshape(-1), kind="stable")
    count = np.bincount(triangles.reshape(-1))
    start = np.concatenate([[0], np.cumsum(count)[:-1]])
    each = np.repeat(count, count)  # partners of every corner, in the order of vertices
    one = np.repeat(order, each)
    within = np.arange(len(one)) - np.repeat(np.cumsum(each) - each, each)
    return one, order[np.repeat(np.repeat(start, count), each) + within]
