"""Fewer triangles: no surface moves by more than it may, and a mesh that isn't closed stays as it is."""

import numpy as np
import pytest
import trimesh
from itree_cad.bundled import BUNDLED_PARTS, bundled_part
from itree_cad.decimate import coarser

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
