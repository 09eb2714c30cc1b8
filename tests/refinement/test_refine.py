"""Refinement finds the pose on scenes without noise; hypotheses don't disturb each other; free directions are told."""

from dataclasses import replace

import numpy as np
import pytest
from itree_cad.bundled import bundled_part
from itree_kernels.camera import Camera
from scipy.spatial.transform import Rotation

from itree_jax.refinement import optimise, pose_information
from itree_jax.refinement.observed import NO_PART, STEP, filled_up
from itree_jax.refinement.optimise import (
    Hypotheses,
    OtherView,
    Stage,
    refine,
    window_origins,
    window_stride,
)
from itree_jax.refinement.pose_information import equations_at
from itree_jax.refinement.residuals import NormalEquations
from itree_jax.refinement.uncertainty import RimMotions, rim_uncertainty
from itree_jax.refinement.uncertainty import twist_deviation as deviation_of

from ..primitives import box_part, sphere_part
from .scenes import DEVIATIONS, JUMP, PINHOLE, centred, floor_below, model_of, seen

ORTHOGRAPHIC = Camera("orthographic", 1.5, 1.5, 100.3, 90.6, 200, 180)
STAGES = [Stage(10, 64, (12.0, 1.0), (1.0, 0.3), (15.0, 2.0))]
ATTITUDES = Rotation.from_rotvec([[2.2, 0.4, -0.9], [-0.7, 2.4, 0.5], [0.3, -1.2, 1.6]]).as_matrix()


@pytest.fixture(scope="module")
def bracket():
    return model_of(bundled_part("bracket"))


def twist_deviation(information) -> np.ndarray:
    """Of independent errors."""
    rim = RimMotions(2.0, np.zeros(3))
    return deviation_of(rim_uncertainty(information, information, rim, least=1e3), rim)


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


def refined(start: Hypotheses, model, maps, stages) -> tuple[Hypotheses, NormalEquations]:
    """The poses, and what is measured of them."""
    found = refine(start, model, maps, PINHOLE, DEVIATIONS, stages, JUMP)
    return found, equations_at(found, model, maps, PINHOLE, DEVIATIONS, stages[-1], JUMP)


@pytest.mark.parametrize("k", range(3))
def test_a_pose_off_by_ten_degrees_and_four_millimetres_is_found(bracket, k):
    R, t = ATTITUDES[k], centred(bracket, ATTITUDES[k])
    maps = seen(bracket, R, t, [floor_below(bracket, t)]).maps
    start = perturbed(R, t, 6, 10.0, 4.0, seed=k)
    np.testing.assert_allclose(np.stack(pose_error(start, R, t)), [[10.0] * 6, [4.0] * 6], rtol=1e-6)
    found, equations = refined(start, bracket, maps, STAGES)
    rotation, translation = pose_error(found, R, t)
    assert rotation.max() < 0.05
    assert translation.max() < 0.05
    for hessian in equations.hessian:
        assert np.isfinite(twist_deviation(hessian)).all()


@pytest.mark.parametrize("camera", [PINHOLE, ORTHOGRAPHIC])
def test_poses_come_to_rest_where_they_would_have_gone(monkeypatch, bracket, camera):
    """Where gates stay as they are, a pose that hardly moves any more is left alone."""
    R = ATTITUDES[0]
    t = centred(bracket, R, camera=camera)
    maps = seen(bracket, R, t, [floor_below(bracket, t)], camera).maps
    start = perturbed(R, t, 4, 2.0, 1.0, 1)

    def found(steps: int) -> Hypotheses:
        steady = [Stage(steps, 64, (2.0, 2.0), (0.4, 0.4), (4.0, 4.0))]
        return refine(start, bracket, maps, camera, DEVIATIONS, steady, JUMP)

    at_rest = found(30)
    np.testing.assert_array_equal(found(40).t_cam_obj, at_rest.t_cam_obj)
    monkeypatch.setattr(optimise, "REST", 0.0)
    going_on = found(40)
    assert np.abs(going_on.t_cam_obj - at_rest.t_cam_obj).max() > 0.0
    pitch = camera.mm_per_px(float(t[2]))
    turned = Rotation.from_matrix(going_on.R_cam_obj @ np.swapaxes(at_rest.R_cam_obj, 1, 2)).magnitude()
    assert np.linalg.norm(going_on.t_cam_obj - at_rest.t_cam_obj, axis=1).max() < 0.02 * pitch
    assert turned.max() * bracket.reach < 0.02 * pitch


