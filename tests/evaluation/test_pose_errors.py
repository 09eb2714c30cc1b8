"""Laws of the pose errors: what a translation, a rotation and a symmetric turn cost."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from itree_kernels.camera import Camera
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from itree_jax.evaluation import Pose, add_s, mspd, mssd, symmetry_set
from itree_jax.evaluation.pose_errors import pose_errors

HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0]).ravel().tolist()
BOX = np.array([[x, y, z] for x in (-30.0, 30.0) for y in (-20.0, 20.0) for z in (0.0, 25.0)])
ASYMMETRIC = symmetry_set({})
TWO_FOLD = symmetry_set({"symmetries_discrete": [HALF_TURN]})
ROUND = symmetry_set({"symmetries_continuous": [{"axis": [0, 0, 2], "offset": [5, 0, 0]}]})
PINHOLE = Camera("pinhole", 1800.0, 1800.0, 319.5, 239.5, 640, 480)
ORTHOGRAPHIC = Camera("orthographic", 2.0, 2.0, 319.5, 239.5, 640, 480)
vectors = st.tuples(*[st.floats(-3, 3)] * 3).map(np.array)


def pose(rotvec: np.ndarray, t: np.ndarray) -> Pose:
    return Pose(Rotation.from_rotvec(rotvec).as_matrix(), np.asarray(t, float))


def cylinder_points(offset: np.ndarray) -> np.ndarray:
    turn = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    ring = np.stack([10 * np.cos(turn), 10 * np.sin(turn), np.zeros(400)], axis=1)
    return np.concatenate([ring, ring + np.array([0, 0, 30.0])]) + offset


@given(vectors, vectors, vectors)
def test_a_translation_by_x_costs_x(rotvec, t, x):
    truth = pose(rotvec, t)
    assert mssd(Pose(truth.R, truth.t + x), truth, BOX, ASYMMETRIC) == pytest.approx(np.linalg.norm(x), abs=1e-9)
    errors = pose_errors(Pose(truth.R, truth.t + x), truth, BOX, ASYMMETRIC)
    assert errors.translation == pytest.approx(np.linalg.norm(x), abs=1e-9)
    assert errors.rotation == pytest.approx(0, abs=1e-7)


@given(vectors, st.floats(0, np.pi))
def test_a_rotation_about_the_centre_costs_its_chord(rotvec, angle):
    """The farthest point from the z axis is a corner, sqrt(30^2 + 20^2) away: it moves by 2 r sin(angle / 2)."""
    truth = pose(rotvec, np.zeros(3))
    turned = Pose(truth.R @ Rotation.from_rotvec([0, 0, angle]).as_matrix(), truth.t)
    errors = pose_errors(turned, truth, BOX, ASYMMETRIC)
    assert errors.mssd == pytest.approx(2 * np.hypot(30, 20) * np.sin(angle / 2), abs=1e-9)
    assert errors.rotation == pytest.approx(angle, abs=1e-7)


@given(vectors, vectors)
def test_a_symmetric_turn_costs_nothing(rotvec, t):
    truth = pose(rotvec, t)
    turned = Pose(truth.R @ np.diag([-1.0, -1.0, 1.0]), truth.t)
    errors = pose_errors(turned, truth, BOX, TWO_FOLD)
    np.testing.assert_allclose(errors, 0, atol=1e-7)
    assert mssd(turned, truth, BOX, ASYMMETRIC) == pytest.approx(2 * np.hypot(30, 20))


@settings(max_examples=20)
@given(vectors, vectors, st.floats(-np.pi, np.pi))
def test_a_turn_about_a_continuous_axis_costs_at_most_a_step(rotvec, t, angle):
    """Steps of 2 pi / 315: a point 10 from the axis is at most 10 * 2 pi / 630 = 0.1 from its copy at some step."""
    offset = np.array([5.0, 0, 0])
    truth = pose(rotvec, t)
    turn = Rotation.from_rotvec([0, 0, angle]).as_matrix()
    turned = Pose(truth.R @ turn, truth.t + truth.R @ (offset - turn @ offset))
    errors = pose_errors(turned, truth, cylinder_points(offset), ROUND)
    assert errors.mssd <= 10 * 2 * np.pi / 630 + 1e-9
    assert errors.rotation == pytest.approx(0, abs=1e-7)
    assert mssd(turned, truth, cylinder_points(offset), ASYMMETRIC) >= 20 * np.sin(abs(angle) / 2) - 0.1


@settings(max_examples=20)
@given(vectors, vectors, vectors, vectors)
def test_the_bound_over_symmetries_changes_nothing(rotvec, t, rotvec_est, x):
    """Against every symmetry with every point; also the symmetry chosen is the same."""
    points = cylinder_points(np.array([5.0, 0, 0]))[::10]
    truth, estimate = pose(rotvec, t), pose(rotvec_est, t + x)
    copies = np.einsum("sij,pj->spi", truth.R @ ROUND.R, points) + (ROUND.t @ truth.R.T + truth.t)[:, None]
    gaps = np.linalg.norm(copies - (points @ estimate.R.T + estimate.t), axis=-1).max(axis=1)
    assert mssd(estimate, truth, points, ROUND) == pytest.approx(gaps.min(), abs=1e-9)


def test_a_shift_across_the_view_costs_its_pixels():
    truth = pose(np.zeros(3), np.array([0, 0, 900.0]))
    shifted = Pose(truth.R, truth.t + np.array([3.0, -4.0, 0]))
    assert mspd(shifted, truth, BOX, ASYMMETRIC, PINHOLE) == pytest.approx(5.0 * 1800 / 900)  # the near side of the box
    assert mspd(shifted, truth, BOX, ASYMMETRIC, ORTHOGRAPHIC) == pytest.approx(10.0)
    deeper = Pose(truth.R, truth.t + np.array([0, 0, 50.0]))
    assert mspd(deeper, truth, BOX, ASYMMETRIC, ORTHOGRAPHIC) == pytest.approx(0, abs=1e-9)
    assert mspd(deeper, truth, BOX, ASYMMETRIC, PINHOLE) == pytest.approx(1800 * np.hypot(30, 20) * (1 / 900 - 1 / 950))


def test_add_s_is_the_distance_to_the_nearest_point_of_the_surface():
    grid = np.stack(np.meshgrid(np.arange(-20.0, 21), np.arange(-20.0, 21), [0.0]), axis=-1).reshape(-1, 3)
    surface, inside = KDTree(grid), grid[np.abs(grid).max(axis=1) <= 10]
    truth = pose(np.array([0.3, -0.2, 1.0]), np.array([1.0, 2, 3]))
    away = Pose(truth.R, truth.t + truth.R @ [0, 0, 2.5])
    along = Pose(truth.R, truth.t + truth.R @ [7.0, -3.0, 0])
    assert add_s(truth, truth, inside, surface) == pytest.approx(0, abs=1e-9)
    assert add_s(away, truth, inside, surface) == pytest.approx(2.5)
    assert add_s(along, truth, inside, surface) == pytest.approx(0, abs=1e-9)


@given(vectors, vectors.map(lambda x: 20 * x))
def test_add_s_leaves_out_only_what_exceeds_the_limit(rotvec, x):
    rng = np.random.default_rng(0)
    points = rng.uniform(-10, 10, (50, 3))
    surface = KDTree(points)
    truth, estimate = pose(np.zeros(3), np.zeros(3)), pose(rotvec, x)
    exact = add_s(estimate, truth, points, surface)
    limited = add_s(estimate, truth, points, surface, limit=5.0)
    assert limited == exact or (np.isinf(limited) and exact > 5.0)


@pytest.mark.parametrize("batch", [(), (1,), (3, 1, 2)])
def test_a_batch_equals_its_elements(batch):
    rng = np.random.default_rng(1)
    R = Rotation.random(int(np.prod(batch, dtype=int)), random_state=1).as_matrix().reshape(*batch, 3, 3)
    t = rng.normal(size=(*batch, 3))
    truth = pose(np.array([0.1, 0.2, 0.3]), np.zeros(3))
    got = pose_errors(Pose(R, t), truth, BOX, TWO_FOLD)
    assert got.mssd.shape == batch
    for index in np.ndindex(*batch):
        one = pose_errors(Pose(R[index], t[index]), truth, BOX, TWO_FOLD)
        np.testing.assert_allclose([e[index] for e in got], one, rtol=1e-12)
