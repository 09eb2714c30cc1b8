"""Candidates of solids in closed form."""

import numpy as np
import pytest
from itree_cad.bundled import bundled_part

from itree_jax.grasp import grasp_table, load_gripper
from itree_jax.grasp.cup_candidates import sagitta
from itree_jax.grasp.surface import SPACING, holdable_faces, spread, thinned

from ..primitives import box_part, cylinder_part, sphere_part

JAW, CUP = load_gripper("bundled:jaw"), load_gripper("bundled:cup")


def pads(candidate) -> tuple[np.ndarray, np.ndarray]:
    """The middles of the two pads, part's frame."""
    T = candidate.T_obj_grasp
    return tuple(T[:3, 3] + sign * 0.5 * candidate.width * T[:3, 0] for sign in (1, -1))


def test_a_boxs_pads_touch_opposed_faces_as_far_apart_as_its_edges():
    sides = np.array([40.0, 30.0, 20.0])
    table = grasp_table(box_part(*sides), JAW)
    assert {c.width for c in table.candidates} == {40.0, 30.0, 20.0}
    for c in table.candidates:
        a, b = pads(c)
        axis = int(np.abs(c.T_obj_grasp[:3, 0]).argmax())
        assert sides[axis] == pytest.approx(c.width)
        for X in (a, b):
            assert abs(X[axis]) == pytest.approx(0.5 * sides[axis])
            others = np.delete(np.abs(X), axis)
            assert (others <= 0.5 * np.delete(sides, axis) + 1e-9).all()


def test_a_cylinder_is_held_across_its_axis_or_by_its_ends():
    table = grasp_table(cylinder_part(12.0, 30.0), JAW)
    assert {c.width for c in table.candidates} == {24.0, 30.0}
    for c in table.candidates:
        if c.width == 24.0:
            for X in pads(c):
                assert np.hypot(X[0], X[1]) == pytest.approx(12.0, abs=0.02)  # facets lie up to 0.007 mm inside
                assert abs(X[2]) <= 15.0 + 1e-6
            assert c.T_obj_grasp[2, 0] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("name", ["bracket", "stepped-bushing"])
@pytest.mark.parametrize("gripper", [JAW, CUP], ids=["jaw", "cup"])
def test_bundled_parts_have_grasps_that_are_frames_on_their_surface(name, gripper):
    part = bundled_part(name)
    table = grasp_table(part, gripper)
    assert len(table) > 0
    faces = {face.face: face for face in holdable_faces(part)}
    for c in table.candidates:
        R = c.T_obj_grasp[:3, :3]
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(R) == pytest.approx(1.0)
        assert all(face in faces for face in c.faces)
        if gripper is CUP:
            assert faces[c.faces[0]].tree.query(c.T_obj_grasp[:3, 3])[0] < 0.1
        else:
            assert 0.0 < c.width <= 64.0
            assert c.contact >= 0.5


def test_a_jaw_closes_on_solid_not_across_a_gap():
    """The clevis' gap is 18 wide; its lugs are 11 thick and 40 over all."""
    widths = {round(c.width) for c in grasp_table(bundled_part("clevis"), JAW).candidates}
    assert 18 not in widths
    assert {11, 20, 40} <= widths


def test_what_is_too_wide_has_no_candidate_and_says_so():
    table = grasp_table(box_part(90.0, 80.0, 75.0), JAW)
    assert len(table) == 0
    assert "no candidate fits the opening" in table.reason
    assert "0 to 64 mm" in table.reason
    assert "no candidate fits the cup" in grasp_table(box_part(9.0, 9.0, 9.0), CUP).reason
    assert len(grasp_table(sphere_part(20.0), CUP)) == 0


def test_fingers_too_short_for_a_part_are_in_its_way():
    """A plate's middle is out of reach of the fingers: the palm meets the edge first. So no grasp reaches deeper."""
    table = grasp_table(box_part(150.0, 150.0, 10.0), JAW)
    assert len(table) > 0
    for c in table.candidates:
        back = c.T_obj_grasp[:3, 3] - (JAW.tool.finger_length - 0.5 * JAW.tool.pad_length) * c.T_obj_grasp[:3, 2]
        assert np.abs(back[:2]).max() > 75.0  # where the palm begins


def test_a_cup_keeps_its_whole_rim_on_the_face():
    for c in grasp_table(box_part(40.0, 30.0, 20.0), CUP).candidates:
        axis = int(np.abs(c.T_obj_grasp[:3, 2]).argmax())
        room = 0.5 * np.delete(np.array([40.0, 30.0, 20.0]), axis) - np.abs(np.delete(c.T_obj_grasp[:3, 3], axis))
        assert (room >= 0.5 * CUP.tool.diameter + 1.0 - SPACING).all()


def test_a_cup_seals_on_a_cylinder_by_its_sagitta():
    assert sagitta(13.0, 10.0) == pytest.approx(13.0 - 12.0)
    assert sagitta(5.0, 10.0) == np.inf
    wide = {c.faces for c in grasp_table(cylinder_part(14.0, 40.0), CUP).candidates}
    thin = {c.faces for c in grasp_table(cylinder_part(11.0, 40.0), CUP).candidates}
    assert len(wide) == 3
    assert len(thin) == 2  # its ends


def test_points_spread_over_triangles_are_near_each_other():
    corners = np.array([[[0.0, 0, 0], [30, 0, 0], [0, 8, 0]]])
    points = spread(corners)
    rng = np.random.default_rng(0)
    weights = rng.dirichlet(np.ones(3), 500)
    gaps = np.linalg.norm(points - (weights @ corners[0])[:, None], axis=-1).min(axis=1)
    assert gaps.max() <= SPACING
    few = thinned(points, 5.0)
    assert set(map(tuple, few)) <= set(map(tuple, points))
    assert len(few) < len(points) / 5
