"""A solid as a page carries it: few enough triangles, smooth within a surface and sharp between surfaces.

The pages' 3-D view draws these; nothing is measured on them, so that a solid may lose detail nobody sees.
"""

import base64
from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

SHARP = np.radians(32.0)  # between neighbours: facets of a cylinder of 12 sides and more look round, real edges don't
CELLS = (256, 192, 128, 96, 64, 48, 32, 24, 16)  # of a solid's largest side: grids that its vertices snap to


@dataclass(frozen=True)
class DrawnSolid:
    """Vertices are repeated where surfaces meet, so that each has one normal."""

    vertices: Float[np.ndarray, "vertices 3"]  # [mm]
    normals: Float[np.ndarray, "vertices 3"]  # unit
    triangles: Int[np.ndarray, "triangles 3"]
    edges: Int[np.ndarray, "edges 2"]  # pairs of vertices: where two surfaces meet, or one ends


def drawn_solid(mesh: trimesh.Trimesh, most_triangles: int) -> DrawnSolid:
    """A mesh with at most about this many triangles, its surfaces apart."""
    vertices, triangles = lightened(np.asarray(mesh.vertices, float), np.asarray(mesh.faces), most_triangles)
    light = trimesh.Trimesh(vertices, triangles, process=False)
    light.merge_vertices()
    light.update_faces(light.nondegenerate_faces())
    surface = surfaces_of(light)
    corners = np.asarray(light.faces)
    pairs = np.column_stack([corners.ravel(), np.repeat(surface, 3)])
    unique, split = np.unique(pairs, axis=0, return_inverse=True)
    split = split.reshape(-1, 3)
    weighted = np.asarray(light.face_normals) * np.asarray(light.area_faces)[:, None]
    normals = np.zeros((len(unique), 3))
    np.add.at(normals, split, np.repeat(weighted[:, None], 3, axis=1))
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(length > 0, normals / np.where(length > 0, length, 1.0), 0.0)
    return DrawnSolid(np.asarray(light.vertices)[unique[:, 0]], normals, split, edges_of(light, surface, split))


def lightened(
    vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "triangles 3"], most: int
) -> tuple[Float[np.ndarray, "fewer 3"], Int[np.ndarray, "less 3"]]:
    """Vertices that share a cell of a grid become one, on the finest grid that leaves at most `most` triangles (else
    on the coarsest); a solid that is light enough stays as it is."""
    low, side = vertices.min(axis=0, initial=0.0), float(np.ptp(vertices, axis=0).max(initial=0.0))
    for cells in CELLS:
        if len(triangles) <= most or side == 0.0:
            break
        key = np.floor((vertices - low) / side * cells).astype(int)
        _, first, cell = np.unique(key, axis=0, return_index=True, return_inverse=True)
        snapped = cell.reshape(-1)[triangles]
        there = (snapped != np.roll(snapped, 1, axis=1)).all(axis=1)
        if there.sum() <= most or cells == CELLS[-1]:
            return vertices[first], snapped[there]
    return vertices, triangles


def surfaces_of(mesh: trimesh.Trimesh) -> Int[np.ndarray, "triangles"]:
    """Number of the smooth surface that each triangle is of: neighbours at less than `SHARP` are of one."""
    count = len(mesh.faces)
    smooth = mesh.face_adjacency[mesh.face_adjacency_angles < SHARP]
    links = coo_matrix((np.ones(len(smooth), bool), (smooth[:, 0], smooth[:, 1])), (count, count))
    return connected_components(links, directed=False)[1]


def edges_of(
    mesh: trimesh.Trimesh, surface: Int[np.ndarray, "triangles"], split: Int[np.ndarray, "triangles 3"]
) -> Int[np.ndarray, "edges 2"]:
    """Edges between surfaces and around open ones, as vertices of `split`."""
    ends = np.asarray(mesh.edges_sorted)  # three of each triangle: corners 0-1, 1-2, 2-0
    mine = np.stack([split, np.roll(split, -1, axis=1)], axis=-1).reshape(-1, 2)
    _, first, which, count = np.unique(ends, axis=0, return_index=True, return_inverse=True, return_counts=True)
    which = which.reshape(-1)
    of_edge = np.repeat(surface, 3)
    low, high = np.full(len(first), np.iinfo(np.int64).max), np.full(len(first), -1)
    np.minimum.at(low, which, of_edge)
    np.maximum.at(high, which, of_edge)
    return mine[first[(low != high) | (count == 1)]]


def packed(solid: DrawnSolid) -> dict[str, str | bool]:
    """Little-endian numbers in base64, as `world3d.js` reads them."""
    wide = len(solid.vertices) > np.iinfo(np.uint16).max
    index = "<u4" if wide else "<u2"
    normals = np.zeros((len(solid.normals), 4), np.int8)  # rows of four bytes, as graphics memory wants them
    normals[:, :3] = np.round(127.0 * solid.normals)
    return {
        "points": _base64(solid.vertices.astype("<f4")), "normals": _base64(normals),
        "triangles": _base64(solid.triangles.astype(index)), "edges": _base64(solid.edges.astype(index)), "wide": wide,
    }  # fmt: skip


def _base64(array: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode("ascii")
