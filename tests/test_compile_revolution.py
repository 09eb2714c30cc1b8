"""A part of revolution is compiled from its rings, however the model cuts them."""

import numpy as np
from itree_cad.assemble import assemble_part

import itree_jax.compile as compiling
from itree_jax.compile import compile_tree
from itree_jax.sensing.bundled import bundled_sensor

from .primitives import cylinder_part


def test_halves_of_a_cylinder_are_one_face_of_the_tree(monkeypatch):
    monkeypatch.setattr(compiling, "APPEARANCE_FREQUENCY", 1)
    monkeypatch.setattr(compiling, "ROLLS", 2)
    whole = cylinder_part(18.0, 50.0)
    half = whole.vertices[whole.triangles].mean(axis=1)[:, 1] > 0
    label = 2 * whole.face_of_triangle + half
    types = [whole.face_types[face // 2] for face in range(6)]
    cut = assemble_part("cut", whole.vertices, whole.triangles, label, types)
    tree = compile_tree(cut, bundled_sensor("ikeuchi-1987"), draws=8)
    assert tree.part.face_types == whole.face_types
    np.testing.assert_array_equal(tree.part.face_of_triangle, whole.face_of_triangle)
    assert len(tree.symmetries.continuous) == 1
    assert tree.groups.face_area.shape[1] == 3
    height = tree.groups.directions[:, 2].round(6)
    for value in np.unique(np.abs(height)):  # both ends are one
        assert len(set(tree.groups.group_of_view[np.abs(height) == value].tolist())) == 1
