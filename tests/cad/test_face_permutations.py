"""Faces under symmetries: where the geometry goes, the numbers go."""

import dataclasses

import numpy as np
import pytest
from itree_cad.assemble import assemble_part, triangle_areas
from itree_cad.bundled import bundled_part, part_from_solid
from itree_cad.csg import Surface, extrude, polygon
from itree_cad.face_permutations import face_permutations
from itree_cad.part import Part
from itree_cad.symmetry import symmetries

from ..primitives import box_part, cylinder_part


def hexagon() -> Part:
    angle = np.radians(60.0 * np.arange(6))
    corners = list(zip((20.0 * np.cos(angle)).tolist(), (20.0 * np.sin(angle)).tolist(), strict=True))
    solid = extrude(polygon(corners, "side"), 0.0, 13.0, Surface("plane", "low"), Surface("plane", "high"))
    return part_from_solid("hexagon", solid)


def centroids(part: Part) -> np.ndarray:
    areas = triangle_areas(part.vertices, part.triangles)
    middle = part.vertices[part.triangles].mean(axis=1)
    return np.array([
        areas[mine] @ middle[mine] / areas[mine].sum()
        for mine in (part.face_of_triangle == face for face in range(part.face_count))
    ])  # fmt: skip


@pytest.mark.parametrize(
    ("part", "count"),
    [(box_part(30.0, 40.0, 50.0), 4), (box_part(30.0, 30.0, 30.0), 24), (hexagon(), 12), (bundled_part("clevis"), 2),
     (cylinder_part(10.0, 30.0), 2)],
    ids=lambda value: getattr(value, "name", str(value)),
)  # fmt: skip
def test_every_face_goes_where_its_centroid_goes(part, count):
    found = symmetries(part)
    rows = face_permutations(part, found)
    assert len(rows) == count
    np.testing.assert_array_equal(rows[0], np.arange(part.face_count))
    where = centroids(part)
    for T, row in zip(found.discrete, rows, strict=True):
        np.testing.assert_array_equal(np.sort(row), np.arange(part.face_count))
        np.testing.assert_allclose(where @ T[:3, :3].T + T[:3, 3], where[row], atol=0.2)


@pytest.mark.parametrize("name", ["ikeuchi-1987", "bracket", "plate", "stepped-bushing"])
def test_a_part_without_discrete_symmetry_has_the_identity_alone(name):
    part = bundled_part(name)
    np.testing.assert_array_equal(face_permutations(part, symmetries(part)), np.arange(part.face_count)[None])


def test_a_model_whose_faces_are_cut_against_its_symmetry_has_the_identity_alone():
    """One of the two largest faces of a brick is two component faces: no permutation does what the half turns do."""
    brick = box_part(30.0, 40.0, 50.0)
    label = brick.face_of_triangle.copy()
    label[np.flatnonzero(label == 0)[0]] = 6
    cut = assemble_part("cut", brick.vertices, brick.triangles, label, ["plane"] * 7)
    assert len(symmetries(cut).discrete) == 4
    np.testing.assert_array_equal(face_permutations(cut, symmetries(cut)), np.arange(7)[None])


def test_the_two_sides_of_a_thin_sheet_are_not_taken_for_each_other():
    sheet = box_part(60.0, 40.0, 0.2)
    for T, row in zip(symmetries(sheet).discrete, face_permutations(sheet, symmetries(sheet)), strict=True):
        assert (row[0] == 0) == (T[2, 2] > 0)


def test_scale_and_place_do_not_matter():
    part = bundled_part("clevis")
    large = dataclasses.replace(part, vertices=part.vertices * 7.0 + 90.0, face_areas=part.face_areas * 49.0,
                                diameter=part.diameter * 7.0)  # fmt: skip
    np.testing.assert_array_equal(
        face_permutations(large, symmetries(large)), face_permutations(part, symmetries(part))
    )
