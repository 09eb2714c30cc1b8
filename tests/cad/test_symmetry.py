"""Symmetries of solids whose group is known."""

import numpy as np
import pytest
import trimesh
from itree_cad.assemble import assemble_part
from itree_cad.bundled import bundled_part, part_from_solid
from itree_cad.csg import Surface, box, extrude, polygon
from itree_cad.load import load_part, save_stl
from itree_cad.surface_distance import SurfaceDistance
from itree_cad.symmetry import Symmetries, rotation, symmetries

from ..primitives import box_part, cone_part, cylinder_part, sphere_part, torus_part


def prism(sides, radius=20.0, height=13.0):
    angle = 2.0 * np.pi * np.arange(sides) / sides
    profile = polygon(
        list(zip((radius * np.cos(angle)).tolist(), (radius * np.sin(angle)).tolist(), strict=True)), "side"
    )
    return part_from_solid("prism", extrude(profile, 0.0, height, Surface("plane", "low"), Surface("plane", "high")))


def moved(part, seed):
    """The part in a pose that no axis of the frame knows."""
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    R = rotation(axis / np.linalg.norm(axis), rng.uniform(0.5, 2.5))
    vertices = part.vertices @ R.T + rng.uniform(-40.0, 40.0, 3)
    return assemble_part(part.name, vertices, part.triangles, part.face_of_triangle, part.face_types)


@pytest.mark.parametrize("pose", [None, 5])
@pytest.mark.parametrize(
    ("part", "discrete", "continuous"),
    [
        (box_part(30.0, 40.0, 50.0), 4, 0),
        (box_part(30.0, 30.0, 50.0), 8, 0),
        (box_part(30.0, 30.0, 30.0), 24, 0),
        (prism(3), 6, 0),
        (prism(5), 10, 0),
        (prism(6), 12, 0),
        (cylinder_part(10.0, 30.0), 2, 1),
        (cylinder_part(10.0, 10.0 * np.sqrt(3.0)), 2, 1),  # all its moments of inertia agree
        (cylinder_part(10.0, 30.0, segments=25), 2, 1),  # the tessellation has no flip of its own about most axes
        (cone_part(10.0, 0.0, 30.0), 1, 1),
        (cone_part(10.0, 5.0, 30.0), 1, 1),
        (torus_part(20.0, 5.0, segments=40), 2, 1),
        (sphere_part(10.0, segments=40), 1, 3),
    ],
    ids=lambda value: value.name if hasattr(value, "name") else str(value),
)
def test_solids_of_known_group(part, discrete, continuous, pose):
    found = symmetries(part if pose is None else moved(part, pose))
    assert (len(found.discrete), len(found.continuous)) == (discrete, continuous)
    np.testing.assert_array_equal(found.discrete[0], np.eye(4))


@pytest.mark.parametrize(
    ("name", "discrete", "continuous"),
    [("ikeuchi-1987", 1, 0), ("bracket", 1, 0), ("clevis", 2, 0), ("stepped-bushing", 1, 1), ("plate", 1, 0)],
)
def test_bundled_parts_have_the_symmetry_they_are_made_for(name, discrete, continuous):
    found = symmetries(bundled_part(name))
    assert (len(found.discrete), len(found.continuous)) == (discrete, continuous)


def test_a_tetrahedron_has_twelve_rotations():
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) * 20.0
    triangles = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    part = assemble_part("tetrahedron", corners, triangles, np.arange(4), ["plane"] * 4)
    assert len(symmetries(part).discrete) == 12


@pytest.mark.parametrize(("depth", "rotations"), [(2.0, 3), (0.05, 24)])
def test_a_notch_breaks_the_symmetry_when_an_image_could_show_it(depth, rotations):
    """A small cube cut out of a corner leaves the threefold axis of its diagonal."""
    low, high = 20.0 - depth, 21.0
    notch = box((low, low, low), (high, high, high), "notch")
    part = part_from_solid("notched", box((-20.0, -20.0, -20.0), (20.0, 20.0, 20.0), "cube") - notch)
    assert len(symmetries(part).discrete) == rotations


