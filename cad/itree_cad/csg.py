"""Solids by constructive geometry whose triangles remember the surface that they were cut from.

A profile is a closed polygon whose edges are labelled with a `Surface`; extruding it or turning it about an axis makes
a solid; adding and subtracting solids keeps the labels, because manifold3d carries the source of every triangle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import manifold3d
import numpy as np
from jaxtyping import Float, Int

SEGMENTS = 96  # facets per turn: 3.75 degrees, so that a facet's normal is within 1.9 degrees of the true one


class Surface(NamedTuple):
    """The surface that a triangle belongs to. Adjacent triangles of one *name* are one component face."""

    type: str  # one of part.FACE_TYPES
    name: str


class Edge(NamedTuple):
    """One vertex of a profile and the surface swept by the edge that leaves it."""

    u: float  # x of an extrusion, radius of a lathe [mm]
    v: float  # y of an extrusion, z of a lathe [mm]
    surface: Surface


@dataclass(frozen=True)
class Solid:
    """A closed solid and the surface of each (original id, face id) that manifold3d hands through."""

    manifold: manifold3d.Manifold
    surfaces: dict[tuple[int, int], Surface]

    def __add__(self, other: Solid) -> Solid:
        return Solid(self.manifold + other.manifold, self.surfaces | other.surfaces)

    def __sub__(self, other: Solid) -> Solid:
        return Solid(self.manifold - other.manifold, self.surfaces | other.surfaces)

    def __and__(self, other: Solid) -> Solid:
        return Solid(self.manifold ^ other.manifold, self.surfaces | other.surfaces)

    def turned(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Solid:
        """Rotated about the axes x, then y, then z [degrees]; multiples of 90 are exact."""
        return Solid(self.manifold.rotate((x, y, z)), self.surfaces)

    def moved(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Solid:
        """Translated [mm]."""
        return Solid(self.manifold.translate((x, y, z)), self.surfaces)

    def labelled_triangles(
        self,
    ) -> tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "triangles 3"], list[Surface]]:
        """Vertices [mm], outward triangles, and the surface of each triangle."""
        mesh = self.manifold.to_mesh64()
        triangles = np.array(mesh.tri_verts, dtype=np.int64)
        runs = np.diff(np.asarray(mesh.run_index, dtype=np.int64)) // 3
        original = np.repeat(np.asarray(mesh.run_original_id, dtype=np.int64), runs)
        surfaces = [
            self.surfaces[key] for key in zip(original.tolist(), np.asarray(mesh.face_id).tolist(), strict=True)
        ]
        vertices = np.array(mesh.vert_properties, dtype=np.float64)  # a copy: a view would keep the mesh object alive
        return vertices[:, :3], triangles, surfaces


def _solid(vertices: np.ndarray, triangles: np.ndarray, surfaces: Sequence[Surface]) -> Solid:
    """A manifold3d original whose face ids index the distinct surfaces."""
    distinct = list(dict.fromkeys(surfaces))
    face_id = np.array([distinct.index(surface) for surface in surfaces], dtype=np.uint64)
    original = manifold3d.Manifold.reserve_ids(1)
    mesh = manifold3d.Mesh64(
        vert_properties=np.ascontiguousarray(vertices, dtype=np.float64),
        tri_verts=np.ascontiguousarray(triangles, dtype=np.uint64),
        run_index=np.array([0, 3 * len(triangles)], dtype=np.uint64),
        run_original_id=np.array([original], dtype=np.uint32),
        face_id=face_id,
    )
    manifold = manifold3d.Manifold(mesh)
    if manifold.status() != manifold3d.Error.NoError or manifold.volume() <= 0:
        raise ValueError(f"the profile does not make a solid: {manifold.status()}, volume {manifold.volume()}")
    return Solid(manifold, {(original, index): surface for index, surface in enumerate(distinct)})


def extrude(profile: Sequence[Edge], z0: float, z1: float, bottom: Surface, top: Surface) -> Solid:
    """The profile (counter-clockwise in x, y) swept along z from z0 to z1 [mm]."""
    outline = np.array([(edge.u, edge.v) for edge in profile])
    n = len(outline)
    vertices = np.concatenate([np.c_[outline, np.full(n, z0)], np.c_[outline, np.full(n, z1)]])
    cap = np.asarray(manifold3d.triangulate([outline]), dtype=np.int64)
    here, after = np.arange(n), np.roll(np.arange(n), -1)
    sides = np.concatenate([np.c_[here, after, after + n], np.c_[here, after + n, here + n]])
    side_surfaces = [edge.surface for edge in profile]
    triangles = np.concatenate([sides, cap[:, ::-1], cap + n])
    return _solid(vertices, triangles, side_surfaces * 2 + [bottom] * len(cap) + [top] * len(cap))


def lathe(profile: Sequence[Edge], segments: int = SEGMENTS) -> Solid:
    """The profile in (radius, z), counter-clockwise with the radius to the right, turned about the z axis.

    Points with radius 0 lie on the axis. The first facet starts at +x.
    """
    angle = 2.0 * np.pi * np.arange(segments) / segments
    radius = np.array([edge.u for edge in profile])
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    rings = radius[:, None, None] * ring
    z = np.broadcast_to(np.array([edge.v for edge in profile])[:, None, None], (len(profile), segments, 1))
    vertices = np.concatenate([rings, z], axis=-1).reshape(-1, 3)
    index = np.arange(len(profile) * segments).reshape(len(profile), segments)
    index[radius == 0.0] = index[radius == 0.0][:, :1]  # one vertex where the profile touches the axis
    triangles: list[np.ndarray] = []
    surfaces: list[Surface] = []
    for here, edge in enumerate(profile):
        a, b = index[here], index[(here + 1) % len(profile)]
        quads = np.concatenate([np.c_[a, np.roll(a, -1), np.roll(b, -1)], np.c_[a, np.roll(b, -1), b]])
        whole = (quads[:, 0] != quads[:, 1]) & (quads[:, 1] != quads[:, 2]) & (quads[:, 2] != quads[:, 0])
        triangles.append(quads[whole])
        surfaces += [edge.surface] * int(whole.sum())
    used, packed = np.unique(np.concatenate(triangles), return_inverse=True)
    return _solid(vertices[used], packed.reshape(-1, 3), surfaces)


def arc(
    centre: tuple[float, float], radius: float, start: float, stop: float, surface: Surface, segments: int = SEGMENTS
) -> list[Edge]:
    """Profile edges along an arc from angle `start` to `stop` [degrees]; its end point begins the next edge."""
    count = max(2, int(np.ceil(abs(stop - start) * segments / 360.0 - 1e-9)))
    angle = np.radians(np.linspace(start, stop, count + 1)[:-1])
    points = np.stack([centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle)], axis=-1)
    return [Edge(u, v, surface) for u, v in points.tolist()]


def polygon(points: Sequence[tuple[float, float]], name: str) -> list[Edge]:
    """Profile edges that each sweep a plane of its own, named `name` 0, 1, ..."""
    return [Edge(u, v, Surface("plane", f"{name} {index}")) for index, (u, v) in enumerate(points)]


def box(low: tuple[float, float, float], high: tuple[float, float, float], name: str) -> Solid:
    """An upright box between two corners [mm]."""
    outline = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
    bottom, top = Surface("plane", f"{name} bottom"), Surface("plane", f"{name} top")
    return extrude(polygon(outline, name), low[2], high[2], bottom, top)


def cylinder(radius: float, z0: float, z1: float, name: str, segments: int = SEGMENTS) -> Solid:
    """A cylinder about the z axis [mm]; its wall is the surface `name`, its ends `name bottom` and `name top`."""
    return lathe(
        [
            Edge(0.0, z0, Surface("plane", f"{name} bottom")),
            Edge(radius, z0, Surface("cylinder", name)),
            Edge(radius, z1, Surface("plane", f"{name} top")),
            Edge(0.0, z1, Surface("plane", f"{name} axis")),
        ],
        segments,
    )
