"""The share of its own light that a face blocks, in closed form."""

import numpy as np
import pytest
import trimesh
from itree_cad.bundled import bundled_part
from itree_cad.part import Part

from itree_jax.tree.concavity import STEEP, self_blocking


def one_face(mesh: trimesh.Trimesh) -> Part:
    count = len(mesh.faces)
    return Part(
        name="one face",
        vertices=np.asarray(mesh.vertices),
        triangles=np.asarray(mesh.faces),
        face_of_triangle=np.zeros(count, dtype=np.int64),
        face_types=("freeform",),
        face_areas=np.array([mesh.area]),
        unit="mm",
        diameter=float(np.ptp(mesh.vertices, axis=0).max()),
        watertight=False,
    )


def test_a_convex_face_blocks_none_of_its_light() -> None:
    assert self_blocking(one_face(trimesh.creation.icosphere(3, 10.0)), 0) == pytest.approx(0.0, abs=0.02)


def test_a_hemispherical_bowl_blocks_half_of_its_light() -> None:
    ball = trimesh.creation.icosphere(4, 10.0)
    lower = ball.triangles_center[:, 2] < 0
    bowl = trimesh.Trimesh(ball.vertices, ball.faces[lower][:, ::-1], process=False)  # seen from inside
    assert self_blocking(one_face(bowl), 0) == pytest.approx(0.5, abs=0.02)


def test_a_blind_hole_blocks_one_less_opening_over_surface() -> None:
    part = bundled_part("ikeuchi-1987")
    hole = part.identifying_faces[3]
    opening = np.pi * 12.5**2
    surface = opening + 2 * np.pi * 12.5 * 5.5
    assert self_blocking(part, hole) == pytest.approx(1 - opening / surface, abs=0.02)
    assert self_blocking(part, hole) > STEEP
    for face in set(part.identifying_faces) - {hole}:
        assert self_blocking(part, face) < 0.02