@pytest.mark.parametrize(
    "part", [box_part(30.0, 30.0, 30.0), prism(6), bundled_part("clevis")], ids=lambda part: part.name
)
def test_symmetries_are_a_group_of_motions_that_keep_the_surface(part):
    part = moved(part, 11)
    found = symmetries(part).discrete
    surface = SurfaceDistance(part.vertices, part.triangles)
    for T in found:
        np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-9)
        assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
        assert surface.all_within(part.vertices @ T[:3, :3].T + T[:3, 3], 2e-3 * part.diameter)
        for S in found:
            assert np.abs(found - T @ S).max(axis=(1, 2)).min() < 1e-3 * part.diameter


def test_the_axis_is_a_line_that_rotations_keep():
    part = moved(bundled_part("stepped-bushing"), 3)
    ((axis, point),) = symmetries(part).continuous
    R = rotation(axis, 0.7)
    turned = (part.vertices - point) @ R.T + point
    assert SurfaceDistance(part.vertices, part.triangles).all_within(turned, 0.03)


def test_recovered_faces_give_the_same_symmetry(tmp_path):
    save_stl(bundled_part("stepped-bushing"), tmp_path / "bushing.stl")
    found = symmetries(load_part(tmp_path / "bushing.stl"))
    assert (len(found.discrete), len(found.continuous)) == (1, 1)
    np.testing.assert_allclose(np.abs(found.continuous[0][0]), [0.0, 0.0, 1.0], atol=1e-6)


def test_bundled_parts_turn_about_the_axes_they_are_made_with():
    """The clevis: a half turn about its shank, z. The bushing: its axis, z, and no flip (its collar is at one end)."""
    half_turn = symmetries(bundled_part("clevis")).discrete[1]
    np.testing.assert_allclose(half_turn, np.diag([-1.0, -1.0, 1.0, 1.0]), atol=1e-6)
    ((axis, point),) = symmetries(bundled_part("stepped-bushing")).continuous
    np.testing.assert_allclose(np.abs(axis), [0.0, 0.0, 1.0], atol=1e-9)
    np.testing.assert_allclose(point[:2], 0.0, atol=1e-9)


@pytest.mark.parametrize("name", ["ikeuchi-1987", "bracket", "plate"])
def test_bundled_parts_without_symmetry_are_far_from_any(name):
    """Their moments of inertia differ, so only three axes could be: a half turn about each misses by 2 mm or more."""
    part = bundled_part(name)
    mesh = trimesh.Trimesh(part.vertices, part.triangles, process=False)
    moments, frame = np.linalg.eigh(mesh.moment_inertia)
    assert np.diff(moments).min() > 0.01 * moments[2]
    surface = SurfaceDistance(part.vertices, part.triangles)
    for axis in frame.T:
        turned = (part.vertices - mesh.center_mass) @ rotation(axis, np.pi).T + mesh.center_mass
        assert surface.near(turned, 96).max() > 2.0


def test_symmetries_seen_from_another_origin():
    """Moved points go where moved symmetries carry them; an axis is told by its point nearest to the origin."""
    origin, turn = np.array([3.0, -2.0, 5.0]), np.diag([-1.0, -1.0, 1.0, 1.0])
    turn[:3, 3] = 8.0, 2.0, 0.0
    axis, point = np.array([0.0, 0.0, 1.0]), np.array([4.0, 1.0, 77.0])
    own = Symmetries(np.stack([np.eye(4), turn]), ((axis, point),))
    moved = own.about(origin)
    X = np.random.default_rng(0).normal(size=(20, 3))
    for before, after in zip(own.discrete, moved.discrete, strict=True):
        carried = X @ before[:3, :3].T + before[:3, 3]
        np.testing.assert_allclose((X - origin) @ after[:3, :3].T + after[:3, 3], carried - origin, atol=1e-12)
    np.testing.assert_allclose(moved.continuous[0][1], [1.0, 3.0, 0.0])
    np.testing.assert_array_equal(own.discrete[1], turn)
