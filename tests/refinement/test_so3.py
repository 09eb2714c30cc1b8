"""The exponential map of rotations against SciPy, also at and near zero, and its derivative there."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from itree_jax.refinement.so3 import move, so3_exp

ANGLES = (0.0, 1e-9, 0.99e-4, 1.01e-4, 1e-2, 1.0, 3.1, np.pi)  # the series ends at 1e-4
JACOBIANS = jax.jit(jax.jacfwd(so3_exp)), jax.jit(jax.jacrev(so3_exp))
AXIS = np.array([2.0, -1.0, 0.5]) / np.linalg.norm([2.0, -1.0, 0.5])


@pytest.mark.parametrize("angle", ANGLES)
def test_exponential(angle):
    expected = Rotation.from_rotvec(angle * AXIS).as_matrix()
    with jax.enable_x64(True):
        np.testing.assert_allclose(so3_exp(jnp.asarray(angle * AXIS)), expected, rtol=0, atol=1e-15)
    np.testing.assert_allclose(so3_exp(jnp.asarray(angle * AXIS, jnp.float32)), expected, rtol=0, atol=3e-7)


def test_derivative_at_zero_is_the_cross_product():
    D = jax.jacfwd(so3_exp)(jnp.zeros(3))
    np.testing.assert_array_equal(np.einsum("abk,b->ak", D, [0.3, -0.7, 2.0]), np.cross(np.eye(3), [0.3, -0.7, 2.0]).T)


@pytest.mark.parametrize("angle", ANGLES)
def test_derivative_is_the_finite_difference(angle):
    step = 1e-6
    with jax.enable_x64(True):
        for jacobian in JACOBIANS:
            D = np.asarray(jacobian(jnp.asarray(angle * AXIS)))
            for k in range(3):
                e = step * np.eye(3)[k]
                ends = [Rotation.from_rotvec(angle * AXIS + s * e).as_matrix() for s in (1, -1)]
                np.testing.assert_allclose(D[..., k], (ends[0] - ends[1]) / (2 * step), rtol=0, atol=1e-8)


def test_a_twist_turns_about_the_parts_origin():
    R, t = Rotation.from_rotvec([0.3, 1.0, -0.2]).as_matrix(), np.array([5.0, -3.0, 400.0])
    twist, X_obj = np.array([0.02, -0.1, 0.07, 1.0, 2.0, -3.0]), np.array([7.0, 11.0, -4.0])
    with jax.enable_x64(True):
        R_new, t_new = (np.asarray(a) for a in move(jnp.asarray(R), jnp.asarray(t), jnp.asarray(twist)))
    turned = Rotation.from_rotvec(twist[:3]).apply(R @ X_obj)
    np.testing.assert_allclose(R_new @ X_obj + t_new, turned + t + twist[3:], rtol=0, atol=1e-12)
