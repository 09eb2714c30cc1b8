"""STEP -> solids whose triangles know their B-rep face, and B-rep faces -> component faces."""

import io
from pathlib import Path

import numpy as np
import trimesh
from itree_kernels.errors import ItreeError
from jaxtyping import Float, Int

from itree_cad.assemble import components, shared_edges, triangle_areas
from itree_cad.faces import SMOOTH_ANGLE
from itree_cad.solids import RawSolid
from itree_cad.step_reader import step_to_glb
from itree_cad.surfaces import FittedSurface, fit_any, fit_curved, fit_plane
from itree_cad.units import MILLIMETRES, step_unit

ON_SURFACE = 1e-4  # of the diameter: a B-rep keeps its edges to a tolerance of its own, coarser than rounding
COPLANAR = np.cos(np.radians(0.1))


def read_step(path: Path, units: str | None) -> tuple[list[RawSolid], str]:
    """All solids of a STEP file [mm] and the unit that its numbers are in.

    `units` overrules what the file says (a file can be wrong about itself). A single solid keeps the coordinates of the
    file; the solids of an assembly keep their own.
    """
    data = path.read_bytes()
    if b"ISO-10303-21" not in data[:4096]:
        raise ItreeError(f"{path} cannot be read as STEP: it does not begin as one")
    glb = step_to_glb(data, str(path))
    declared = step_unit(data.decode("latin-1"))
    scale = MILLIMETRES["m"]  # a GLB is in metres
    if units is not None:
        if declared is None:
            raise ItreeError(f"{path} does not say one unit of its own, so it cannot be read as '{units}' instead")
        scale *= MILLIMETRES[units] / MILLIMETRES[declared]
    try:
        scene = trimesh.load_scene(io.BytesIO(glb), file_type="glb")
    except Exception as error:  # the reader raises whatever it trips over
        raise ItreeError(f"{path} cannot be read as STEP: what OpenCascade makes of it is no mesh ({error})") from error
    return scene_solids(scene, scale), units or declared or "mm"


def scene_solids(scene: trimesh.Scene, scale: float) -> list[RawSolid]:
    """The meshes of a scene, scaled to [mm], in the order of the file. A single one keeps its place in the scene."""
    nodes: dict[str, list[str]] = {}
    for node in scene.graph.nodes_geometry:
        nodes.setdefault(str(scene.graph[node][1]), []).append(node)
    meshes = [(name, mesh) for name, mesh in scene.geometry.items() if isinstance(mesh, trimesh.Trimesh)]
    meshes = [(name, mesh) for name, mesh in meshes if len(mesh.faces) and name in nodes]
    alone = len(meshes) == 1 and len(nodes[meshes[0][0]]) == 1
    solids = []
    for name, mesh in meshes:
        matrix = np.asarray(scene.graph[nodes[name][0]][0], dtype=np.float64)
        if not alone:
            matrix = np.diag([*[abs(np.linalg.det(matrix[:3, :3])) ** (1.0 / 3.0)] * 3, 1.0])
        vertices = np.asarray(mesh.vertices, dtype=np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
        triangles = np.asarray(mesh.faces, dtype=np.int64)
        index = mesh.face_attributes.get("brep_index")
        primitives = mesh.metadata.get("cascadio", {}).get("brep_primitives", [])
        types = tuple(None if primitive is None else type(primitive).__name__.lower() for primitive in primitives)
        face = None if index is None else np.asarray(index, dtype=np.int64).reshape(-1)
        solids.append(RawSolid(name, vertices * scale, triangles, face, types))
    return solids


def brep_component_faces(
    vertices: Float[np.ndarray, "vertices 3"],
    triangles: Int[np.ndarray, "triangles 3"],
    brep_face: Int[np.ndarray, "triangles"],
    brep_types: tuple[str | None, ...],
    diameter: float,
) -> tuple[Int[np.ndarray, "triangles"], tuple[str, ...]]:
    """Label per triangle and type per label, from B-rep faces of a welded mesh [mm].

    Adjacent B-rep faces of one surface (a cylinder in two halves, a plane cut by a seam) are one component face. A
    surface that the file does not give as analytic is named by what its triangles fit, else "freeform".
    """
    used, label = np.unique(brep_face, return_inverse=True)
    surfaces: list[FittedSurface | None] = []
    types: list[str] = []
    for k, face in enumerate(used.tolist()):
        known = brep_types[face] if 0 <= face < len(brep_types) else None
        surface = _fitted(vertices, triangles[label == k], known, diameter)
        surfaces.append(surface)
        types.append(known or (surface.type if surface is not None else "freeform"))
    pairs, _ = shared_edges(triangles)
    pairs = pairs[label[pairs[:, 0]] != label[pairs[:, 1]]]
    bend = _bend(vertices, triangles, pairs)
    joined = [
        (a, b)
        for (a, b), angle in _borders(label[pairs], bend).items()
        if _one_surface(vertices, triangles, label, surfaces, a, b, angle, ON_SURFACE * diameter)
    ]
    merged = components(len(used), np.array(joined, dtype=np.int64).reshape(-1, 2))
    first = np.unique(merged, return_index=True)[1]
    return merged[label], tuple(types[k] for k in first)


def _fitted(vertices: np.ndarray, triangles: np.ndarray, known: str | None, diameter: float) -> FittedSurface | None:
    points = vertices[np.unique(triangles)]
    if known == "plane":
        return fit_plane(points)
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    solid = length > 0.0
    normals = normals[solid] / length[solid, None]
    areas = triangle_areas(vertices, triangles)[solid]
    given = (points, corners.mean(axis=1)[solid], normals, areas, ON_SURFACE * diameter, diameter)
    return fit_any(*given) if known is None else fit_curved(known, *given)


def _bend(vertices: np.ndarray, triangles: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Angle between the normals of neighbouring triangles [rad]."""
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    return np.arccos(np.clip((normals[pairs[:, 0]] * normals[pairs[:, 1]]).sum(axis=1), -1.0, 1.0))


def _borders(faces: np.ndarray, bend: np.ndarray) -> dict[tuple[int, int], float]:
    """Median bend along the common border of each pair of neighbouring faces."""
    keys, inverse = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True)
    return {(int(a), int(b)): float(np.median(bend[inverse.reshape(-1) == k])) for k, (a, b) in enumerate(keys)}


def _one_surface(vertices, triangles, label, surfaces, a: int, b: int, bend: float, tolerance: float) -> bool:
    first, second = surfaces[a], surfaces[b]
    if first is None or second is None or first.type != second.type or bend > SMOOTH_ANGLE:
        return False
    if first.type == "plane" and np.cos(bend) < COPLANAR:
        return False
    points = [vertices[np.unique(triangles[label == k])] for k in (a, b)]
    return bool(
        np.abs(first.distance(points[1])).max() <= tolerance and np.abs(second.distance(points[0])).max() <= tolerance
    )
