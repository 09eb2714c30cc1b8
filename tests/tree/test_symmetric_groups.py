"""Attitude groups of parts with symmetries: views that show the same thing are in one group."""

import dataclasses

import numpy as np
import pytest
from itree_cad.assemble import assemble_part
from itree_cad.bundled import bundled_part
from itree_cad.part import Part
from itree_cad.revolution import rings
from itree_cad.symmetry import Symmetries, rotation, symmetries
from itree_kernels.mesh import ray_mesh

from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.tree.groups import AttitudeGroups, attitude_groups, group_of_label

from ..primitives import box_part, cylinder_part, sphere_part

SENSOR = bundled_sensor("ikeuchi-1987")
COARSE = dataclasses.replace(SENSOR, camera=dataclasses.replace(SENSOR.camera, fx=1.0, fy=1.0))


def groups_of(part: Part, frequency: int = 1, symmetry: Symmetries | None = None) -> AttitudeGroups:
    symmetry = symmetries(part) if symmetry is None else symmetry
    part = rings(part, symmetry)
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle)
    return attitude_groups(mesh, part, COARSE, frequency, symmetry=symmetry)


def turned(part: Part, R: np.ndarray) -> Part:
    return dataclasses.replace(part, vertices=part.vertices @ R.T)


@pytest.mark.parametrize("frequency", [1, 2, 3])
@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0)], ids=["z", "x"])
def test_groups_of_a_part_of_revolution_are_rings(axis, frequency: int) -> None:
    """Ordered by polar angle the groups follow each other, and views of one angle are together."""
    R = rotation(np.array([0.0, 1.0, 0.0]), np.pi / 2) if axis[0] else np.eye(3)
    groups = groups_of(turned(bundled_part("stepped-bushing"), R), frequency)
    height = (groups.directions @ np.array(axis)).round(6)
    for value in np.unique(height):
        assert len(set(groups.group_of_view[height == value].tolist())) == 1
    np.testing.assert_allclose(groups.R_cam_obj @ np.array(axis) @ np.array([1.0, 0.0, 0.0]), 0.0, atol=1e-9)
    assert groups.view_count.min() >= frequency**2


def test_pieces_of_rings_give_the_groups_of_rings() -> None:
    part = bundled_part("stepped-bushing")
    half = part.vertices[part.triangles].mean(axis=1)[:, 1] > 0
    label = 2 * part.face_of_triangle + half
    types = [part.face_types[face // 2] for face in range(2 * part.face_count)]
    pieces = assemble_part("pieces", part.vertices, part.triangles, label, types)
    assert groups_of(pieces).label_strings == groups_of(part).label_strings


def test_a_flip_end_over_end_makes_both_ends_one() -> None:
    groups = groups_of(cylinder_part(18.0, 50.0), frequency=2)
    np.testing.assert_array_equal(groups.same_digits, [[0, 1, 2], [0, 2, 1]])
    below = groups_of(turned(cylinder_part(18.0, 50.0), np.diag([1.0, -1.0, -1.0])), frequency=2)
    np.testing.assert_array_equal(groups.group_of_view, below.group_of_view)
    ends = np.abs(groups.directions[:, 2]) > 0.95
    assert len(set(groups.group_of_view[ends].tolist())) == 1
    assert {label[1:] for label in groups.label_strings} <= {"00", "10"}


def test_a_cube_looks_the_same_from_everywhere_but_for_how_many_sides_show() -> None:
    groups = groups_of(box_part(40.0, 40.0, 40.0), frequency=2)
    assert groups.group_labels.shape[1] == 6
    assert len(groups.same_digits) == 24
    digits = groups.group_labels.sum(axis=1)
    assert len(set(digits.tolist())) == len(digits)


def test_a_sphere_has_one_group() -> None:
    assert groups_of(sphere_part(25.0, 48)).label_strings == ("1",)


def test_views_that_a_symmetry_carries_into_each_other_are_in_one_group() -> None:
    """The half turn of the clevis about z is one of the dome's own. (Shadows turn with it: image up is z.)"""
    part = bundled_part("clevis")
    groups = groups_of(part, frequency=2)
    half = np.diag([-1.0, -1.0, 1.0])
    opposite = (groups.directions @ half @ groups.directions.T).argmax(axis=1)
    np.testing.assert_array_equal(groups.group_of_view[opposite], groups.group_of_view)
    apart = attitude_groups(ray_mesh(part.vertices, part.triangles, part.face_of_triangle), part, COARSE, 2)
    assert apart.group_count > groups.group_count


def test_a_symmetry_of_the_part_leaves_the_group_of_any_label() -> None:
    groups = groups_of(bundled_part("clevis"))
    rng = np.random.default_rng(0)
    area = np.zeros((40, groups.face_area.shape[1]))
    area[:, groups.identifying_faces] = rng.choice([0.0, 50.0, 70.0, 300.0], (40, len(groups.identifying_faces)))
    for row in groups.same_digits:
        other = area.copy()
        other[:, groups.identifying_faces] = area[:, groups.identifying_faces[row]]
        np.testing.assert_array_equal(group_of_label(groups, other), group_of_label(groups, area))


def test_named_faces_bring_those_that_symmetries_carry_them_into() -> None:
    part = dataclasses.replace(box_part(30.0, 40.0, 50.0), identifying_faces=(1,))
    np.testing.assert_array_equal(groups_of(part).identifying_faces, [0, 1])
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle)
    np.testing.assert_array_equal(attitude_groups(mesh, part, COARSE).identifying_faces, [1])


def test_the_representative_shows_exactly_the_label_of_its_group() -> None:
    for name in ("clevis", "plate", "stepped-bushing"):
        groups = groups_of(bundled_part(name), frequency=2)
        np.testing.assert_array_equal(groups.labels[groups.representative_view], groups.group_labels)
        np.testing.assert_array_equal(groups.membership[groups.representative_view], 1.0)
