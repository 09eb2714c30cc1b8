"""The object of Ikeuchi 1987: its eight named faces, their areas and their order."""

import numpy as np
import trimesh
from itree_cad.bundled import bundled_part
from itree_cad.surface_distance import SurfaceDistance, surface_sample


def face_centroid(part, face):
    mine = part.face_of_triangle == face
    corners = part.vertices[part.triangles[mine]]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return areas @ corners.mean(axis=1) / areas.sum()


def test_the_named_faces_have_the_papers_areas_in_the_papers_order():
    part = bundled_part("ikeuchi-1987")
    named = list(part.identifying_faces)
    assert named == sorted(named)
    expected = [1738, 1654, 1117, 922, 489, 489, 414, 414]
    np.testing.assert_array_equal(part.face_areas[named].round(), expected)


def test_the_named_faces_are_the_described_surfaces():
    part = bundled_part("ikeuchi-1987")
    f1, f2, f3, f4, f5, f6, f7, f8 = part.identifying_faces
    kinds = [part.face_types[face] for face in part.identifying_faces]
    assert kinds == ["cylinder", "cylinder", "plane", "freeform", "plane", "plane", "plane", "plane"]
    assert face_centroid(part, f1)[0] < -20.0 < 20.0 < face_centroid(part, f2)[0]
    np.testing.assert_allclose(face_centroid(part, f3), [0.0, 0.0, 17.5], atol=0.1)
    assert -30.0 < face_centroid(part, f4)[0] < -24.5  # the hole: floor and wall together
    assert face_centroid(part, f5)[2] > 3.5 > -3.5 > face_centroid(part, f6)[2]  # half discs on either side of the slot
    assert face_centroid(part, f7)[1] == 17.0
    assert face_centroid(part, f8)[1] == -17.0


def test_the_part_has_the_dimensions_of_the_reconstruction():
    part = bundled_part("ikeuchi-1987")
    np.testing.assert_allclose(part.vertices.min(axis=0), [-30.0, -20.0, -20.0], atol=1e-9)
    np.testing.assert_allclose(part.vertices.max(axis=0), [30.0, 20.0, 20.0], atol=1e-9)
    np.testing.assert_allclose(part.diameter, np.hypot(60.0, 40.0), rtol=1e-12)
    assert part.watertight


def test_the_part_is_the_reference_solid(data_folder):
    part = bundled_part("ikeuchi-1987")
    mesh = trimesh.Trimesh(part.vertices, part.triangles, process=False)
    reference = trimesh.load_mesh(data_folder / "cad" / "ikeuchi_part.stl")
    np.testing.assert_allclose([mesh.volume, mesh.area], [reference.volume, reference.area], rtol=1e-6)
    corners = np.asarray(reference.vertices, dtype=np.float64), np.asarray(reference.faces)
    assert SurfaceDistance(*corners).all_within(surface_sample(part.vertices, part.triangles, 2000, seed=2), 1e-5)
    assert SurfaceDistance(part.vertices, part.triangles).all_within(surface_sample(*corners, 2000, seed=3), 1e-5)
