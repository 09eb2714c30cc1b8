"""Meshes with far more triangles than their surfaces need, cut down: before faces are looked for, and with them.

Edges are collapsed onto vertices that stay where they are (the library Manifold), so that what is left still lies on
the surfaces of the part: planes keep their corners, a cylinder some of its lines.
"""

import warnings
from dataclasses import replace

import manifold3d
import numpy as np
from itree_kernels.errors import ItreeError, ItreeWarning
from jaxtyping import Float, Int

from itree_cad.part import Part

MOST_TRIANGLES = 50_000  # the search for faces takes longer than in proportion; no part needs more to be seen
FINEST, COARSEST = 1e-6, 5e-3  # of the part's size: how far a surface may move; the first that suffices is taken
UNSEEN = 1e-4  # of the diameter: a hundredth of a pixel where a part is 100 pixels wide


def decimated(
    vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "triangles 3"], where: str
) -> tuple[Float[np.ndarray, "fewer 3"], Int[np.ndarray, "few 3"]]:
    """The mesh (welded, [mm]) with at most `MOST_TRIANGLES`, and an `ItreeWarning` if it had more.

    Raises ItreeError, naming `where`, if it is not closed or cannot be cut down so far.
    """
    if len(triangles) <= MOST_TRIANGLES:
        return vertices, triangles
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    solid = as_manifold(vertices, triangles)
    told = f"{where}: the mesh has {len(triangles)} triangles, {MOST_TRIANGLES} are read"
    if solid.status() != manifold3d.Error.NoError:
        raise ItreeError(f"{told}, and it is not closed, so that it cannot be cut down; export it coarser, or as STEP")
    tolerance = FINEST
    while solid.num_tri() > MOST_TRIANGLES and tolerance <= COARSEST:
        solid, tolerance = solid.simplify(tolerance * size), 2.0 * tolerance
    if solid.num_tri() > MOST_TRIANGLES or solid.num_tri() == 0:
        raise ItreeError(f"{told}, and it cannot be cut down so far; export it coarser, or as STEP")
    warnings.warn(
        f"{told}: it is cut down to {solid.num_tri()}, moving no surface by more than {0.5 * tolerance * size:.3g} mm",
        ItreeWarning,
        stacklevel=4,
    )
    return as_mesh(solid)


def coarser(
    vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "triangles 3"], tolerance: float
) -> tuple[Float[np.ndarray, "fewer 3"], Int[np.ndarray, "few 3"]]:
    """The mesh with as few triangles as it takes if surfaces may move by `tolerance` [mm]; as it is where that leaves
    nothing, or it is not closed.
    """
    solid = as_manifold(vertices, triangles)
    if solid.status() != manifold3d.Error.NoError:
        return vertices, triangles
    solid = solid.simplify(tolerance)
    return (vertices, triangles) if solid.num_tri() == 0 else as_mesh(solid)


def lean(part: Part) -> Part:
    """The part with as few triangles as it takes if no surface moves by more than is `UNSEEN`, and every triangle stays
    one of its component face; as it is where a face would be lost, or the mesh is not closed: the library makes nothing
    of it then.

    CAD systems cut faces finer than any image of them shows, and all that casts or fills a mesh pays for it.
    """
    solid = as_manifold(np.asarray(part.vertices), np.asarray(part.triangles), np.asarray(part.face_of_triangle))
    few = solid.simplify(UNSEEN * part.diameter)
    faces = np.asarray(few.to_mesh64().face_id).astype(np.int64)
    if len(np.unique(faces)) < len(np.unique(part.face_of_triangle)):
        return part
    vertices, triangles = as_mesh(few)
    return replace(part, vertices=vertices, triangles=triangles, face_of_triangle=faces)


def as_manifold(
    vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "triangles 3"],
    face_of_triangle: Int[np.ndarray, "triangles"] | None = None,
) -> manifold3d.Manifold:
    """The library's own; its status tells whether the mesh is closed. It keeps faces apart, if it is told them."""
    corners, faces = vertices.astype(np.float64), triangles.astype(np.uint64)
    if face_of_triangle is None:
        return manifold3d.Manifold(manifold3d.Mesh64(corners, faces))
    return manifold3d.Manifold(manifold3d.Mesh64(corners, faces, face_id=face_of_triangle.astype(np.uint64)))


def as_mesh(solid: manifold3d.Manifold) -> tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "triangles 3"]]:
    """Vertices and triangles again."""
    mesh = solid.to_mesh64()
    return np.asarray(mesh.vert_properties)[:, :3].copy(), np.asarray(mesh.tri_verts).astype(np.int64)
