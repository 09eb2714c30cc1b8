"""Axes of parts that a lathe made and a mill spoilt."""

from dataclasses import replace

import numpy as np
import pytest
from itree_cad.bundled import bundled_part, part_from_solid
from itree_cad.csg import box, cylinder
from itree_cad.part import Part
from scipy.spatial.transform import Rotation

from itree_jax.refinement.nearly_revolved import revolved_axis, turns_about


def pin() -> Part:
    """Two cylinders on a line beside the z axis, with a flat on the thinner one."""
    body = cylinder(16.0, 0.0, 20.0, "foot") + cylinder(9.0, 19.0, 50.0, "shank")
    return part_from_solid("pin", (body - box((5, -20, 30), (20, 20, 60), "flat")).moved(x=7.0, y=-3.0))


@pytest.mark.parametrize("turn", [np.zeros(3), np.array([0.4, -1.1, 0.3])])
def test_the_axis_is_found_wherever_the_part_lies(turn):
    R = Rotation.from_rotvec(turn).as_matrix()
    part = pin()
    direction, point = revolved_axis(replace(part, vertices=np.asarray(part.vertices) @ R.T)) or pytest.fail("none")
    assert abs(direction @ R[:, 2]) == pytest.approx(1.0, abs=1e-4)
    off = point - R @ [7.0, -3.0, 0.0]
    assert np.linalg.norm(off - (off @ direction) * direction) < 0.3


@pytest.mark.parametrize("name", ["bracket", "clevis", "plate"])
def test_a_part_with_bores_is_not_of_revolution(name):
    assert revolved_axis(bundled_part(name)) is None


def test_two_cylinders_on_a_line_may_have_a_block_between_them():
    direction, _ = revolved_axis(bundled_part("ikeuchi-1987")) or pytest.fail("none")
    assert abs(direction[0]) == pytest.approx(1.0, abs=1e-4)


def test_turns_are_by_these_angles_and_leave_the_axis_where_it_is():
    axis, point = np.array([0.0, 0.6, 0.8]), np.array([3.0, 5.0, -2.0])
    angles = np.radians([-20.0, 0.0, 12.0, 170.0])
    turns = turns_about((axis, point), angles)
    for along in (-10.0, 30.0):
        X = np.append(point + along * axis, 1.0)
        np.testing.assert_allclose(turns @ X, np.tile(X, (len(turns), 1)), atol=1e-9)
    np.testing.assert_allclose(Rotation.from_matrix(turns[:, :3, :3]).as_rotvec() @ axis, angles, atol=1e-9)
