"""The normal equations are those of the residuals: Jacobians by finite differences, weights by their definition.

The twist moves the model's points and normals; correspondences and weights stay as they are. Computed in float64.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from itree_kernels.camera import Camera
from scipy.spatial.transform import Rotation

from itree_jax.refinement.observed import CameraArrays, ObservedMaps
from itree_jax.refinement.residuals import (
    Deviations,
    Predicted,
    WindowObservations,
    contour_equations,
    depth_equations,
    look_up,
    needle_equations,
    total_equations,
    tukey,
)

CAMERAS = {
    "orthographic": Camera("orthographic", 2.0, 2.1, 15.3, 14.2, 32, 30),
    "pinhole": Camera("pinhole", 300.0, 310.0, 15.3, 14.2, 32, 30),
}
SIZE, STRIDE = 12, 2
NAMES = ("depth", "depth_bias", "depth_gate", "needle", "needle_bias", "needle_gate", "contour", "contour_bias")
VALUES = dict(zip(NAMES, (0.3, 0.05, 2.5, 0.06, 0.02, 0.8, 0.5, 0.2), strict=True), contour_gate=12.0)
STEP = 1e-5


class Case(NamedTuple):
    """One hypothesis and random maps around it, as NumPy arrays."""

    camera: Camera
    R: np.ndarray
    t: np.ndarray
    predicted: Predicted
    observed: ObservedMaps
    normal_obj: np.ndarray


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def random_case(camera: Camera, seed: int) -> Case:
    """Some window pixels miss the part or lie outside of the image; some measurements are absent or far off."""
    rng = np.random.default_rng(seed)
    R = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    t = np.array([1.0, -2.0, 150.0])
    h, w = camera.height, camera.width
    triangles = 9
    normal_obj = unit(rng.normal([0, 0, -1.5], 0.6, (triangles, 3))) @ R
    triangle = rng.integers(-1, triangles, (SIZE, SIZE))
    depth = np.where(triangle >= 0, rng.uniform(140.0, 155.0, (SIZE, SIZE)), 0.0)
    contour_uv = rng.uniform(-3.0, 35.0, (2, SIZE, SIZE, 2))
    contour_depth = np.where(rng.random((2, SIZE, SIZE)) < 0.7, rng.uniform(140.0, 155.0, (2, SIZE, SIZE)), 0.0)
    predicted = Predicted(np.array([6.0, 9.0]), depth, triangle, contour_uv, contour_depth)

    window = np.full((h + 40, w + 40), 147.0)
    window[9 : 9 + SIZE * STRIDE : STRIDE, 6 : 6 + SIZE * STRIDE : STRIDE] = depth
    image_depth = window[:h, :w] + rng.normal(0.0, 1.5, (h, w))
    image_depth[rng.random((h, w)) < 0.1] = 0.0
    normals = unit(rng.normal([0, 0, -1.5], 0.6, (h, w, 3)))
    weight = rng.uniform(0.2, 1.0, (h, w)) * (rng.random((h, w)) < 0.8)
    edges = 7
    observed = ObservedMaps(
        image_depth, normals, weight, rng.integers(0, edges, (2 * h, 2 * w)), rng.uniform(0.0, 30.0, (edges, 2)),
        unit(rng.normal(size=(edges, 2))), rng.uniform(140.0, 155.0, edges), np.zeros((h, w, 0)), np.zeros((0, 3)),
    )  # fmt: skip
    return Case(camera, R, t, predicted, observed, normal_obj)


def moved(X: np.ndarray, case: Case, twist: np.ndarray) -> np.ndarray:
    return Rotation.from_rotvec(twist[:3]).apply(X.reshape(-1, 3) - case.t).reshape(X.shape) + case.t + twist[3:]


def window_uv(case: Case) -> np.ndarray:
    v, u = np.mgrid[:SIZE, :SIZE] * float(STRIDE)
    return np.stack([u, v], axis=-1) + case.predicted.origin_uv


def at_window(case: Case, image: np.ndarray) -> np.ndarray:
    """Values of an image at the window's pixels, 0 outside."""
    uv = window_uv(case).astype(int)
    inside = (uv >= 0).all(-1) & (uv < [case.camera.width, case.camera.height]).all(-1)
    value = image[np.where(inside, uv[..., 1], 0), np.where(inside, uv[..., 0], 0)]
    return np.where(inside.reshape(inside.shape + (1,) * (image.ndim - 2)), value, 0.0)


def biweight(distance: np.ndarray, gate: float) -> np.ndarray:
    return np.where(np.abs(distance) < gate, (1.0 - (distance / gate) ** 2) ** 2, 0.0)


def discounted(robust: np.ndarray, std: float, bias: float) -> np.ndarray:
    """N errors with a common one of standard deviation `bias` are worth no more than 1 / bias^2."""
    return robust / (std**2 + robust.sum() * bias**2)


