"""A triangle mesh that rays can be cast at."""

from dataclasses import dataclass

import numpy as np
import warp as wp
from jaxtyping import Float, Int

from itree_kernels.errors import ItreeError
from itree_kernels.warp_start import quiet_warp, warp_device

SHADOW_OFFSET = 1e-4  # of the mesh's reach: some hundred roundings of float32, and under 0.01 mm on a part of 100 mm


@dataclass(frozen=True, eq=False)
class RayMesh:
    """Triangles with their bounding volume hierarchy. Keep it alive as long as its `warp_mesh.id` is in use."""

    vertices: Float[np.ndarray, "vertices 3"]  # [mm], float32 as the rays see them
    triangles: Int[np.ndarray, "triangles 3"]  # counter-clockwise seen from outside
    face_of_triangle: Int[np.ndarray, "triangles"]  # component face of each triangle
    triangle_normals: Float[np.ndarray, "triangles 3"]  # outward, unit; 0 where a triangle has no area
    centre: Float[np.ndarray, "3"]  # of the bounding sphere [mm]
    radius: float  # of the bounding sphere [mm]
    is_closed: bool  # every edge has a triangle on either side, both wound alike: nothing is seen from inside
    shadow_offset: float  # how far a shadow ray starts above its surface [mm]
    device: str  # Warp's name, "cpu" or "cuda:0"
    warp_mesh: wp.Mesh
    normals_obj: wp.array  # of vec3: triangle_normals on the device
    across_edge: wp.array  # of int [3 triangles]: the one beyond the edge from each corner; empty unless closed
    face_ids: wp.array  # of int16: face_of_triangle on the device


def ray_mesh(
    vertices: Float[np.ndarray, "vertices 3"],
    triangles: Int[np.ndarray, "triangles 3"],
    face_of_triangle: Int[np.ndarray, "triangles"],
    device: str | None = None,
) -> RayMesh:
    """Builds the hierarchy on `device` (`None`: Warp's default device).

    Vertices [mm]; `face_of_triangle` names the component face of each triangle, 0..32767.
    Raises ItreeError when an array is empty, has another shape, is not finite, or an index is out of range.
    """
    vertices, triangles, faces = _checked(np.asarray(vertices), np.asarray(triangles), np.asarray(face_of_triangle))
    normals = triangle_normals(vertices, triangles).astype(np.float32)
    centre = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    radius = float(np.linalg.norm(vertices - centre, axis=1).max())
    reach = float(np.abs(vertices).max())
    name = warp_device(device)
    closed = is_closed(triangles)
    across = neighbours(triangles) if closed else np.zeros(0, np.int32)
    with quiet_warp():
        mesh = wp.Mesh(
            points=wp.array(vertices, dtype=wp.vec3, device=name),
            indices=wp.array(triangles.ravel(), dtype=wp.int32, device=name),
        )
        return RayMesh(
            vertices=vertices,
            triangles=triangles,
            face_of_triangle=faces,
            triangle_normals=normals,
            centre=centre,
            radius=radius,
            is_closed=closed,
            shadow_offset=SHADOW_OFFSET * reach,
            device=name,
            warp_mesh=mesh,
            normals_obj=wp.array(normals, dtype=wp.vec3, device=name),
            across_edge=wp.array(across, dtype=wp.int32, device=name),
            face_ids=wp.array(faces.astype(np.int16), dtype=wp.int16, device=name),
        )


def triangle_normals(
    vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "triangles 3"]
) -> Float[np.ndarray, "triangles 3"]:
    """Outward unit normals; 0 where a triangle has no area."""
    a, b, c = (vertices[triangles[:, k]].astype(np.float64) for k in range(3))
    cross = np.cross(b - a, c - a)
    length = np.linalg.norm(cross, axis=1, keepdims=True)
    return np.divide(cross, length, out=np.zeros_like(cross), where=length > 0)


def neighbours(triangles: Int[np.ndarray, "triangles 3"]) -> Int[np.ndarray, "edges"]:
    """Of a closed mesh, the triangle beyond each edge: entry 3 f + k is for the edge from corner k of triangle f."""
    there = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2).astype(np.int64)
    count = there.max(initial=0) + 1
    key, back = there @ [count, 1], there @ [1, count]
    order = np.argsort(key)
    return (order[np.searchsorted(key[order], back)] // 3).astype(np.int32)


def is_closed(triangles: Int[np.ndarray, "triangles 3"]) -> bool:
    """Whether each edge is run through once in either direction."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]).astype(np.int64)
    count = edges.max(initial=0) + 1
    there, back = edges @ [count, 1], edges @ [1, count]
    return len(np.unique(there)) == len(there) and np.array_equal(np.sort(there), np.sort(back))


def _checked(vertices: np.ndarray, triangles: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, ...]:
    """Contiguous float32 [mm], int32, int32 copies."""
    if vertices.ndim != 2 or vertices.shape[1:] != (3,) or len(vertices) == 0:
        raise ItreeError(f"a mesh needs vertices of shape (n, 3) with n > 0, not {vertices.shape}")
    if triangles.ndim != 2 or triangles.shape[1:] != (3,) or len(triangles) == 0:
        raise ItreeError(f"a mesh needs triangles of shape (n, 3) with n > 0, not {triangles.shape}")
    if faces.shape != (len(triangles),):
        raise ItreeError(
            f"each of the {len(triangles)} triangles needs one component face, "
            f"but face_of_triangle has shape {faces.shape}"
        )
    _check_indices("triangles", triangles, len(vertices), "vertices")
    _check_indices("face_of_triangle", faces, np.iinfo(np.int16).max + 1, "component faces")
    finite = np.isfinite(vertices).all(axis=1)
    if not finite.all():
        raise ItreeError(
            f"vertex {int(np.argmin(finite))} of the mesh is not finite; repair the model and load it again"
        )
    return (
        np.array(vertices, dtype=np.float32, order="C"),
        np.array(triangles, dtype=np.int32, order="C"),
        np.array(faces, dtype=np.int32),
    )


def _check_indices(name: str, indices: np.ndarray, count: int, of_what: str) -> None:
    if not np.issubdtype(indices.dtype, np.integer):
        raise ItreeError(f"{name} must be integers, not {indices.dtype}")
    if indices.min() < 0 or indices.max() >= count:
        raise ItreeError(
            f"{name} holds {int(indices.min())}..{int(indices.max())}, outside 0..{count - 1} ({count} {of_what})"
        )
