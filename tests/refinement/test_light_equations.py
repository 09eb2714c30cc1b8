"""The blocks of normal equations: Jacobians by finite differences, sums and weights by their definition, gauges."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from itree_jax.refinement.joint_equations import JointEquations, Layout, light_prior, photometric_part, solved
from itree_jax.refinement.light_equations import (
    LitPixels,
    ModelErrors,
    light_equations,
    light_jacobian,
    predicted_intensity,
)

PARTS, LIGHTS, PIXELS, PATCHES = 2, 3, 60, 7
STEP = 1e-6
ERRORS = ModelErrors(*(jnp.float32(v) for v in (0.01, 0.02, 0.1)))
SHARE = 0.7
ALBEDO = np.array([0.6, 0.3])


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def case(seed: int = 0, noise: float = 0.01):
    rng = np.random.default_rng(seed)
    normal = unit(rng.normal([0, 0, -1.5], 0.5, (PIXELS, 3)))
    lights = unit(rng.normal([0, 0, -1.5], 0.6, (LIGHTS, 3))) * rng.uniform(0.8, 1.2, (LIGHTS, 1))
    part, reflected = rng.integers(0, PARTS, PIXELS), rng.uniform(0.0, 0.1, (PIXELS, LIGHTS))
    x = ALBEDO[part][:, None] * (normal @ lights.T + SHARE * reflected) + noise * rng.normal(size=(PIXELS, LIGHTS))
    x[0] += 1.0  # a highlight
    used = rng.random((PIXELS, LIGHTS)) < 0.8
    std = rng.uniform(0.003, 0.006, x.shape)
    pixels = LitPixels(x, std, used, reflected, normal, part, rng.integers(0, PATCHES, PIXELS))
    return pixels, lights


def blocks_of(pixels: LitPixels, lights: np.ndarray, albedo=ALBEDO, share=SHARE):
    as32 = LitPixels(*(jnp.asarray(a, jnp.float32) if a.dtype.kind == "f" else jnp.asarray(a) for a in pixels))
    as32 = as32._replace(part=as32.part.astype(jnp.int32), patch=as32.patch.astype(jnp.int32))
    arrays = (jnp.asarray(lights, jnp.float32), jnp.asarray(albedo, jnp.float32), jnp.float32(share))
    return jax.tree.map(np.asarray, light_equations(as32, *arrays, ERRORS, PARTS, PATCHES))


def test_jacobian_by_finite_differences():
    pixels, lights = case()
    with jax.enable_x64(True):
        a = jnp.asarray(ALBEDO[pixels.part])
        normal, reflected = jnp.asarray(pixels.normal), jnp.asarray(pixels.reflected)
        J = np.asarray(light_jacobian(normal, reflected, jnp.asarray(lights), a, SHARE))

        def at(block: np.ndarray) -> np.ndarray:
            """Every light moved by the same block of unknowns."""
            n = Rotation.from_rotvec(block[:3]).apply(pixels.normal)
            arrays = (jnp.asarray(n), reflected, jnp.asarray(lights + block[3:6]))
            return np.asarray(predicted_intensity(*arrays, a * float(np.exp(block[6])), SHARE + block[7]))

        numeric = np.stack([(at(STEP * e) - at(-STEP * e)) / (2 * STEP) for e in np.eye(8)], axis=-1)
    np.testing.assert_allclose(J, numeric, rtol=0, atol=1e-9)


def test_sums_are_those_of_weighted_residuals():
    pixels, lights = case()
    found = blocks_of(pixels, lights)
    a = ALBEDO[pixels.part][:, None]
    residual = pixels.intensity - a * (pixels.normal @ lights.T + SHARE * pixels.reflected)
    full = a * np.linalg.norm(lights, axis=1)
    squared = residual**2 / ((4 * pixels.std) ** 2 + (0.1 * full) ** 2)
    robust = pixels.used * np.clip(1 - squared, 0, 1) ** 2
    number = np.stack([robust[pixels.patch == f].sum(axis=0) for f in range(PATCHES)])
    weight = robust / (pixels.std**2 + full**2 * (0.01**2 + number[pixels.patch] * 0.02**2))
    J = np.asarray(light_jacobian(*(jnp.asarray(v) for v in (pixels.normal, pixels.reflected, lights, a[:, 0])), SHARE))
    for k in range(PARTS):
        own = pixels.part == k
        H = np.einsum("pl,pla,plb->lab", weight[own], J[own], J[own])
        np.testing.assert_allclose(found.hessian[k], H, rtol=1e-3, atol=1e-4 * np.abs(H).max())
        g = np.einsum("pl,pla,pl->la", weight[own], J[own], residual[own])
        np.testing.assert_allclose(found.gradient[k], g, rtol=1e-3, atol=2e-3 * np.abs(g).max())
        assert found.count[k].sum() == pixels.used[own].sum()
    mean = np.stack([(robust * residual / full)[pixels.patch == f].sum(axis=0) for f in range(PATCHES)])
    np.testing.assert_allclose(found.patch_residual, mean / np.maximum(number, 1e-6), atol=1e-4)
    assert robust[0].max() == 0.0  # the highlight is left out


def test_scale_and_a_common_turn_change_no_image():
    """Null vectors of the photometric equations: lights up and albedo down; poses and lights turned together."""
    pixels, lights = case(noise=0.0)
    layout = Layout(PARTS, LIGHTS, 2)
    H = photometric_part(layout, blocks_of(pixels._replace(reflected=0 * pixels.reflected), lights), [0, 1]).hessian
    scale = np.zeros(layout.size)
    scale[layout.all_lights], scale[layout.albedos] = lights.ravel(), -1.0
    turn, omega = np.zeros(layout.size), np.array([0.3, -0.5, 0.8])
    for k in range(PARTS):
        turn[layout.pose(k)][:3] = omega
    turn[layout.all_lights] = np.cross(omega, lights).ravel()
    for null in (scale, turn):
        assert abs(null @ H @ null) < 1e-5 * np.abs(H).max()
    only_one = turn.copy()
    only_one[layout.pose(0)] = 0.0
    assert only_one @ H @ only_one > 1e-3 * np.abs(H).max()


def test_the_mean_intensity_is_held():
    layout = Layout(1, LIGHTS, 1)
    rng = np.random.default_rng(2)
    A = rng.normal(size=(layout.size, layout.size))
    lights = case()[1]
    step, covariance = solved(layout, JointEquations(A @ A.T, rng.normal(size=layout.size)), lights)
    along = np.sum(step[layout.all_lights].reshape(-1, 3) * unit(lights), axis=1)
    assert abs(along.mean()) < 1e-9 * np.abs(step).max()
    np.testing.assert_allclose(covariance, covariance.T, atol=1e-8 * np.abs(covariance).max())
    assert np.linalg.eigvalsh(covariance)[0] > -1e-8 * np.abs(covariance).max()


def test_nothing_used_gives_zero_and_no_nan():
    pixels, lights = case()
    found = blocks_of(pixels._replace(used=np.zeros_like(pixels.used)), lights)
    assert not any(np.any(a) for a in found)


@pytest.mark.parametrize("e", [0.5, 2.0])
def test_the_prior_is_in_degrees_and_percent(e):
    g = e * unit(np.array([0.3, 0.2, -0.8]))
    H = light_prior(g)
    across = np.cross(g, [0.0, 0.0, 1.0])
    across *= e * np.radians(2.0) / np.linalg.norm(across)
    assert across @ H @ across == pytest.approx(1.0)
    assert (0.04 * g) @ H @ (0.04 * g) == pytest.approx(1.0)