def depth_terms(case: Case, grazing: float = 1.0):
    """Residuals [mm] as a function of the twist, and their weights: those of errors along the rays, seen across."""
    seen = at_window(case, case.observed.depth)
    valid = (case.predicted.triangle >= 0) & (seen > 0)
    uv = window_uv(case)
    X_model = case.camera.unproject(uv, case.predicted.depth)
    X_seen = case.camera.unproject(uv, seen)
    normal = case.normal_obj[case.predicted.triangle] @ case.R.T

    def residual(twist):
        return np.sum(normal * (X_seen - moved(X_model, case, twist)), axis=-1)[valid]

    along = X_seen - X_model
    facing = np.sum(normal * along, axis=-1)[valid] / along[valid][:, 2]
    across = np.sqrt(grazing + (1.0 - grazing) * facing**2)
    robust = biweight(residual(np.zeros(6)) / across, VALUES["depth_gate"]) / across**2
    return residual, discounted(robust, VALUES["depth"], VALUES["depth_bias"])


def needle_terms(case: Case):
    seen, weight = at_window(case, case.observed.normals), at_window(case, case.observed.needle_weight)
    depth = at_window(case, case.observed.depth)
    same = (depth == 0) | (np.abs(depth - case.predicted.depth) < VALUES["depth_gate"])
    valid = (case.predicted.triangle >= 0) & (weight > 0) & same
    normal = case.normal_obj[case.predicted.triangle][valid] @ case.R.T

    def residual(twist):
        return (seen[valid] - Rotation.from_rotvec(twist[:3]).apply(normal)).ravel()

    gap = np.linalg.norm(residual(np.zeros(6)).reshape(-1, 3), axis=1)
    robust = weight[valid] * biweight(gap, VALUES["needle_gate"])
    return residual, np.repeat(discounted(robust, VALUES["needle"], VALUES["needle_bias"]), 3)


def contour_terms(case: Case):
    uv, z = case.predicted.contour_uv.reshape(-1, 2), case.predicted.contour_depth.ravel()
    half = np.round(2 * uv).astype(int)
    there = (z > 0) & (half >= 0).all(1) & (half < [2 * case.camera.width, 2 * case.camera.height]).all(1)
    uv, z = uv[there], z[there]
    label = case.observed.edge_label[half[there, 1], half[there, 0]]
    near = np.abs(case.observed.edge_depth[label] - z) < 2.0 * VALUES["depth_gate"]
    uv, z, label = uv[near], z[near], label[near]
    X = case.camera.unproject(uv, z)

    def residual(twist):
        gap = case.camera.project(moved(X, case, twist)) - case.observed.edge_uv[label]
        return np.sum(gap * case.observed.edge_normal[label], axis=1)

    gap = np.linalg.norm(uv - case.observed.edge_uv[label], axis=1)
    return residual, discounted(biweight(gap, VALUES["contour_gate"]), VALUES["contour"], VALUES["contour_bias"])


TERMS = {"depth": depth_terms, "needle": needle_terms, "contour": contour_terms}


def numeric_equations(residual, weight: np.ndarray):
    """Hessian J^T W J and gradient J^T W r by central differences, and the gradient of half the cost likewise."""
    ends = [(residual(STEP * e), residual(-STEP * e)) for e in np.eye(6)]
    J = np.stack([(a - b) / (2 * STEP) for a, b in ends], axis=1)
    half_costs = [(0.5 * np.sum(weight * a**2), 0.5 * np.sum(weight * b**2)) for a, b in ends]
    of_cost = np.array([(a - b) / (2 * STEP) for a, b in half_costs])
    return J.T @ (weight[:, None] * J), of_cost


@jax.jit
def all_equations(R, t, predicted, observed, normal_obj, camera, deviations):
    window = look_up(observed, predicted.origin_uv, SIZE, STRIDE)
    gap = window.depth - predicted.depth
    return {
        "depth": depth_equations(R, t, predicted, window, normal_obj, camera, deviations),
        "needle": needle_equations(R, predicted, window, normal_obj, deviations, gap),
        "contour": contour_equations(t, predicted, observed, camera, deviations),
        "total": total_equations(R, t, predicted, observed, normal_obj, camera, deviations, SIZE, STRIDE),
    }


def equations(case: Case, grazing: float = 1.0) -> dict:
    """What the compiled functions make of the case, in float64."""
    with jax.enable_x64(True):
        c = case.camera
        camera = CameraArrays(*(jnp.asarray(v, float) for v in (c.fx, c.fy, c.cx, c.cy, float(not c.is_orthographic))))
        values = VALUES | {"grazing": grazing}
        deviations = Deviations(**{name: jnp.asarray(value) for name, value in values.items()})
        predicted = Predicted(*(jnp.asarray(a) for a in case.predicted))
        observed = ObservedMaps(*(jnp.asarray(a) for a in case.observed))
        R, t, normal_obj = (jnp.asarray(a) for a in (case.R, case.t, case.normal_obj))
        found = all_equations(R, t, predicted, observed, normal_obj, camera, deviations)
        return {name: tuple(np.asarray(a) for a in value) for name, value in found.items()}


