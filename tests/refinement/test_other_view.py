"""A second camera in refinement: its equations in the first one's frame, and the range that both together tell."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from itree_cad.bundled import bundled_part
from itree_kernels.mesh import ray_mesh
from scipy.spatial.transform import Rotation

from itree_jax.refinement.observed import CameraArrays, ObservedMaps
from itree_jax.refinement.optimise import Hypotheses, OtherView, Stage, refine
from itree_jax.refinement.pose_information import equations_at, equations_in_view
from itree_jax.refinement.residuals import Deviations, Predicted

from .scenes import DEVIATIONS, DISTANCE, JUMP, PINHOLE, centred, floor_below, model_of, seen
from .test_equations import CAMERAS, SIZE, STEP, STRIDE, TERMS, VALUES, Case, random_case

R_OTHER = Rotation.from_euler("xyz", [4, -17, 30], degrees=True).as_matrix()
T_OTHER = np.array([-35.0, 6.0, 12.0])


def twist_elsewhere(twist: np.ndarray, case: Case) -> np.ndarray:
    """The twist in the other camera's frame that moves the part as this one does in the first camera's.

    By moving two points of space and the part's origin, not by a formula for twists.
    """
    origin = R_OTHER.T @ (case.t - T_OTHER)
    move = Rotation.from_rotvec(twist[:3])

    def moved(X_other: np.ndarray) -> np.ndarray:
        X = (X_other - T_OTHER) @ R_OTHER
        return (move.apply(X - origin) + origin + twist[3:]) @ R_OTHER.T + T_OTHER

    there = moved(case.t)
    axes = moved(case.t + np.eye(3)) - there  # rows: images of the axes
    return np.concatenate([Rotation.from_matrix(axes.T).as_rotvec(), there - case.t])


def of_other_camera(case: Case) -> tuple[np.ndarray, ...]:
    """What the compiled function makes of the case, in float64."""
    with jax.enable_x64(True):
        c = case.camera
        camera = CameraArrays(*(jnp.asarray(v, float) for v in (c.fx, c.fy, c.cx, c.cy, float(not c.is_orthographic))))
        deviations = Deviations(**{name: jnp.asarray(value) for name, value in VALUES.items()})
        predicted = Predicted(*(jnp.asarray(a)[None] for a in case.predicted))
        observed = ObservedMaps(*(jnp.asarray(a) for a in case.observed))
        found = equations_in_view(
            jnp.asarray(case.R)[None], jnp.asarray(case.t)[None], predicted, jnp.asarray(R_OTHER), observed,
            jnp.asarray(case.normal_obj), camera, deviations, jnp.asarray(STRIDE), SIZE,
        )  # fmt: skip
        return tuple(np.asarray(a)[0] for a in found)


@pytest.mark.parametrize("camera", CAMERAS)
def test_equations_are_those_of_its_cost_for_twists_of_the_first_cameras_frame(camera):
    case = random_case(CAMERAS[camera], seed=11)
    hessian, gradient, cost = np.zeros((6, 6)), np.zeros(6), 0.0
    for terms in TERMS.values():
        residual, weight = terms(case)
        ends = [[residual(twist_elsewhere(s * STEP * e, case)) for s in (1, -1)] for e in np.eye(6)]
        J = np.stack([(a - b) / (2 * STEP) for a, b in ends], axis=1)
        hessian += J.T @ (weight[:, None] * J)
        half_costs = [[0.5 * np.sum(weight * r**2) for r in pair] for pair in ends]
        gradient += [(a - b) / (2 * STEP) for a, b in half_costs]
        cost += np.sum(weight * residual(np.zeros(6)) ** 2)
    found = of_other_camera(case)
    np.testing.assert_allclose(found[0], hessian, rtol=1e-6, atol=1e-8 * np.abs(hessian).max())
    np.testing.assert_allclose(found[1], gradient, rtol=1e-6, atol=1e-8 * np.abs(gradient).max())
    np.testing.assert_allclose(found[2], cost, rtol=1e-9)


def test_poses_in_its_frame_keep_the_points_where_they_are():
    rng = np.random.default_rng(0)
    R, t = Rotation.random(4, random_state=np.random.RandomState(1)).as_matrix(), rng.normal(size=(4, 3)) * 50
    view = OtherView(None, PINHOLE, R_OTHER, T_OTHER)
    X = rng.normal(size=3) * 20
    R_there, t_there = view.poses(R, t)
    np.testing.assert_allclose(R_there @ X + t_there, (R @ X + t) @ R_OTHER.T + T_OTHER, rtol=1e-5, atol=1e-4)


def without_depth(maps: ObservedMaps) -> ObservedMaps:
    return maps._replace(depth=jnp.zeros_like(maps.depth), edge_depth=jnp.zeros_like(maps.edge_depth))


STAGES = (Stage(12, 64, (20.0, 20.0), (0.8, 0.6), (12.0, 4.0)),)


def test_two_cameras_tell_the_range_that_one_leaves_loose():
    """Needles and contours alone, no depth: one camera knows the range by the part's size, two by its place."""
    model = model_of(bundled_part("ikeuchi-1987"))
    R = Rotation.from_euler("xyz", [70, 15, 25], degrees=True).as_matrix()
    t = centred(model, R)
    aside = Rotation.from_euler("y", -17, degrees=True).as_matrix()
    centre = np.array([DISTANCE * np.sin(np.radians(17)), 0.0, DISTANCE * (1 - np.cos(np.radians(17)))])
    aside_t = -aside.T @ centre  # X_other = aside.T (X - centre): it looks at the same place
    first = without_depth(seen(model, R, t, [floor_below(model, t)]).maps)
    floor = floor_below(model, t)
    behind = ray_mesh(floor.vertices @ aside + aside_t, floor.triangles, floor.face_of_triangle, device="cpu")
    second = without_depth(seen(model, aside.T @ R, aside.T @ t + aside_t, [behind]).maps)
    view = OtherView(second, PINHOLE, aside.T, aside_t)

    start = Hypotheses(R[None].astype(np.float32), (t + np.array([0.5, -0.5, 8.0]))[None].astype(np.float32))
    alone = refine(start, model, first, PINHOLE, DEVIATIONS, STAGES, JUMP)
    both = refine(start, model, first, PINHOLE, DEVIATIONS, STAGES, JUMP, others=[view])
    by_one = equations_at(alone, model, first, PINHOLE, DEVIATIONS, STAGES[-1], JUMP)
    by_two = equations_at(both, model, first, PINHOLE, DEVIATIONS, STAGES[-1], JUMP, others=[view])
    off = [np.abs(np.asarray(pose.t_cam_obj[0]) - t) for pose in (alone, both)]
    std = [np.sqrt(np.diag(np.linalg.inv(np.asarray(e.hessian[0], float))))[5] for e in (by_one, by_two)]
    assert std[1] < 0.4 * std[0]
    assert off[1].max() < 1.0
    assert off[1][2] < 3.0 * std[1]
    assert off[1][2] < 0.5 * off[0][2]


def test_a_camera_that_sees_nothing_changes_nothing():
    model = model_of(bundled_part("ikeuchi-1987"))
    R = Rotation.from_euler("xyz", [70, 15, 25], degrees=True).as_matrix()
    t = centred(model, R)
    maps = seen(model, R, t, [floor_below(model, t)]).maps
    nothing = seen(model, R, t + np.array([0.0, 0.0, 1e4]), needles=False, jump=np.inf).maps
    view = OtherView(without_depth(nothing), PINHOLE, R_OTHER, T_OTHER)
    start = Hypotheses(R[None].astype(np.float32), (t + 0.5)[None].astype(np.float32))
    stages = (Stage(2, 32, (5.0, 5.0), (0.8, 0.8), (8.0, 8.0)),)
    alone = refine(start, model, maps, PINHOLE, DEVIATIONS, stages, JUMP)
    both = refine(start, model, maps, PINHOLE, DEVIATIONS, stages, JUMP, others=[view])
    np.testing.assert_allclose(both.t_cam_obj, alone.t_cam_obj, rtol=0, atol=1e-4)
    np.testing.assert_allclose(both.R_cam_obj, alone.R_cam_obj, rtol=0, atol=1e-5)
