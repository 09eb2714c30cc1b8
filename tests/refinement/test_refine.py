"""Refinement finds the pose on scenes without noise; hypotheses don't disturb each other; free directions are told."""

import numpy as np
import pytest
from itree_cad.bundled import bundled_part
from itree_cad.primitives import box_part, sphere_part
from itree_kernels.camera import Camera
from scipy.spatial.transform import Rotation

from itree_jax.answers import twist_deviation
from itree_jax.refinement.optimise import (
    Hypotheses,
    Stage,
    batch_of,
    batch_size,
    padded,
    refine,
    window_origins,
    window_stride,
)

from .scenes import DEVIATIONS, JUMP, PINHOLE, centred, floor_below, model_of, seen

STAGES = [Stage(10, 64, (12.0, 1.0), (1.0, 0.3), (15.0, 2.0))]
ATTITUDES = Rotation.from_rotvec([[2.2, 0.4, -0.9], [-0.7, 2.4, 0.5], [0.3, -1.2, 1.6]]).as_matrix()


@pytest.fixture(scope="module")
def bracket():
    return model_of(bundled_part("bracket"))


def pose_error(hypotheses: Hypotheses, R, t) -> tuple[np.ndarray, np.ndarray]:
    """Rotation [degrees] and translation [mm] errors."""
    turn = Rotation.from_matrix(np.asarray(hypotheses.R_cam_obj, float) @ R.T)
    return np.degrees(turn.magnitude()), np.linalg.norm(hypotheses.t_cam_obj - t, axis=1)


