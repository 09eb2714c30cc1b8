"""Coplanar triangles joined into flat facets, and the graph of facets across their shared edges."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from itree_cad.assemble import components, shared_edges

FLAT_ANGLE = np.radians(0.05)  # triangles this parallel are one facet: rounding in a 32-bit STL stays below
FLAT_DISTANCE = 2e-6  # of the diameter: narrow triangles have noisy normals, but their far corner lies in the plane
NOISY_ANGLE = np.radians(5.0)  # how noisy the normal of such a triangle may be
PLANE_DISTANCE = 1e-5  # of the diameter: how far a facet's vertices may leave its plane


@dataclass(frozen=True)
class Facets:
    """Flat facets of a mesh and their neighbours."""

    of_triangle: Int[np.ndarray, "triangles"]
    area: Float[np.ndarray, "facets"]  # [mm^2]
    centre: Float[np.ndarray, "facets 3"]  # [mm]
    normal: Float[np.ndarray, "facets 3"]  # unit, outward
    vertex: Int[np.ndarray, "entries"]  # vertices of facet k: vertex[start[k]:start[k + 1]]
    start: Int[np.ndarray, "facets_plus_1"]
    pair: Int[np.ndarray, "edges 2"]  # neighbouring facets
    angle: Float[np.ndarray, "edges"]  # between their normals [rad]
    length: Float[np.ndarray, "edges"]  # of their common border [mm]

    def vertices_of(self, facets: Int[np.ndarray, "n"]) -> Int[np.ndarray, "m"]:
        """The distinct vertices of some facets."""
        return np.unique(np.concatenate([self.vertex[self.start[k] : self.start[k + 1]] for k in facets]))


def _triangle_frames(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    double = np.linalg.norm(cross, axis=1)
    return 0.5 * double, cross / np.where(double > 0.0, double, 1.0)[:, None], (a + b + c) / 3.0


def _flat_groups(
    vertices: np.ndarray, triangles: np.ndarray, pairs: np.ndarray, edges: np.ndarray, diameter: float
) -> np.ndarray:
    """Label per triangle: triangles joined across edges that do not bend."""
    area, normal, _ = _triangle_frames(vertices, triangles)
    longest = np.linalg.norm(vertices[triangles] - vertices[np.roll(triangles, 1, axis=1)], axis=2).max(axis=1)
    sliver = 2.0 * area <= FLAT_DISTANCE * diameter * longest
    swap = area[pairs[:, 0]] > area[pairs[:, 1]]
    small, large = np.where(swap, pairs[:, 1], pairs[:, 0]), np.where(swap, pairs[:, 0], pairs[:, 1])
    far_corner = vertices[triangles[small].sum(axis=1) - edges.sum(axis=1)]
    off_plane = np.abs(((far_corner - vertices[edges[:, 0]]) * normal[large]).sum(axis=1))
    bend = np.linalg.norm(normal[small] - normal[large], axis=1)
    flat = (bend < FLAT_ANGLE) | ((off_plane < FLAT_DISTANCE * diameter) & (bend < NOISY_ANGLE))
    flat &= ~sliver[pairs].any(axis=1)
    label = components(len(triangles), np.concatenate([pairs[flat], _sliver_hosts(pairs, bend, sliver)]))
    label = _flattened(vertices, triangles, label, area, normal, diameter)
    return components(len(triangles), pairs[label[pairs[:, 0]] == label[pairs[:, 1]]])


def _sliver_hosts(pairs: np.ndarray, bend: np.ndarray, sliver: np.ndarray) -> np.ndarray:
    """A sliver has no reliable normal: it joins the one neighbour that it bends least from, and bridges nothing."""
    either_way = np.concatenate([pairs, pairs[:, ::-1]])
    bend = np.concatenate([bend, bend])
    order = np.lexsort((bend, sliver[either_way[:, 1]]))
    either_way = either_way[order][sliver[either_way[order, 0]]]
    return either_way[np.unique(either_way[:, 0], return_index=True)[1]]


def _flattened(
    vertices: np.ndarray,
    triangles: np.ndarray,
    label: np.ndarray,
    area: np.ndarray,
    normal: np.ndarray,
    diameter: float,
) -> np.ndarray:
    """Groups that drift out of their plane (a finely cut cylinder is a chain of flat steps) are cut into flat ones."""
    corners = vertices[triangles]
    order = np.argsort(label, kind="stable")
    first = np.searchsorted(label[order], np.arange(int(label.max()) + 2))
    fresh = int(label.max()) + 1
    label = label.copy()
    for group in np.flatnonzero(np.diff(first) > 1).tolist():
        members = order[first[group] : first[group + 1]]
        limit = PLANE_DISTANCE * diameter  # a group in one plane is kept, even with a little noise
        while len(members):
            seed = members[np.argmax(area[members])]
            flat = np.abs((corners[members] - corners[seed, 0]) @ normal[seed]).max(axis=1) <= limit
            flat |= members == seed
            if limit != PLANE_DISTANCE * diameter or flat.all():
                label[members[flat]] = fresh
                fresh += 1
                members = members[~flat]
            limit = FLAT_DISTANCE * diameter
    return label


def flat_facets(
    vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "triangles 3"], diameter: float
) -> Facets:
    """The facets of a welded mesh, lengths [mm]."""
    pairs, edges = shared_edges(triangles)
    label = _flat_groups(vertices, triangles, pairs, edges, diameter)
    area, normal, centre = _triangle_frames(vertices, triangles)
    count = int(label.max()) + 1
    weight = np.bincount(label, weights=area, minlength=count)
    safe = np.where(weight > 0.0, weight, 1.0)
    mean = [np.stack([np.bincount(label, weights=area * v[:, k], minlength=count) for k in range(3)], 1) / safe[:, None]
            for v in (normal, centre)]  # fmt: skip
    mean[0] /= np.maximum(np.linalg.norm(mean[0], axis=1), 1e-300)[:, None]
    member = np.unique(np.c_[np.repeat(label, 3), triangles.reshape(-1)], axis=0)
    start = np.searchsorted(member[:, 0], np.arange(count + 1))
    between = label[pairs[:, 0]] != label[pairs[:, 1]]
    keys, inverse = np.unique(np.sort(label[pairs[between]], axis=1), axis=0, return_inverse=True)
    ends = vertices[edges[between]]
    length = np.bincount(
        inverse.reshape(-1), weights=np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1), minlength=len(keys)
    )
    cosine = (mean[0][keys[:, 0]] * mean[0][keys[:, 1]]).sum(axis=1)
    return Facets(
        label, weight, mean[1], mean[0], member[:, 1], start, keys, np.arccos(np.clip(cosine, -1.0, 1.0)), length
    )
