"""Laws of the convex pieces: they are convex, they cover the part, and they keep what is concave about it."""

from dataclasses import replace

import manifold3d
import numpy as np
import pytest
from itree_cad.bundled import bundled_part, part_from_solid
from itree_cad.csg import box
from scipy.spatial import ConvexHull

from itree_jax.simulate.decompose import MAX_PIECES, convex_pieces

from ..primitives import box_part, sphere_part


def manifold_of(part) -> manifold3d.Manifold:
    mesh = manifold3d.Mesh64(np.array(part.vertices, np.float64), np.array(part.triangles, np.uint64))
    mesh.merge()
    return manifold3d.Manifold(mesh)


def union_of(pieces) -> manifold3d.Manifold:
    hulls = [manifold3d.Manifold.hull_points(points) for points in pieces]
    return manifold3d.Manifold.batch_boolean(hulls, manifold3d.OpType.Add)


@pytest.mark.parametrize("part", [box_part(30, 20, 10), sphere_part(10)])
def test_a_convex_part_is_one_piece(part):
    pieces = convex_pieces(part)
    assert len(pieces) == 1
    assert ConvexHull(pieces[0]).volume == pytest.approx(ConvexHull(part.vertices).volume, rel=1e-3)


def test_an_angle_is_two_boxes():
    part = part_from_solid("angle", box((0, 0, 0), (40, 20, 5), "foot") + box((0, 0, 0), (5, 20, 30), "back"))
    volumes = sorted(ConvexHull(points).volume for points in convex_pieces(part))
    assert sum(volumes) == pytest.approx(40 * 20 * 5 + 5 * 20 * 25)
    assert len(volumes) == 2


@pytest.mark.parametrize("name", ["ikeuchi-1987", "clevis"])
def test_the_pieces_cover_the_part_and_little_more(name):
    part = bundled_part(name)
    pieces = convex_pieces(part)
    solid, union = manifold_of(part), union_of(pieces)
    assert len(pieces) <= MAX_PIECES + 3
    assert (solid - union).volume() < 1e-3 * solid.volume()
    assert union.volume() < 1.12 * solid.volume() < solid.hull().volume() / 1.2


def test_an_open_mesh_is_its_hull():
    part = bundled_part("clevis")
    pieces = convex_pieces(replace(part, triangles=part.triangles[1:]))
    assert len(pieces) == 1
    assert ConvexHull(pieces[0]).volume == pytest.approx(ConvexHull(part.vertices).volume, rel=1e-6)
