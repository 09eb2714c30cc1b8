"""Component faces of a mesh without a B-rep: flat facets grown into planes, cylinders, cones, spheres, tori.

The small patches that approximate a cylinder are one face (Ikeuchi 1987, sec. 2.1.1). Dihedral angles alone cannot
tell a plane from the cylinder that it meets tangentially, but the vertices can: a tessellation puts them on the
surface, so those of the tangent plane leave the cylinder at once. Each facet proposes surfaces fitted to its
neighbourhood, each proposal grows over smooth edges, and the proposals that cover the most area take their facets.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from itree_cad.assemble import components
from itree_cad.facets import Facets, flat_facets
from itree_cad.surfaces import FittedSurface, chord_band, fit_curved

SMOOTH_ANGLE = np.radians(26.0)  # facets of one curved face bend less: a circle of 14 sides or more
ON_SURFACE = 2e-5  # of the diameter: vertices of a tessellation lie on its surface, to rounding
SIMILAR = 3.0  # neighbours in one tessellation have widths within this factor
WIDEST = 2.5  # a facet may turn at most this much more than its face's typical facet
SEED_SIZES = (9, 25)  # facets around a seed: enough for a cylinder or cone, enough for a torus
KINDS = {9: ("cylinder", "cone", "sphere"), 25: ("cylinder", "cone", "sphere", "torus")}
FEWEST_CURVED = 3  # facets: two strips lie on some cylinder whatever they are
FEWEST_FREEFORM = 5
RIM = 0.3  # of a freeform patch's area: a smooth neighbour this small is part of it, a larger one a plane beside it
SPECK = 1e-6  # of the square of the diameter: faces smaller than this are artefacts of a cut
MOST_FAILURES = 100  # seeds without a surface after which the rest is left to the freeform faces
SIMPLER_WINS = 1.02  # a type with more parameters must cover this much more area


@dataclass(frozen=True)
class _Proposal:
    type: str
    facets: Int[np.ndarray, "n"]
    area: float


def recover_faces(
    vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "triangles 3"], diameter: float
) -> tuple[Int[np.ndarray, "triangles"], tuple[str, ...]]:
    """Face label 0.. per triangle of a welded mesh and the type of each face; lengths and diameter in [mm]."""
    facets = flat_facets(vertices, triangles, diameter)
    face, types = _Grower(vertices, facets, diameter).grow()
    used, label = np.unique(face[facets.of_triangle], return_inverse=True)
    return label, tuple(types[k] for k in used)


class _Grower:
    """The search over one mesh: what neighbours what, and how far a proposal reaches."""

    def __init__(self, vertices: np.ndarray, facets: Facets, diameter: float):
        self.vertices, self.facets, self.diameter = vertices, facets, diameter
        self.tolerance = ON_SURFACE * diameter
        self.count = len(facets.area)
        pair = facets.pair
        self.smooth = pair[facets.angle < SMOOTH_ANGLE]
        width = facets.area[pair] / facets.length[:, None]
        alike = (width.max(axis=1) <= SIMILAR * width.min(axis=1)) & (facets.angle < SMOOTH_ANGLE)
        self.alike = pair[alike]
        smooth_label = components(self.count, self.smooth)
        self.reachable = np.bincount(smooth_label, weights=facets.area)[smooth_label]
        self.neighbours: list[list[int]] = [[] for _ in range(self.count)]
        for a, b in self.alike.tolist():
            self.neighbours[a].append(b)
            self.neighbours[b].append(a)

    def grow(self) -> tuple[np.ndarray, list[str]]:
        face = np.full(self.count, -1, dtype=np.int64)
        types: list[str] = []
        for _ in range(4):  # facets lost to a better proposal propose again
            taken = False
            for proposal in sorted(self._proposals(face < 0), key=lambda p: -p.area):
                left = proposal.facets[face[proposal.facets] < 0]
                if len(left) < FEWEST_CURVED or self.facets.area[left].sum() < 0.9 * proposal.area:
                    continue
                face[left] = len(types)
                types.append(proposal.type)
                taken = True
            if not taken:
                break
        return self._leftovers(face, types)

    def _proposals(self, free: np.ndarray) -> list[_Proposal]:
        """One proposal per surface: facets that a proposal covers do not seed another."""
        unseen = free & (np.bincount(self.alike.reshape(-1), minlength=self.count) > 0)
        proposals: list[_Proposal] = []
        failures = 0
        for seed in np.argsort(-self.facets.area, kind="stable").tolist():
            if not unseen[seed] or failures >= MOST_FAILURES:
                continue
            unseen[seed] = False
            best = self._best_from(seed, free)
            if best is None:
                failures += 1
            else:
                proposals.append(best)
                unseen[best.facets] = False
        return proposals

    def _best_from(self, seed: int, free: np.ndarray) -> _Proposal | None:
        best: _Proposal | None = None
        for size in SEED_SIZES:
            around = self._around(seed, size, free)
            if len(around) < FEWEST_CURVED:
                break
            for kind in KINDS[size]:
                found = self._grown(kind, seed, around, free)
                if found is not None and (best is None or found.area > SIMPLER_WINS * best.area):
                    best = found
                    if SIMPLER_WINS * best.area > self.reachable[seed]:
                        return best  # no other type can win
        return best

    def _around(self, seed: int, size: int, free: np.ndarray) -> np.ndarray:
        """The nearest facets of similar width, breadth first."""
        found, queue = {seed}, [seed]
        for facet in queue:
            for other in self.neighbours[facet]:
                if other not in found and free[other] and len(found) < size:
                    found.add(other)
                    queue.append(other)
        return np.array(queue)

    def _fit(self, kind: str, facets: np.ndarray) -> FittedSurface | None:
        f = self.facets
        points = self.vertices[f.vertices_of(facets)]
        return fit_curved(
            kind, points, f.centre[facets], f.normal[facets], f.area[facets], self.tolerance, self.diameter
        )

    def _grown(self, kind: str, seed: int, around: np.ndarray, free: np.ndarray) -> _Proposal | None:
        region = around
        for _ in range(8):  # refitting to a larger region extends its reach
            surface = self._fit(kind, region)
            if surface is None:
                return None
            reached = self._reach(surface, seed, region, free)
            if len(reached) < FEWEST_CURVED:
                return None
            if np.array_equal(reached, region):
                break
            region = reached
        return _Proposal(kind, region, float(self.facets.area[region].sum()))

    def _reach(self, surface: FittedSurface, seed: int, region: np.ndarray, free: np.ndarray) -> np.ndarray:
        """Facets joined to the seed by smooth edges whose vertices lie on the surface and that turn like others."""
        f = self.facets
        lowest, highest = chord_band(surface, surface.distance(f.centre[region]), f.area[region], self.tolerance)
        distance = surface.distance(self.vertices)[f.vertex]
        near = free & (np.maximum.reduceat(distance, f.start[:-1]) <= highest)
        near &= np.minimum.reduceat(distance, f.start[:-1]) >= lowest
        normal = surface.normal(self.vertices)[f.vertex]
        owner = np.repeat(np.arange(self.count), np.diff(f.start))
        turn = np.minimum.reduceat(np.abs((normal * f.normal[owner]).sum(axis=1)), f.start[:-1])
        turn = np.arccos(np.clip(turn, 0.0, 1.0))
        typical = _weighted_median(turn[region], f.area[region])
        near &= turn <= WIDEST * typical + np.radians(1.0)
        if not near[seed]:
            return np.zeros(0, dtype=np.int64)
        label = components(self.count, self.smooth[near[self.smooth].all(axis=1)])
        return np.flatnonzero((label == label[seed]) & near)

    def _leftovers(self, face: np.ndarray, types: list[str]) -> tuple[np.ndarray, list[str]]:
        """What no surface took: many small smooth facets are a freeform face, anything else is a plane."""
        f, free = self.facets, face < 0
        smooth = self.smooth[free[self.smooth].all(axis=1)]
        label = components(self.count, self.alike[free[self.alike].all(axis=1)])
        patch = free & (np.bincount(label)[label] >= FEWEST_FREEFORM)
        for _ in range(4):  # a patch takes the odd facets at its rim, and patches that touch smoothly are one
            area = np.bincount(label, weights=f.area)[label]
            rim = patch[smooth] & ~patch[smooth[:, ::-1]] & (area[smooth[:, ::-1]] < RIM * area[smooth])
            joined = smooth[rim.any(axis=1) | patch[smooth].all(axis=1)]
            patch[joined] = True
            label = components(self.count, np.concatenate([joined, self.alike[patch[self.alike].all(axis=1)]]))
        for group in np.unique(label[free]).tolist():
            members = np.flatnonzero((label == group) & free)
            face[members] = len(types)
            types.append("freeform" if len(members) > 1 else "plane")
        return self._absorbed(face), types

    def _absorbed(self, face: np.ndarray) -> np.ndarray:
        """Specks too small to see join the face with which they share the longest border."""
        face = face.copy()
        for _ in range(8):  # a speck inside a patch of specks waits for its neighbours
            areas = np.bincount(face, weights=self.facets.area)
            speck = areas[face] < SPECK * self.diameter**2
            pair = np.concatenate([self.facets.pair, self.facets.pair[:, ::-1]])
            length = np.concatenate([self.facets.length, self.facets.length])
            useful = speck[pair[:, 0]] & ~speck[pair[:, 1]]
            if not useful.any():
                break
            order = np.lexsort((-length[useful], pair[useful, 0]))
            small, first = np.unique(pair[useful, 0][order], return_index=True)
            face[small] = face[pair[useful, 1][order][first]]
        return face


def _weighted_median(values: np.ndarray, weights: np.ndarray) -> float:
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])
