"""Laws of the bundled parts and of CSG with labelled surfaces."""

import numpy as np
import pytest
import trimesh
from itree_cad.bundled import BUNDLED_PARTS, bundled_part, part_from_solid
from itree_cad.csg import box, cylinder
from itree_cad.load import load_part
from itree_cad.surfaces import fit_plane
from itree_kernels.errors import ItreeError

from ..primitives import box_part, cone_part, cylinder_part, sphere_part, torus_part


@pytest.mark.parametrize("name", BUNDLED_PARTS)
def test_bundled_parts_are_closed_solids_of_machine_part_size(name):
    part = bundled_part(name)
    mesh = trimesh.Trimesh(part.vertices, part.triangles, process=False)
    assert part.watertight
    assert mesh.is_volume
    assert mesh.volume > 0.0
    assert mesh.body_count == 1
    assert 40.0 <= part.diameter <= 100.0
    assert part.name == name
    assert load_part(f"bundled:{name}").face_types == part.face_types


@pytest.mark.parametrize("name", BUNDLED_PARTS)
def test_faces_partition_the_surface_in_area_order(name):
    part = bundled_part(name)
    mesh = trimesh.Trimesh(part.vertices, part.triangles, process=False)
    np.testing.assert_allclose(np.bincount(part.face_of_triangle, weights=mesh.area_faces), part.face_areas, rtol=1e-12)
    assert (np.diff(part.face_areas) <= 1e-4 * part.face_areas[:-1]).all()
    for face, kind in enumerate(part.face_types):
        points = part.vertices[np.unique(part.triangles[part.face_of_triangle == face])]
        flat = np.abs(fit_plane(points).distance(points)).max() < 1e-6
        assert flat == (kind == "plane")


def test_the_diameter_is_the_largest_distance_of_two_vertices():
    part = bundled_part("bracket")
    distances = np.linalg.norm(part.vertices[:, None] - part.vertices[None], axis=2)
    assert part.diameter == pytest.approx(distances.max(), rel=1e-12)


def test_primitives_have_closed_forms():
    n = 96
    chord, sector = 2.0 * n * np.sin(np.pi / n), 0.5 * n * np.sin(2.0 * np.pi / n)
    np.testing.assert_allclose(box_part(2.0, 3.0, 4.0).face_areas, [12.0, 12.0, 8.0, 8.0, 6.0, 6.0], rtol=1e-12)
    np.testing.assert_allclose(
        cylinder_part(5.0, 20.0, n).face_areas, [5.0 * 20.0 * chord, 25.0 * sector, 25.0 * sector], rtol=1e-12
    )
    assert cylinder_part(5.0, 20.0).face_types == ("cylinder", "plane", "plane")
    slant = np.hypot(12.0, 5.0 * np.cos(np.pi / n))
    np.testing.assert_allclose(cone_part(5.0, 0.0, 12.0, n).face_areas[0], 0.5 * 5.0 * slant * chord, rtol=1e-12)
    np.testing.assert_allclose(sphere_part(5.0).face_areas, [4.0 * np.pi * 25.0], rtol=2e-3)
    np.testing.assert_allclose(torus_part(20.0, 5.0).face_areas, [4.0 * np.pi**2 * 100.0], rtol=2e-3)


def test_a_hole_leaves_its_wall_and_takes_its_area_from_the_plane():
    hole = cylinder(4.0, -1.0, 6.0, "hole").moved(x=20.0, y=15.0)
    plate = part_from_solid("plate", box((0.0, 0.0, 0.0), (40.0, 30.0, 5.0), "box") - hole)
    disc = 0.5 * 96 * 16.0 * np.sin(2.0 * np.pi / 96)
    np.testing.assert_allclose(plate.face_areas[:2], 1200.0 - disc, rtol=1e-12)
    assert plate.face_types.count("cylinder") == 1
    wall = plate.face_types.index("cylinder")
    np.testing.assert_allclose(plate.face_areas[wall], 8.0 * 96 * np.sin(np.pi / 96) * 5.0, rtol=1e-12)


def test_a_slot_cuts_one_surface_into_two_faces():
    slot = box((-2.0, -11.0, 15.0), (2.0, 11.0, 21.0), "slot")
    halves = part_from_solid("halves", cylinder(10.0, 0.0, 20.0, "post") - slot)
    assert halves.face_types.count("cylinder") == 1
    tops = [
        face
        for face in range(halves.face_count)
        if (halves.vertices[halves.triangles[halves.face_of_triangle == face]][..., 2] == 20.0).all()
    ]
    assert len(tops) == 2


def test_an_unknown_name_lists_the_names():
    with pytest.raises(ItreeError, match="ikeuchi-1987, bracket, clevis"):
        bundled_part("widget")
