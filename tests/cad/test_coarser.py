"""Fewer triangles: no surface moves by more than it may, and a mesh that isn't closed stays as it is."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from itree_cad import decimate
from itree_cad.bundled import BUNDLED_PARTS, bundled_part
from itree_cad.decimate import UNSEEN, coarser, lean
from itree_cad.load import load_part
from itree_cad.part import Part

RADIUS, HEIGHT = 20.0, 50.0  # [mm]


@pytest.mark.parametrize("tolerance", [0.1, 0.5, 2.0])
def test_a_cylinder_keeps_as_many_lines_as_its_sagitta_asks_for(tolerance):
    fine = trimesh.creation.cylinder(RADIUS, HEIGHT, sections=256)
    vertices, triangles = coarser(np.asarray(fine.vertices), np.asarray(fine.faces), tolerance)
    around = vertices[np.linalg.norm(vertices[:, :2], axis=1) > 0.5 * RADIUS]
    np.testing.assert_allclose(np.linalg.norm(around[:, :2], axis=1), RADIUS, rtol=1e-6)  # corners stay
    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    assert mesh.is_watertight
    assert len(triangles) < 0.5 * len(fine.faces)
    side = np.abs(mesh.face_normals[:, 2]) < 0.1
    middles = mesh.triangles[side].mean(axis=1)
    assert np.linalg.norm(middles[:, :2], axis=1).min() > RADIUS - 1.01 * tolerance


@pytest.mark.parametrize("name", BUNDLED_PARTS)
def test_parts_keep_their_size_on_a_fraction_of_their_triangles(name):
    part = bundled_part(name)
    tolerance = 0.005 * part.diameter
    vertices, triangles = coarser(np.asarray(part.vertices), np.asarray(part.triangles), tolerance)
    mesh, whole = (
        trimesh.Trimesh(*of, process=False) for of in ((vertices, triangles), (part.vertices, part.triangles))
    )
    assert len(triangles) < 0.4 * len(part.triangles)
    np.testing.assert_allclose(mesh.bounds, whole.bounds, atol=tolerance)
    assert abs(mesh.volume - whole.volume) < tolerance * whole.area


def test_a_mesh_with_a_hole_stays_as_it_is():
    ball = trimesh.creation.icosphere(subdivisions=3)
    vertices, triangles = np.asarray(ball.vertices), np.asarray(ball.faces)[1:]
    assert coarser(vertices, triangles, 0.1)[1] is triangles


def test_a_mesh_of_which_nothing_would_be_left_stays_as_it_is():
    ball = trimesh.creation.icosphere(subdivisions=3)
    triangles = np.asarray(ball.faces)
    assert len(coarser(np.asarray(ball.vertices), triangles, 10.0)[1]) > 0


@pytest.fixture(scope="module")
def finely_cut(tmp_path_factory) -> Part:
    """A cylinder of far more triangles than its sagitta asks for, and planes of many."""
    path = tmp_path_factory.mktemp("finely-cut") / "cylinder.stl"
    trimesh.creation.cylinder(RADIUS, HEIGHT, sections=720).export(path)
    return load_part(path, units="mm")


def test_a_lean_part_keeps_its_faces_on_a_fraction_of_its_triangles(finely_cut):
    few = lean(finely_cut)
    assert len(few.triangles) < 0.5 * len(finely_cut.triangles)
    mesh = trimesh.Trimesh(few.vertices, few.triangles, process=False)
    assert mesh.is_watertight
    area = np.bincount(few.face_of_triangle, mesh.area_faces)
    np.testing.assert_allclose(area, finely_cut.face_areas, rtol=1e-3)
    sides = few.face_of_triangle == finely_cut.face_types.index("cylinder")
    assert (np.abs(mesh.face_normals[sides, 2]) < 1e-6).all()
    middles = np.linalg.norm(mesh.triangles[sides].mean(axis=1)[:, :2], axis=1)
    assert middles.min() > RADIUS - 1.01 * UNSEEN * finely_cut.diameter - RADIUS * (1.0 - np.cos(np.pi / 720))


@pytest.mark.parametrize("name", BUNDLED_PARTS)
def test_lean_parts_have_every_face_where_it_was(name):
    part = bundled_part(name)
    few = lean(part)
    assert np.array_equal(np.unique(few.face_of_triangle), np.unique(part.face_of_triangle))
    for face in np.unique(part.face_of_triangle):
        bounds = [
            np.asarray(p.vertices)[p.triangles[p.face_of_triangle == face]].reshape(-1, 3) for p in (few, part)
        ]
        np.testing.assert_allclose(bounds[0].min(axis=0), bounds[1].min(axis=0), atol=2.0 * UNSEEN * part.diameter)
        np.testing.assert_allclose(bounds[0].max(axis=0), bounds[1].max(axis=0), atol=2.0 * UNSEEN * part.diameter)


def test_a_part_that_would_lose_a_face_or_is_not_closed_stays_as_it_is(finely_cut, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setattr(decimate, "UNSEEN", 0.1)  # grooves are no deeper
        grooved = bundled_part("ikeuchi-1987")
        assert lean(grooved) is grooved
    opened = replace(
        finely_cut, triangles=finely_cut.triangles[1:], face_of_triangle=finely_cut.face_of_triangle[1:]
    )
    assert lean(opened) is opened
