"""Triangles with labels -> a Part: faces in area order, diameter, watertightness, outward winding."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.distance import cdist

from itree_cad.part import Part

TIE = 1e-4  # areas equal to this fraction are a tie: congruent faces differ by rounding only


def triangle_areas(vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "triangles 3"]) -> np.ndarray:
    """Area of each triangle [mm^2]."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def signed_volume(vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "triangles 3"]) -> float:
    """Volume enclosed [mm^3], negative when wound inward (divergence theorem about the mean point)."""
    a, b, c = (vertices[triangles[:, k]] - vertices.mean(axis=0) for k in range(3))
    return float(np.sum(a * np.cross(b, c)) / 6.0)


def diameter(vertices: Float[np.ndarray, "vertices 3"]) -> float:
    """The largest distance between two vertices [mm], exact: it is attained at two vertices of the convex hull."""
    try:
        extreme = vertices[ConvexHull(vertices).vertices]
    except QhullError:  # a flat or collinear set has no hull in 3-D
        extreme = np.unique(vertices, axis=0)
    return max(float(cdist(extreme[k : k + 1024], extreme).max()) for k in range(0, len(extreme), 1024))


def shared_edges(
    triangles: Int[np.ndarray, "triangles 3"],
) -> tuple[Int[np.ndarray, "pairs 2"], Int[np.ndarray, "pairs 2"]]:
    """Pairs of triangles that share an edge, and the edge's two vertices; three around one edge make two pairs."""
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(triangles)), 3)
    order = np.lexsort((owner, edges[:, 1], edges[:, 0]))
    edges, owner = edges[order], owner[order]
    same = (edges[1:] == edges[:-1]).all(axis=1)
    return np.c_[owner[:-1][same], owner[1:][same]], edges[:-1][same]


def is_watertight(triangles: Int[np.ndarray, "triangles 3"]) -> bool:
    """Every directed edge is met by exactly one triangle, and its opposite by exactly one: closed and well wound."""
    directed = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    count = int(directed.max()) + 1
    forward = directed[:, 0] * count + directed[:, 1]
    backward = directed[:, 1] * count + directed[:, 0]
    return len(np.unique(forward)) == len(forward) and bool(np.array_equal(np.sort(forward), np.sort(backward)))


def connected_labels(
    triangles: Int[np.ndarray, "triangles 3"], label: Int[np.ndarray, "triangles"]
) -> Int[np.ndarray, "triangles"]:
    """Splits each label into its edge-connected pieces: ids 0.., numbered by their first triangle."""
    pairs, _ = shared_edges(triangles)
    pairs = pairs[label[pairs[:, 0]] == label[pairs[:, 1]]]
    return components(len(triangles), pairs)


def components(count: int, pairs: Int[np.ndarray, "pairs 2"]) -> Int[np.ndarray, "count"]:
    """Connected components of a graph on 0..count-1, numbered by their first member."""
    graph = coo_matrix((np.ones(len(pairs), dtype=bool), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    raw = connected_components(graph, directed=False)[1]
    _, first, inverse = np.unique(raw, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[inverse]


def area_order(areas: Float[np.ndarray, "faces"], tie: float = TIE) -> Int[np.ndarray, "faces"]:
    """Face indices by falling area; areas within a fraction `tie` of the largest of their run keep the given order."""
    falling = np.argsort(-areas, kind="stable")
    order: list[int] = []
    run: list[int] = []
    for face in falling.tolist():
        if run and areas[face] < (1.0 - tie) * areas[run[0]]:
            order += sorted(run)
            run = []
        run.append(face)
    return np.array(order + sorted(run), dtype=np.int64)


def assemble_part(
    name: str,
    vertices: Float[np.ndarray, "vertices 3"],
    triangles: Int[np.ndarray, "triangles 3"],
    label: Int[np.ndarray, "triangles"],
    types: list[str] | tuple[str, ...],
    unit: str = "mm",
    identifying: Sequence[int] | None = None,
) -> Part:
    """A Part from welded triangles and a label 0.. per triangle; `types[label]` and `identifying` index the labels.

    Labels are renumbered by falling area, ties in the order of the labels; a closed mesh wound inward is flipped.
    """
    if signed_volume(vertices, triangles) < 0.0:
        triangles = triangles[:, ::-1]
    areas = np.bincount(label, weights=triangle_areas(vertices, triangles), minlength=len(types))
    order = area_order(areas)
    rank = np.argsort(order)
    named = None if identifying is None else tuple(sorted(int(rank[k]) for k in identifying))
    return Part(
        name=name,
        vertices=np.ascontiguousarray(vertices, dtype=np.float64),
        triangles=np.ascontiguousarray(triangles, dtype=np.int64),
        face_of_triangle=rank[label],
        face_types=tuple(types[k] for k in order.tolist()),
        face_areas=areas[order],
        unit=unit,
        diameter=diameter(vertices),
        watertight=is_watertight(triangles),
        identifying_faces=named,
    )
