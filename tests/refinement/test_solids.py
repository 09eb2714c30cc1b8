"""Solids may touch, but not share space."""

import numpy as np
import pytest
from itree_cad.bundled import bundled_part
from itree_kernels.inside import signed_distance
from itree_kernels.mesh import ray_mesh
from scipy.spatial.transform import Rotation

from itree_jax.refinement.solids import Solid, share_space, solid

from ..primitives import box_part

EYE, ZERO = np.eye(3), np.zeros(3)
ANYWHERE = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix(), np.array([30.0, -20.0, 500.0])


def solid_of(part, watertight=True) -> Solid:
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle, device="cpu")
    return solid(mesh, part.diameter, watertight)


@pytest.fixture(scope="module")
def box():
    return solid_of(box_part(40.0, 30.0, 20.0))


@pytest.mark.parametrize(
    ("shift", "shared"),
    [
        ((0.0, 0.0, 0.0), True),
        ((20.0, 0.0, 0.0), True),  # by half
        ((0.0, 15.0, 0.0), True),
        ((0.0, 0.0, -10.0), True),
        ((40.0, 0.0, 0.0), False),  # touching
        ((0.0, 0.0, 20.0), False),
        ((40.0, 30.0, 20.0), False),  # at a corner
        ((45.0, 0.0, 0.0), False),
        ((300.0, 0.0, 0.0), False),
    ],
)
def test_two_boxes(box, shift, shared):
    """Alike from either side, and wherever the camera is."""
    R, t = ANYWHERE
    moved = R @ np.array(shift)
    assert share_space(box, EYE, ZERO, box, EYE, np.array(shift)) is shared
    assert share_space(box, EYE, np.array(shift), box, EYE, ZERO) is shared
    assert share_space(box, R, t, box, R, t + moved) is shared


def test_a_small_solid_inside_of_a_large_one_shares_its_space(box):
    """Although none of the large one's probes need lie in the small one."""
    small = solid_of(box_part(3.0, 3.0, 3.0))
    at = np.array([10.0, 5.0, 3.0])
    assert share_space(small, EYE, at, box, EYE, ZERO)
    assert share_space(box, EYE, ZERO, small, EYE, at)
    assert not share_space(small, EYE, np.array([30.0, 0, 0]), box, EYE, ZERO)


def test_an_open_mesh_excludes_nothing(box):
    sheet = solid_of(box_part(40.0, 30.0, 20.0), watertight=False)
    assert not share_space(sheet, EYE, ZERO, box, EYE, ZERO)
    assert not share_space(box, EYE, ZERO, sheet, EYE, ZERO)


@pytest.mark.parametrize("name", ["plate", "stepped-bushing", "bracket"])
def test_probes_lie_inside_also_of_thin_parts(name):
    part = bundled_part(name)
    body = solid_of(part)
    assert len(body.probes_obj) >= 100
    assert (signed_distance(body.mesh, body.probes_obj) < 0).all()
    assert (solid_of(part).probes_obj == body.probes_obj).all()  # drawn from a fixed seed
    assert share_space(body, EYE, ZERO, body, EYE, ZERO)


def test_plates_that_lie_on_each_other_share_no_space():
    plate = solid_of(bundled_part("plate"))
    assert not share_space(plate, EYE, ZERO, plate, EYE, np.array([0.0, 0.0, 4.0]))
    assert share_space(plate, EYE, ZERO, plate, EYE, np.array([40.0, 0.0, 0.0]))