def test_no_pose_rests_while_gates_fall(monkeypatch, bracket):
    R, t = ATTITUDES[0], centred(bracket, ATTITUDES[0])
    maps = seen(bracket, R, t, [floor_below(bracket, t)]).maps
    start = perturbed(R, t, 4, 2.0, 1.0, 1)
    usual = refine(start, bracket, maps, PINHOLE, DEVIATIONS, STAGES, JUMP)
    monkeypatch.setattr(optimise, "REST", 0.0)
    np.testing.assert_array_equal(
        refine(start, bracket, maps, PINHOLE, DEVIATIONS, STAGES, JUMP).t_cam_obj, usual.t_cam_obj
    )


def test_an_orthographic_camera(bracket):
    R = ATTITUDES[0]
    t = centred(bracket, R, camera=ORTHOGRAPHIC)
    maps = seen(bracket, R, t, [floor_below(bracket, t)], ORTHOGRAPHIC).maps
    found = refine(perturbed(R, t, 4, 10.0, 4.0, 1), bracket, maps, ORTHOGRAPHIC, DEVIATIONS, STAGES, JUMP)
    rotation, translation = pose_error(found, R, t)
    assert rotation.max() < 0.05
    assert translation.max() < 0.05


def test_hypotheses_are_independent(bracket):
    """Each is refined to the last bit as if it were alone, and padding of a batch changes no equation."""
    R, t = ATTITUDES[0], centred(bracket, ATTITUDES[0])
    maps = seen(bracket, R, t, [floor_below(bracket, t)]).maps
    start = perturbed(R, t, 17, 8.0, 3.0, seed=0)
    stage = [Stage(3, 32, (12.0, 4.0), (1.0, 0.6), (15.0, 6.0))]
    together, equations = refined(start, bracket, maps, stage)
    assert together.t_cam_obj.shape == (17, 3)
    assert equations.hessian.shape == (17, 6, 6)
    # the stride follows the median distance, here alike for all
    for k in (0, 7, 16):
        alone = Hypotheses(start.R_cam_obj[[k]], start.t_cam_obj[[k]])
        found, one = refined(alone, bracket, maps, stage)
        np.testing.assert_array_equal(found.R_cam_obj[0], together.R_cam_obj[k])
        np.testing.assert_array_equal(found.t_cam_obj[0], together.t_cam_obj[k])
        scale = np.abs(equations.hessian[k]).max()
        np.testing.assert_allclose(one.hessian[0], equations.hessian[k], rtol=1e-3, atol=1e-4 * scale)


def test_equations_are_compiled_for_few_sizes_of_images(bracket, monkeypatch):
    """What lies around an image is nothing: filled up with it, poses at its border have the same equations."""
    R = ATTITUDES[0]
    t = centred(bracket, R) + np.array([0.0, 25.0, 0.0])  # hangs out of the image
    maps = seen(bracket, R, t, [floor_below(bracket, t)]).maps
    start = perturbed(R, t, 3, 3.0, 1.5, seed=2)
    stage = Stage(1, 48, (12.0, 12.0), (1.0, 1.0), (15.0, 15.0))
    padded = filled_up(maps)
    assert padded.depth.shape == (STEP, STEP)
    assert padded.edge_label.shape == (2 * STEP, 2 * STEP)
    found = equations_at(start, bracket, maps, PINHOLE, DEVIATIONS, stage, JUMP)
    monkeypatch.setattr(pose_information, "filled_up", lambda observed: observed)
    as_it_is = equations_at(start, bracket, maps, PINHOLE, DEVIATIONS, stage, JUMP)
    for one, other in zip(found, as_it_is, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-4 * np.abs(other).max())


