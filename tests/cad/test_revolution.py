"""Rings: faces of a part of revolution that its rotation carries into each other are one."""

import dataclasses

import numpy as np
import pytest
from itree_cad.assemble import assemble_part
from itree_cad.bundled import bundled_part
from itree_cad.part import Part
from itree_cad.revolution import rings
from itree_cad.symmetry import rotation, symmetries

from ..primitives import cylinder_part, sphere_part

BUSHING = bundled_part("stepped-bushing")


def split(part: Part, pieces: list[list[float]]) -> Part:
    """Face k cut along half planes through z at the angles [degrees] `pieces[k % len(pieces)]`."""
    middle = part.vertices[part.triangles].mean(axis=1)
    azimuth = np.degrees(np.arctan2(middle[:, 1], middle[:, 0])) % 360.0
    cut = np.array([np.searchsorted(pieces[face % len(pieces)], azimuth[t]) % max(1, len(pieces[face % len(pieces)]))
                    for t, face in enumerate(part.face_of_triangle)])  # fmt: skip
    keys, label = np.unique(np.c_[part.face_of_triangle, cut], axis=0, return_inverse=True)
    types = [part.face_types[face] for face in keys[:, 0]]
    return assemble_part(part.name, part.vertices, part.triangles, label.reshape(-1), types)


def moved(part: Part) -> Part:
    R = rotation(np.array([2.0, -1.0, 2.0]) / 3.0, 1.1)
    return dataclasses.replace(part, vertices=part.vertices @ R.T + np.array([30.0, -12.0, 5.0]))


@pytest.mark.parametrize(
    "pieces",
    [[[0.0, 180.0]], [[0.0, 90.0, 180.0, 270.0]], [[10.0, 30.0], []], [[0.0, 180.0], [40.0, 120.0, 200.0], [5.0]]],
    ids=["halves", "quarters", "a sliver", "mixed"],
)
@pytest.mark.parametrize("place", [lambda part: part, moved], ids=["upright", "moved"])
def test_rings_undo_any_cut_along_the_axis(pieces, place):
    pieces_of_bushing = place(split(BUSHING, pieces))
    ringed = rings(pieces_of_bushing, symmetries(pieces_of_bushing))
    assert ringed.face_types == BUSHING.face_types
    np.testing.assert_allclose(ringed.face_areas, BUSHING.face_areas)
    np.testing.assert_array_equal(ringed.face_of_triangle, BUSHING.face_of_triangle)
    assert ringed.diameter == pytest.approx(BUSHING.diameter)


def test_a_piece_that_is_named_names_its_ring():
    halves = split(BUSHING, [[0.0, 180.0]])
    named = dataclasses.replace(halves, identifying_faces=(0, 5))
    ringed = rings(named, symmetries(named))
    assert ringed.identifying_faces is not None
    areas = np.sort(ringed.face_areas[list(ringed.identifying_faces)])
    np.testing.assert_allclose(areas, np.sort(2.0 * halves.face_areas[[0, 5]]), rtol=1e-3)


def test_the_pieces_of_a_sphere_are_one_face():
    octants = split(sphere_part(20.0, 32), [[0.0, 120.0]])
    assert octants.face_count == 2
    assert rings(octants, symmetries(octants)).face_count == 1


@pytest.mark.parametrize("part", [BUSHING, cylinder_part(10.0, 30.0), bundled_part("clevis")], ids=lambda p: p.name)
def test_whole_rings_and_parts_without_an_axis_come_back_as_they_are(part):
    assert rings(part, symmetries(part)) is part
