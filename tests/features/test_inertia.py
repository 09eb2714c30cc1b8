"""Original face inertia against closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from itree_jax.features.inertia import face_inertia
from itree_jax.features.rectify import face_axes
from itree_jax.features.window import Window


def test_a_rectangle_of_whole_pixels_is_exact() -> None:
    mask = np.zeros((64, 64), dtype=bool)
    mask[10:30, 6:46] = True  # 20 x 40 px of 0.5 mm
    normals = np.where(mask[..., None], np.array([0, 0, -1]), 0).astype(np.float32)
    inertia = face_inertia(Window(mask, normals, np.float32(0.5)))
    assert float(inertia.area) == pytest.approx(20 * 10)
    np.testing.assert_allclose(inertia.centroid, np.array([25.5 - 31.5, 19.5 - 31.5]) * 0.5, rtol=1e-6)
    assert float(inertia.I_max) == pytest.approx(20**3 * 10 / 12, rel=1e-5)
    assert float(inertia.I_min) == pytest.approx(20 * 10**3 / 12, rel=1e-5)
    assert float(inertia.alpha) == pytest.approx(0.0, abs=1e-6)
    assert float(inertia.uniqueness) == pytest.approx((4 - 1) / (4 + 1), rel=1e-5)


def test_the_larger_moment_of_an_upright_rectangle_is_upright(make_face_window) -> None:
    inertia = face_inertia(make_face_window(lambda x, y: (np.abs(x) < 5) & (np.abs(y) < 15), 0.0, 0.0))
    assert abs(float(inertia.alpha)) == pytest.approx(np.pi / 2)


@pytest.mark.parametrize(("p", "q"), [(0.0, 0.0), (0.7, -0.5), (-0.9, 0.1)])
def test_a_disc_has_equal_moments_and_no_direction(make_face_window, p: float, q: float) -> None:
    radius = 20.0
    inertia = face_inertia(make_face_window(lambda x, y: x**2 + y**2 <= radius**2, p, q))
    assert float(inertia.area) == pytest.approx(np.pi * radius**2, rel=0.01)
    assert float(inertia.I_max) == pytest.approx(np.pi * radius**4 / 4, rel=0.02)
    assert float(inertia.uniqueness) < 0.01


@pytest.mark.parametrize(("p", "q"), [(0.8, 0.3), (-0.4, 0.7)])
def test_the_direction_is_the_long_axis_in_space(make_face_window, p: float, q: float) -> None:
    turn = 0.6

    def inside(x, y):
        u, v = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
        return (np.abs(u) <= 22) & (np.abs(v) <= 6)

    inertia = face_inertia(make_face_window(inside, p, q))
    e1, e2 = (np.asarray(e) for e in face_axes(jnp.float32(p), jnp.float32(q)))
    measured = np.cos(inertia.alpha) * e1 + np.sin(inertia.alpha) * e2
    truth = np.cos(turn) * e1 + np.sin(turn) * e2
    assert abs(measured @ truth) > np.cos(np.radians(1.0))


def test_an_empty_region_is_zero_and_finite() -> None:
    empty = Window(np.zeros((8, 8), dtype=bool), np.zeros((8, 8, 3), dtype=np.float32), np.float32(1))
    for value in face_inertia(empty):
        np.testing.assert_array_equal(value, np.zeros_like(value))


def test_a_square_has_a_finite_derivative(make_face_window) -> None:
    window = make_face_window(lambda x, y: (np.abs(x) < 8) & (np.abs(y) < 8), 0.0, 0.0)

    def moments(normals):
        inertia = face_inertia(window._replace(normals=normals))
        return inertia.I_max + inertia.alpha

    assert np.isfinite(jax.jit(jax.grad(moments))(jnp.asarray(window.normals))).all()