@pytest.mark.parametrize("grazing", [1.0, 0.1])
@pytest.mark.parametrize("orthographic", [False, True])
def test_a_step_is_the_one_that_the_equations_ask_for(bracket, orthographic, grazing):
    """The kernels sum and solve what the compiled functions state pixel by pixel, where rays were just cast."""
    camera = Camera("orthographic", 1.5, 1.5, 100.3, 90.6, 200, 180) if orthographic else PINHOLE
    R = ATTITUDES[1]
    t = centred(bracket, R, camera=camera)
    maps = seen(bracket, R, t, [floor_below(bracket, t)], camera).maps
    start = perturbed(R, t, 3, 3.0, 1.5, seed=5)
    stage = Stage(1, 48, (12.0, 12.0), (1.0, 1.0), (15.0, 15.0))
    deviations = DEVIATIONS._replace(grazing=np.float32(grazing))
    found = refine(start, bracket, maps, camera, deviations, [stage], JUMP)
    asked = equations_at(start, bracket, maps, camera, deviations, stage, JUMP)
    for k in range(3):
        twist = -np.linalg.solve(np.asarray(asked.hessian[k], float), np.asarray(asked.gradient[k], float))
        assert np.linalg.norm(twist[:3]) > np.radians(1.0)
        turned = Rotation.from_rotvec(twist[:3]).as_matrix() @ start.R_cam_obj[k]
        np.testing.assert_allclose(found.R_cam_obj[k], turned, rtol=0, atol=2e-4)
        np.testing.assert_allclose(found.t_cam_obj[k], start.t_cam_obj[k] + twist[3:], rtol=0, atol=5e-3)


def test_noise_along_the_rays_is_weighed_by_slant(bracket):
    """Weights by the variance across each surface are the best there are (Gauss, Markov): over draws of a depth map's
    noise poses are off by less than with the same weight for all.
    """
    R, noise = ATTITUDES[1], 0.3
    t = centred(bracket, R)
    maps = seen(bracket, R, t, needles=False).maps
    there, start = np.asarray(maps.depth), Hypotheses(R[None].astype(np.float32), t[None].astype(np.float32))
    stage = Stage(2, 192, (4 * noise, 4 * noise), (0.4, 0.4), (4.0, 4.0))
    nothing = np.float32(1e4)  # contours and needles are left out
    alike = DEVIATIONS._replace(depth=np.float32(noise), depth_bias=np.float32(0.0), contour=nothing, needle=nothing)
    by_slant = alike._replace(grazing=np.float32(0.02))
    off = {"alike": [], "by slant": []}
    for seed in range(24):
        noisy = there + np.random.default_rng(seed).normal(0.0, noise, there.shape)
        observed = maps._replace(depth=np.where(there > 0, noisy, 0.0).astype(np.float32))
        for name, deviations in (("alike", alike), ("by slant", by_slant)):
            found = refine(start, bracket, observed, PINHOLE, deviations, [stage], JUMP)
            off[name].append(float(pose_error(found, R, t)[0][0]))
    mean_square = {name: np.mean(np.square(errors)) for name, errors in off.items()}
    assert mean_square["by slant"] < 0.7 * mean_square["alike"]


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
    found, equations = refined(slid, model, maps, STAGES)
    rotation, translation = pose_error(found, R, t)
    assert rotation[0] < 0.05
    assert translation[0] < 0.05
    assert (twist_deviation(equations.hessian[0]) < 0.2).all()

    blind = seen(model, R, t, [floor], jump=np.inf).maps
    # gates so narrow that the floor, seen where the plate isn't, says nothing
    stages = [Stage(4, 64, (1.0, 1.0), (0.3, 0.3), (4.0, 4.0))]
    left, equations = refined(slid, model, blind, stages)
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
    found, equations = refined(start, model, maps, STAGES)
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
    found, equations = refined(away, bracket, maps, stages)
    np.testing.assert_allclose(found.R_cam_obj[0], R, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.t_cam_obj[0], away.t_cam_obj[0], rtol=1e-6)
    assert np.isinf(twist_deviation(equations.hessian[0])).all()


def test_no_steps_are_refused(bracket):
    R, t = ATTITUDES[0], centred(bracket, ATTITUDES[0])
    maps = seen(bracket, R, t).maps
    with pytest.raises(ValueError, match="at least one step"):
        refine(Hypotheses(R[None], t[None]), bracket, maps, PINHOLE, DEVIATIONS, [], JUMP)


