"""Derivatives of the needle map are finite differences where it is smooth, and never NaN."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from itree_jax.sensing.photometric import photometric_stereo
from itree_jax.sensor import Noise

STEP = 1e-6


def numeric_gradient(f, arguments, k):
    gradient = np.zeros_like(arguments[k])
    for index in np.ndindex(*gradient.shape):
        up, down = ([a.copy() for a in arguments] for _ in range(2))
        up[k][index] += STEP
        down[k][index] -= STEP
        gradient[index] = (float(f(*up)) - float(f(*down))) / (2 * STEP)
    return gradient


@pytest.mark.parametrize("lights", [3, 5])
def test_gradient_is_the_finite_difference(lights, make_lights, shade):
    """With respect to images, light directions and intensities."""
    rng = np.random.default_rng(lights)
    L, e = make_lights(lights), np.linspace(0.9, 1.1, lights)
    normals = rng.normal([0.0, 0.0, -1.0], [0.25, 0.25, 0.0], (2, 2, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    arguments = [shade(normals, L, e) + rng.normal(0.0, 2e-3, (lights, 2, 2)), L, e]
    weights = rng.normal(size=(2, 2, 3))

    with jax.enable_x64(True):

        @jax.jit
        def loss(images, L, e):
            needle = photometric_stereo(images, L, e, Noise())
            return (needle.normals * weights).sum() + needle.albedo.sum() + needle.normal_std.sum()

        gradients = jax.grad(loss, argnums=(0, 1, 2))(*(jnp.asarray(a) for a in arguments))
        numeric = [numeric_gradient(loss, arguments, k) for k in range(3)]
    for gradient, expected in zip(gradients, numeric, strict=True):
        assert np.abs(expected).max() > 0.1
        np.testing.assert_allclose(gradient, expected, rtol=1e-5, atol=1e-6)


def test_gradient_of_darkness_is_zero(make_lights):
    images = np.zeros((3, 4, 4), np.float32)
    images[:, 2:] = 0.4
    images[0, 3] = 0.0
    L = make_lights(3)

    def loss(images, L, e):
        needle = photometric_stereo(images, L, e, Noise())
        return (
            needle.normals + needle.albedo[..., None] + needle.normal_std[..., None]
        ).sum() + needle.confidence.sum()

    arguments = (jnp.asarray(images), jnp.asarray(L, jnp.float32), jnp.ones(3, jnp.float32))
    gradients = jax.grad(loss, argnums=(0, 1, 2))(*arguments)
    assert all(np.isfinite(gradient).all() for gradient in gradients)
    np.testing.assert_array_equal(gradients[0][:, [0, 1, 3]], 0.0)
    assert np.abs(gradients[0][:, 2]).min() > 0.0
