"""Component faces recovered from bare triangles: the same as those that the solid was made of."""

import io

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from itree_cad.brep import brep_component_faces
from itree_cad.bundled import BUNDLED_PARTS, bundled_part
from itree_cad.faces import recover_faces
from itree_cad.load import load_part, save_stl
from itree_cad.symmetry import rotation

from ..primitives import box_part, cone_part, cylinder_part, sphere_part, torus_part


def assert_same_faces(found, made):
    """Same types and areas (0.5 %), face by face in area order."""
    assert found.face_types == made.face_types
    np.testing.assert_allclose(found.face_areas, made.face_areas, rtol=5e-3)
    assert found.watertight


def reloaded(part, folder):
    path = folder / "part.stl"
    save_stl(part, path)
    return load_part(path)


@pytest.mark.parametrize("name", [name for name in BUNDLED_PARTS if name != "ikeuchi-1987"])
def test_bundled_parts_come_back_from_stl(name, tmp_path):
    part = bundled_part(name)
    assert_same_faces(reloaded(part, tmp_path), part)


def test_the_papers_part_comes_back_with_its_hole_in_two_faces(tmp_path):
    part = bundled_part("ikeuchi-1987")
    found = reloaded(part, tmp_path)
    assert found.face_count == part.face_count + 1
    hole = part.face_types.index("freeform")
    others = np.delete(part.face_areas, hole)
    floor, wall = 0.5 * 96 * 12.5**2 * np.sin(2 * np.pi / 96), 2 * 96 * 12.5 * np.sin(np.pi / 96) * 5.5
    expected = np.sort([*others, floor, wall])[::-1]
    np.testing.assert_allclose(found.face_areas, expected, rtol=1e-4)
    assert found.face_types.count("cylinder") == 3
    assert found.face_types.count("plane") == 24


@pytest.mark.parametrize(
    "part",
    [
        box_part(10.0, 20.0, 30.0),
        cylinder_part(10.0, 30.0),
        cylinder_part(10.0, 30.0, segments=16),
        cone_part(10.0, 0.0, 30.0),
        cone_part(10.0, 5.0, 30.0),
        sphere_part(10.0, segments=32),
        torus_part(20.0, 5.0, segments=40),
    ],
    ids=lambda part: f"{part.name}-{part.face_count}-{len(part.triangles)}",
)
def test_primitives_come_back_from_stl(part, tmp_path):
    assert_same_faces(reloaded(part, tmp_path), part)


@pytest.mark.parametrize(("length", "radius"), [(40.0, 8.0), (2.0, 20.0), (0.5, 20.0), (90.0, 2.0)])
def test_planes_are_told_from_the_half_cylinders_that_they_meet_tangentially(stadium, length, radius, tmp_path):
    part = stadium(length, radius, 10.0)
    assert sorted(part.face_types) == ["cylinder"] * 2 + ["plane"] * 4
    assert_same_faces(reloaded(part, tmp_path), part)


@pytest.mark.parametrize("radius", [1.0, 3.0, 12.0])
def test_a_fillet_is_told_from_its_planes(filleted_box, radius, tmp_path):
    part = filleted_box(radius)
    assert_same_faces(reloaded(part, tmp_path), part)


def test_tangent_curved_faces_are_told_apart(rounded_post, capsule, tmp_path):
    assert rounded_post.face_types.count("torus") == 1
    assert capsule.face_types.count("sphere") == 2
    assert_same_faces(reloaded(rounded_post, tmp_path), rounded_post)
    assert_same_faces(reloaded(capsule, tmp_path), capsule)


def test_an_irregular_tessellation_of_a_sphere_is_one_face():
    ball = trimesh.creation.icosphere(3, radius=10.0)
    label, types = recover_faces(np.asarray(ball.vertices), np.asarray(ball.faces), 20.0)
    assert types == ("sphere",)
    assert (label == 0).all()


def test_a_surface_without_a_formula_is_one_freeform_face():
    ball = trimesh.creation.icosphere(3, radius=10.0)
    wavy = ball.vertices * (1.0 + 0.1 * np.sin(ball.vertices @ [0.3, 0.4, 0.2]))[:, None]
    _, types = recover_faces(wavy, np.asarray(ball.faces), 22.0)
    assert types == ("freeform",)


def test_a_shallow_roof_is_two_planes():
    roof = [(0, 0), (20, 0), (20, 10), (10, 12), (0, 10)]
    vertices = np.array([(x, y, z) for y in (0.0, 30.0) for x, z in roof])
    solid = trimesh.convex.convex_hull(vertices)
    _, types = recover_faces(np.asarray(solid.vertices), np.asarray(solid.faces), 38.0)
    assert types == ("plane",) * 7


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_faces_do_not_depend_on_pose_or_order_of_the_triangles(seed):
    part = bundled_part("clevis")
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    R = rotation(axis / np.linalg.norm(axis), rng.uniform(0.0, 6.0))
    order = rng.permutation(len(part.triangles))
    moved = (part.vertices @ R.T + rng.uniform(-50.0, 50.0, 3)).astype(np.float32).astype(np.float64)
    label, types = recover_faces(moved, part.triangles[order], part.diameter)
    assert sorted(types) == sorted(part.face_types)
    pairs = set(zip(label.tolist(), part.face_of_triangle[order].tolist(), strict=True))
    assert len(pairs) == part.face_count  # one recovered face for each face, and the reverse
    assert all(types[found] == part.face_types[made] for found, made in pairs)


def split_labels(part, side):
    """Every face cut in two by the sign of `side` at the centre of its triangles."""
    cut = side(part.vertices[part.triangles].mean(axis=1)) > 0.0
    return 2 * part.face_of_triangle + cut


def test_brep_faces_of_one_surface_are_merged_where_they_touch():
    part = cylinder_part(10.0, 30.0)
    halves = split_labels(part, lambda centres: centres[:, 0])
    kinds = tuple(part.face_types[k // 2] for k in range(2 * part.face_count))
    label, types = brep_component_faces(part.vertices, part.triangles, halves, kinds, part.diameter)
    assert sorted(types) == ["cylinder", "plane", "plane"]
    assert len(set(zip(label.tolist(), part.face_of_triangle.tolist(), strict=True))) == 3


def test_brep_faces_of_different_surfaces_stay_apart(stadium):
    part = stadium(40.0, 8.0, 10.0)
    label, types = brep_component_faces(
        part.vertices, part.triangles, part.face_of_triangle, part.face_types, part.diameter
    )
    assert len(types) == part.face_count
    np.testing.assert_array_equal(label, part.face_of_triangle)


def test_brep_surfaces_without_a_formula_are_named_by_their_triangles(rounded_post):
    unknown = (None,) * rounded_post.face_count
    _, types = brep_component_faces(
        rounded_post.vertices, rounded_post.triangles, rounded_post.face_of_triangle, unknown, rounded_post.diameter
    )
    assert types == rounded_post.face_types


def test_loading_is_deterministic():
    part = bundled_part("bracket")
    mesh = trimesh.Trimesh(part.vertices, part.triangles, process=False)
    data = mesh.export(file_type="stl")
    first, second = (trimesh.load_mesh(io.BytesIO(data), file_type="stl") for _ in range(2))
    one, two = (recover_faces(np.asarray(m.vertices), np.asarray(m.faces), part.diameter) for m in (first, second))
    assert one[1] == two[1]
    np.testing.assert_array_equal(one[0], two[0])