@pytest.mark.parametrize("cameras", [1, 2])
@pytest.mark.parametrize("stage", [
    Stage(6, 64, (2.0, 2.0), (0.4, 0.4), (4.0, 4.0)), Stage(3, 24, (12.0, 4.0), (1.0, 0.6), (9.0, 5.0), contour=False),
    Stage(2, 48, (4.0, 2.0), (0.6, 0.4), (9.0, 4.0), more=5),
])  # fmt: skip
def test_one_launch_moves_poses_as_the_steps_do_one_after_the_other(monkeypatch, bracket, stage, cameras):
    """To the last bit: those that rest, those whose rays are cast again, and those that see nothing."""
    R, t = ATTITUDES[1], centred(bracket, ATTITUDES[1])
    maps = seen(bracket, R, t, [floor_below(bracket, t)]).maps
    R_other, t_other = Rotation.from_euler("y", 12.0, degrees=True).as_matrix(), np.array([-120.0, 4.0, 20.0])
    there = seen(bracket, R_other @ R, R_other @ t + t_other).maps
    others = [OtherView(there, PINHOLE, R_other, t_other)][: cameras - 1]
    near, far = perturbed(R, t, 5, 1.0, 0.5, 3), perturbed(R, t, 5, 12.0, 9.0, 4)
    start = Hypotheses(*(np.concatenate(both) for both in zip(near, far, strict=True)))
    start.t_cam_obj[-1] += [4000.0, 0.0, 0.0]

    def found() -> Hypotheses:
        return refine(start, bracket, maps, PINHOLE, DEVIATIONS, [stage], JUMP, others, crease=np.radians(25.0))

    by_one = found()
    monkeypatch.setattr(optimise, "in_one_launch", lambda by, device: False)
    for one, other in zip(by_one, found(), strict=True):
        np.testing.assert_array_equal(one, other)
    assert np.abs(by_one.t_cam_obj - start.t_cam_obj)[:-1].max(axis=1).min() > 0.1
    if others:
        alone = refine(start, bracket, maps, PINHOLE, DEVIATIONS, [stage], JUMP, crease=np.radians(25.0))
        assert (alone.t_cam_obj != by_one.t_cam_obj).any()


def test_more_steps_are_for_poses_that_slide():
    """A plate on a floor of its own height is drawn by its ends alone, a share of the way at a time; what has arrived
    is left alone.
    """
    plate = model_of(box_part(60.0, 24.0, 3.0))
    R, t = np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 400.0])
    maps = seen(plate, R, t, [floor_below(plate, t)]).maps
    away = Hypotheses(np.stack([R, R]), np.stack([t, t + np.array([3.5, 0.0, 0.0])]))
    few = Stage(2, 48, (4.0, 4.0), (0.4, 0.4), (4.0, 4.0))
    short, long = (refine(away, plate, maps, PINHOLE, DEVIATIONS, [replace(few, more=k)], JUMP) for k in (0, 12))
    np.testing.assert_array_equal(short.t_cam_obj[0], long.t_cam_obj[0])
    np.testing.assert_array_equal(short.R_cam_obj[0], long.R_cam_obj[0])
    left = [abs(poses.t_cam_obj[1, 0] - t[0]) for poses in (short, long)]
    assert left[0] > 1.0
    assert left[1] < 0.5 * left[0]


def test_what_is_told_to_be_no_part_draws_no_pose(bracket):
    R, t = ATTITUDES[0], centred(bracket, ATTITUDES[0])
    maps = seen(bracket, R, t).maps
    dark = maps._replace(needle_weight=np.full_like(np.asarray(maps.needle_weight), NO_PART))
    stages = [Stage(3, 48, (4.0, 4.0), (0.4, 0.4), (4.0, 4.0), contour=False)]
    start = perturbed(R, t, 4, 3.0, 2.0, 6)
    found = refine(start, bracket, dark, PINHOLE, DEVIATIONS, stages, JUMP)
    np.testing.assert_allclose(found.t_cam_obj, start.t_cam_obj, rtol=1e-6)
    drawn = refine(start, bracket, maps, PINHOLE, DEVIATIONS, stages, JUMP)
    assert np.linalg.norm(drawn.t_cam_obj - start.t_cam_obj, axis=1).min() > 0.5
