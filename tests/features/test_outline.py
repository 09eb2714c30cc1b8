"""Original face shape d(theta) against closed forms."""

import jax.numpy as jnp
import numpy as np
import pytest

from itree_jax.features.inertia import face_inertia, mean_normal
from itree_jax.features.outline import N_THETA, outline
from itree_jax.features.rectify import affine_T, gradient_space


def outline_of(window, alpha: float = 0.0) -> np.ndarray:
    T = affine_T(*gradient_space(mean_normal(window)))
    return np.asarray(outline(window, T, face_inertia(window).centroid, jnp.float32(alpha)))


def theta() -> np.ndarray:
    return np.arange(N_THETA) * 2 * np.pi / N_THETA


@pytest.mark.parametrize(("p", "q"), [(0.0, 0.0), (0.6, 0.6), (-0.8, 0.3)])
def test_the_outline_of_a_disc_is_its_radius_everywhere(make_face_window, p: float, q: float) -> None:
    window = make_face_window(lambda x, y: x**2 + y**2 <= 24**2, p, q)
    np.testing.assert_allclose(outline_of(window), 24.0, atol=1.0)  # one pixel, on the face up to 1.3


@pytest.mark.parametrize(("p", "q"), [(0.0, 0.0), (0.5, -0.4)])
def test_the_outline_of_a_square(make_face_window, p: float, q: float) -> None:
    window = make_face_window(lambda x, y: np.maximum(np.abs(x), np.abs(y)) <= 20, p, q)
    expected = 20 / np.maximum(np.abs(np.cos(theta())), np.abs(np.sin(theta())))
    np.testing.assert_allclose(outline_of(window), expected, atol=1.0)


def test_a_half_turn_of_the_direction_shifts_the_outline_by_half(make_face_window) -> None:
    window = make_face_window(lambda x, y: (x > -10) & (np.abs(y) < 12 - 0.3 * x) & (x < 25), 0.3, 0.2)
    one, other = outline_of(window, 0.7), outline_of(window, 0.7 + np.pi)
    np.testing.assert_allclose(other, np.roll(one, -N_THETA // 2), atol=0.05)
    assert np.abs(other - one).max() > 5  # the face has no two-fold axis: d(theta) tells the half turns apart


def test_the_outline_sees_the_outermost_boundary_behind_a_hole(make_face_window) -> None:
    window = make_face_window(lambda x, y: (np.hypot(x, y) <= 24) & (np.hypot(x, y) >= 10), 0.0, 0.0)
    np.testing.assert_allclose(outline_of(window), 24.0, atol=0.8)


def test_directions_that_meet_nothing_have_distance_0(make_face_window) -> None:
    window = make_face_window(lambda x, y: x > 5, 0.0, 0.0, size=32)
    distances = np.asarray(outline(window, affine_T(jnp.float32(0), jnp.float32(0)), jnp.zeros(2), jnp.float32(0)))
    away = np.cos(theta()) < -1e-6
    np.testing.assert_array_equal(distances[away], 0.0)
    assert distances[0] == pytest.approx(16.0, abs=0.5)  # cut off by the window's border