@pytest.mark.parametrize("term", TERMS)
@pytest.mark.parametrize("camera", CAMERAS)
def test_equations_are_those_of_the_residuals(camera, term):
    case = random_case(CAMERAS[camera], seed=len(camera))
    residual, weight = TERMS[term](case)
    assert (weight > 0).sum() > 10
    assert (weight == 0).any()  # something lies beyond its gate
    expected_hessian, expected_gradient = numeric_equations(residual, weight)
    hessian, gradient, cost, information, spread = equations(case)[term]
    scale = np.abs(expected_hessian).max()
    np.testing.assert_allclose(hessian, expected_hessian, rtol=1e-6, atol=1e-9 * scale)
    np.testing.assert_allclose(gradient, expected_gradient, rtol=1e-6, atol=1e-9 * np.abs(expected_gradient).max())
    np.testing.assert_array_equal(information, hessian)  # without a smooth surface
    np.testing.assert_array_equal(spread, hessian)
    np.testing.assert_allclose(cost, np.sum(weight * residual(np.zeros(6)) ** 2), rtol=1e-9)


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("grazing", [0.02, 0.3])
def test_depths_that_err_along_their_rays_count_more_where_the_surface_is_slanted(camera, grazing):
    case = random_case(CAMERAS[camera], seed=7)
    residual, weight = depth_terms(case, grazing)
    hessian, gradient, *_ = equations(case, grazing)["depth"]
    expected_hessian, expected_gradient = numeric_equations(residual, weight)
    np.testing.assert_allclose(hessian, expected_hessian, rtol=1e-6, atol=1e-9 * np.abs(expected_hessian).max())
    np.testing.assert_allclose(gradient, expected_gradient, rtol=1e-6, atol=1e-9 * np.abs(expected_gradient).max())
    assert np.abs(hessian / equations(case)["depth"][0] - 1.0).max() > 0.01  # it does make a difference


@pytest.mark.parametrize("camera", CAMERAS)
def test_hessian_is_symmetric_and_positive_semidefinite(camera):
    found = equations(random_case(CAMERAS[camera], seed=1))
    for hessian, _, cost, *_ in found.values():
        np.testing.assert_allclose(hessian, hessian.T, rtol=0, atol=1e-12 * np.abs(hessian).max())
        values = np.linalg.eigvalsh(hessian)
        assert values[0] > -1e-12 * values[-1]
        assert cost > 0


def test_the_total_is_the_sum():
    found = equations(random_case(CAMERAS["pinhole"], seed=2))
    for k in range(5):
        np.testing.assert_allclose(found["total"][k], sum(found[name][k] for name in TERMS), rtol=1e-12)


def test_needles_say_nothing_of_place():
    hessian, gradient, *_ = equations(random_case(CAMERAS["pinhole"], seed=3))["needle"]
    assert not hessian[3:].any()
    assert not hessian[:, 3:].any()
    assert not gradient[3:].any()


def test_nothing_seen_gives_zero_and_no_nan():
    case = random_case(CAMERAS["pinhole"], seed=4)
    predicted = case.predicted._replace(triangle=np.full((SIZE, SIZE), -1), contour_depth=np.zeros((2, SIZE, SIZE)))
    for found in equations(case._replace(predicted=predicted)).values():
        assert not any(a.any() for a in found)


@pytest.mark.parametrize("origin", [(6.0, 9.0), (-7.0, -3.0), (60.0, 60.0)])
def test_look_up_reads_whole_pixels_and_nothing_outside(origin):
    case = random_case(CAMERAS["pinhole"], seed=5)
    case = case._replace(predicted=case.predicted._replace(origin_uv=np.array(origin)))
    maps = ObservedMaps(*(jnp.asarray(a, jnp.float32) for a in case.observed))
    window = look_up(maps, jnp.asarray(origin), SIZE, STRIDE)
    expected = WindowObservations(window_uv(case), *(at_window(case, a).astype(np.float32) for a in case.observed[:3]))
    for got, want in zip(window, expected, strict=True):
        np.testing.assert_array_equal(got, want)
    assert (expected.depth > 0).any() == (origin[0] < 60)


def test_tukey():
    x = np.array([0.0, 0.25, 0.5, 1.0, 2.0, np.inf])
    np.testing.assert_allclose(tukey(jnp.asarray(x)), [1.0, 0.75**2, 0.25, 0.0, 0.0, 0.0], rtol=1e-6)
