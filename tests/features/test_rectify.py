"""T undoes foreshortening (Ikeuchi 1987, sec. 2.1.3, corrected)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from itree_jax.features.inertia import face_inertia
from itree_jax.features.rectify import affine_T, face_axes, gradient_space

gradient = st.floats(-2.0, 2.0, width=32)
offset = st.floats(-50.0, 50.0, width=32)


@settings(max_examples=50, deadline=None)
@given(p=gradient, q=gradient, x=offset, y=offset)
def test_T_of_a_projected_vector_is_its_coordinates_in_the_face_axes(p: float, q: float, x: float, y: float) -> None:
    T = np.asarray(affine_T(jnp.float32(p), jnp.float32(q)))
    e1, e2 = (np.asarray(e) for e in face_axes(jnp.float32(p), jnp.float32(q)))
    V = np.array([x, y, p * x + q * y])
    np.testing.assert_allclose(T @ [x, y], [e1 @ V, e2 @ V], atol=2e-4)
    np.testing.assert_allclose(np.linalg.norm(T @ [x, y]), np.linalg.norm(V), rtol=1e-5, atol=1e-4)


@settings(max_examples=50, deadline=None)
@given(p=gradient, q=gradient)
def test_det_T_is_one_over_cos_slant_and_the_axes_are_a_frame_of_the_face(p: float, q: float) -> None:
    normal = np.array([p, q, -1.0]) / np.sqrt(1 + p**2 + q**2)
    assert np.linalg.det(affine_T(jnp.float32(p), jnp.float32(q))) == pytest.approx(1 / -normal[2], rel=1e-5)
    e1, e2 = (np.asarray(e) for e in face_axes(jnp.float32(p), jnp.float32(q)))
    frame = np.stack([e1, e2, -normal])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-6)
    assert np.linalg.det(frame) == pytest.approx(1.0, abs=1e-5)
    np.testing.assert_allclose(gradient_space(jnp.asarray(7.0 * normal, dtype=jnp.float32)), (p, q), atol=1e-5)


@pytest.mark.parametrize("normal", [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.5, 0.5)])
def test_a_normal_that_does_not_face_the_viewer_has_a_finite_gradient(normal: tuple[float, float, float]) -> None:
    value, slope = jax.value_and_grad(lambda n: sum(gradient_space(n)))(jnp.array(normal))
    assert np.isfinite(value)
    assert np.isfinite(slope).all() or normal == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(("p", "q"), [(0.0, 0.0), (0.8, 0.0), (0.0, -0.8), (0.5, 0.7), (-0.6, 0.4)])
@pytest.mark.parametrize("turn", [0.0, 0.5, 1.3])
def test_a_tilted_rectangle_is_recovered_to_within_pixel_error(make_face_window, p, q, turn) -> None:
    long_side, short_side, pitch = 40.0, 20.0, 1.0

    def inside(x, y):
        u, v = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
        return (np.abs(u) <= long_side / 2) & (np.abs(v) <= short_side / 2)

    inertia = face_inertia(make_face_window(inside, p, q, pitch))
    # A rectangle a x b has moments a^3 b/12 and a b^3/12 on an area a b: both sides follow from them.
    sides = np.sqrt(12 * np.array([inertia.I_max, inertia.I_min]) / inertia.area)
    pixel_on_face = pitch * np.sqrt(1 + p**2 + q**2)  # along the steepest direction
    np.testing.assert_allclose(sides, [long_side, short_side], atol=pixel_on_face)
    assert np.abs(np.sin(inertia.alpha - turn)) < pitch / long_side