def perturbed(R, t, count: int, angle_deg: float, shift: float, seed: int) -> Hypotheses:
    rng = np.random.default_rng(seed)
    axis, direction = rng.normal(size=(2, count, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    direction *= shift / np.linalg.norm(direction, axis=1, keepdims=True)
    return Hypotheses(Rotation.from_rotvec(np.radians(angle_deg) * axis).as_matrix() @ R, t + direction)


@pytest.mark.parametrize("k", range(3))
def test_a_pose_off_by_ten_degrees_and_four_millimetres_is_found(bracket, k):
    R, t = ATTITUDES[k], centred(bracket, ATTITUDES[k])
    maps = seen(bracket, R, t, [floor_below(bracket, t)]).maps
    start = perturbed(R, t, 6, 10.0, 4.0, seed=k)
    np.testing.assert_allclose(np.stack(pose_error(start, R, t)), [[10.0] * 6, [4.0] * 6], rtol=1e-6)
    found, equations = refine(start, bracket, maps, PINHOLE, DEVIATIONS, STAGES, JUMP)
    rotation, translation = pose_error(found, R, t)
    assert rotation.max() < 0.05
    assert translation.max() < 0.05
    for hessian in equations.hessian:
        assert np.isfinite(twist_deviation(hessian)).all()


def test_an_orthographic_camera(bracket):
    camera = Camera("orthographic", 1.5, 1.5, 100.3, 90.6, 200, 180)
    R = ATTITUDES[0]
    t = centred(bracket, R, camera=camera)
    maps = seen(bracket, R, t, [floor_below(bracket, t)], camera).maps
    found, _ = refine(perturbed(R, t, 4, 10.0, 4.0, 1), bracket, maps, camera, DEVIATIONS, STAGES, JUMP)
    rotation, translation = pose_error(found, R, t)
    assert rotation.max() < 0.05
    assert translation.max() < 0.05


def test_hypotheses_are_independent(bracket):
    """A batch equals its elements one by one, and padding changes nothing."""
    R, t = ATTITUDES[0], centred(bracket, ATTITUDES[0])
    maps = seen(bracket, R, t, [floor_below(bracket, t)]).maps
    start = perturbed(R, t, 17, 8.0, 3.0, seed=0)  # padded to 128
    assert batch_size(17, 32) == 128
    stage = [Stage(3, 32, (12.0, 4.0), (1.0, 0.6), (15.0, 6.0))]
    together, equations = refine(start, bracket, maps, PINHOLE, DEVIATIONS, stage, JUMP)
    assert together.t_cam_obj.shape == (17, 3)
    assert equations.hessian.shape == (17, 6, 6)
    # the stride follows the median distance, here alike for all
    for k in (0, 7, 16):
        alone = Hypotheses(start.R_cam_obj[[k]], start.t_cam_obj[[k]])
        found, one = refine(alone, bracket, maps, PINHOLE, DEVIATIONS, stage, JUMP)
        np.testing.assert_allclose(found.R_cam_obj[0], together.R_cam_obj[k], rtol=0, atol=1e-5)
        np.testing.assert_allclose(found.t_cam_obj[0], together.t_cam_obj[k], rtol=0, atol=1e-3)
        scale = np.abs(equations.hessian[k]).max()
        np.testing.assert_allclose(one.hessian[0], equations.hessian[k], rtol=1e-3, atol=1e-4 * scale)


def test_padding_repeats_the_last_pose():
    rng = np.random.default_rng(0)
    start = Hypotheses(rng.normal(size=(3, 3, 3)), rng.normal(size=(3, 3)))
    for before, after in zip(start, padded(start, 32), strict=True):
        assert len(after) == batch_size(3, 32)
        np.testing.assert_array_equal(after[:3], before.astype(np.float32))
        assert (after[3:] == after[2]).all()
    for size in (16, 96):
        assert all(batch_size(n, size) >= n for n in range(1, 600))
        assert len({batch_size(n, size) for n in range(1, 600)}) <= 600 // batch_of(size) + 2


def test_windows_hold_the_part(bracket):
    R, t = ATTITUDES[1], centred(bracket, ATTITUDES[1])
    for size in (24, 32, 64):
        stride = window_stride(PINHOLE, bracket.reach, t[2], size)
        low = window_origins(PINHOLE, t[None], size, stride)[0]
        uv = PINHOLE.project(bracket.mesh.vertices @ R.T + t)
        assert (uv >= low).all()
        assert (uv <= low + stride * (size - 1)).all()
        np.testing.assert_array_equal(low, np.round(low))


def facing(part):
    """A flat part that faces the camera, away from the axis."""
    model = model_of(part)
    R = np.diag([1.0, -1.0, -1.0])
    t = centred(model, R)
    return model, R, t, floor_below(model, t)


def test_the_contour_fixes_what_slides_in_a_plane():
    """Depth and needles of a plate leave three directions free: without its outline it stays where it was put."""
    model, R, t, floor = facing(box_part(60.0, 40.0, 4.0))
    turn = Rotation.from_rotvec([0.0, 0.0, np.radians(4.0)]).as_matrix()
    slid = Hypotheses((turn @ R)[None], t[None] + [[2.5, -2.0, 0.0]])
    maps = seen(model, R, t, [floor]).maps
    found, equations = refine(slid, model, maps, PINHOLE, DEVIATIONS, STAGES, JUMP)
    rotation, translation = pose_error(found, R, t)
    assert rotation[0] < 0.05
    assert translation[0] < 0.05
    assert (twist_deviation(equations.hessian[0]) < 0.2).all()

    blind = seen(model, R, t, [floor], jump=np.inf).maps
    # gates so narrow that the floor, seen where the plate isn't, says nothing
    stages = [Stage(4, 64, (1.0, 1.0), (0.3, 0.3), (4.0, 4.0))]
    left, equations = refine(slid, model, blind, PINHOLE, DEVIATIONS, stages, JUMP)
    np.testing.assert_allclose(left.t_cam_obj[0], slid.t_cam_obj[0], rtol=0, atol=1e-2)
    assert abs(np.degrees(Rotation.from_matrix(left.R_cam_obj[0] @ R.T).magnitude()) - 4.0) < 1e-2
    std = twist_deviation(equations.hessian[0])
    assert (std[[2, 3, 4]] > 1e3 * std[[0, 1, 5]].max()).all()


def sphere_scene(needles: bool):
    """A sphere alone, so that there is no observed edge, and the deviations of its pose."""
    radius = 20.0
    model = model_of(sphere_part(radius, 96))
    t = centred(model, np.eye(3))
    maps = seen(model, np.eye(3), t, needles=needles).maps
    start = Hypotheses(np.eye(3)[None], t[None] + [[0.5, -0.5, 0.5]])
    found, equations = refine(start, model, maps, PINHOLE, DEVIATIONS, STAGES, JUMP)
    assert np.linalg.norm(found.t_cam_obj[0] - t) < 0.05
    return model, twist_deviation(equations.hessian[0])


def test_depth_does_not_tell_how_a_sphere_is_turned():
    """A facet's normal leans from the radius by at most `lean`, all the leverage that a turn has: with a bias b
    of depth, no more than r sin(lean) / b.
    """
    model, std = sphere_scene(needles=False)
    corners = model.mesh.vertices[model.mesh.triangles].astype(float)
    radial = corners / np.linalg.norm(corners, axis=-1, keepdims=True)
    lean = np.arccos(np.sum(radial * model.mesh.triangle_normals[:, None], axis=-1).min())
    assert (std[:3] > float(DEVIATIONS.depth_bias) / (20.0 * np.sin(lean))).all()
    assert (20.0 * std[:3] > 15.0 * std[3:].max()).all()


def test_deviations_of_known_hessians():
    """1 / sqrt of a diagonal; infinite along what nothing constrains, whatever its direction."""
    np.testing.assert_allclose(twist_deviation(np.diag([4.0, 1, 25, 100, 1e4, 0.25])), [0.5, 1, 0.2, 0.1, 0.01, 2.0])
    free = twist_deviation(np.diag([4.0, 0, 25, 100, 0, 0.25]))
    np.testing.assert_array_equal(np.isinf(free), [False, True, False, False, True, False])
    np.testing.assert_allclose(free[[0, 2, 3, 5]], [0.5, 0.2, 0.1, 2.0])
    turned = np.eye(6)
    turned[:2, :2] = [[1.0, -1.0], [-1.0, 1.0]]  # (1, 1, 0, 0, 0, 0) is free
    np.testing.assert_array_equal(twist_deviation(turned), [np.inf, np.inf, 1, 1, 1, 1])
    assert np.isinf(twist_deviation(np.zeros((6, 6)))).all()


def test_nothing_in_view_moves_nothing(bracket):
    """No correspondence, no step, no NaN."""
    R, t = ATTITUDES[0], centred(bracket, ATTITUDES[0])
    maps = seen(bracket, R, t).maps
    away = Hypotheses(R[None], t[None] + [[0.0, 0.0, 300.0]])
    stages = [Stage(2, 32, (1.0, 1.0), (1.0, 1.0), (2.0, 2.0))]
    found, equations = refine(away, bracket, maps, PINHOLE, DEVIATIONS, stages, JUMP)
    np.testing.assert_allclose(found.R_cam_obj[0], R, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.t_cam_obj[0], away.t_cam_obj[0], rtol=1e-6)
    assert np.isinf(twist_deviation(equations.hessian[0])).all()


def test_no_steps_are_refused(bracket):
    R, t = ATTITUDES[0], centred(bracket, ATTITUDES[0])
    maps = seen(bracket, R, t).maps
    with pytest.raises(ValueError, match="at least one step"):
        refine(Hypotheses(R[None], t[None]), bracket, maps, PINHOLE, DEVIATIONS, [], JUMP)
