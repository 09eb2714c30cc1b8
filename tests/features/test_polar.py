"""Polar maps: a rotation of the region moves them by cells, and a circular correlation finds it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from itree_jax.features.polar import ANGLES, RADII, face_angle, polar_map, polar_place, strongest, turn_correlation
from itree_jax.features.rectify import affine_T, face_axes
from itree_jax.features.window import Window

CELL = 2.0 * np.pi / ANGLES


def scattered(seed: int, count: int = 40) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places in cells and radians, and two positive values at each."""
    rng = np.random.default_rng(seed)
    radius, angle = rng.uniform(0, RADII + 1, count), rng.uniform(-8, 8, count)
    return radius.astype(np.float32), angle.astype(np.float32), rng.uniform(0, 3, (count, 2)).astype(np.float32)


def map_of(radius, angle, values) -> np.ndarray:
    return np.asarray(polar_map(*map(jnp.asarray, (radius, angle, values))))


@pytest.mark.parametrize("cells", [1, 5, -3, ANGLES])
def test_a_rotation_by_cells_moves_the_map_by_cells(cells):
    radius, angle, values = scattered(0)
    turned = map_of(radius, angle + np.float32(cells * CELL), values)
    np.testing.assert_allclose(turned, np.roll(map_of(radius, angle, values), cells, axis=1), atol=2e-4)


@given(st.integers(0, 10_000))
@settings(deadline=None, max_examples=25)
def test_all_mass_is_in_the_map(seed):
    radius, angle, values = scattered(seed)
    np.testing.assert_allclose(map_of(radius, angle, values).sum(axis=(0, 1)), values.sum(axis=0), rtol=1e-5)


def test_a_cells_middle_belongs_to_it_alone_and_a_border_to_both_sides():
    one = np.ones((1, 1), np.float32)
    middle = map_of(np.float32([2.5]), np.float32([3 * CELL]), one)[..., 0]
    assert middle[2, 3] == pytest.approx(1.0, abs=1e-5)
    between = map_of(np.float32([3.0]), np.float32([-0.5 * CELL]), one)[..., 0]
    np.testing.assert_allclose(between[[2, 2, 3, 3], [-1, 0, -1, 0]], 0.25, atol=1e-5)
    far = map_of(np.float32([99.0]), np.float32([0.0]), one)[..., 0]
    assert far[-1, 0] == pytest.approx(1.0)


def correlation_twin(observed: np.ndarray, model: np.ndarray) -> np.ndarray:
    """Cosine of the observed map and the model's after each turn, one by one."""
    norm = np.linalg.norm(observed) * np.linalg.norm(model)
    return np.array([np.sum(observed * np.roll(model, k, axis=1)) for k in range(observed.shape[1])]) / norm


def test_the_correlation_is_that_of_every_turn_and_finds_the_right_one():
    model = map_of(*scattered(1))
    for k in (0, 7, 31):
        observed = np.roll(model, k, axis=1) * 2.5  # brightness does not matter
        found = np.asarray(turn_correlation(jnp.asarray(observed), jnp.asarray(model)))
        np.testing.assert_allclose(found, correlation_twin(observed, model), atol=1e-5)
        assert found.argmax() == k
        assert found[k] == pytest.approx(1.0, abs=1e-5)


def test_the_correlation_broadcasts_over_leading_axes():
    observed = np.stack([map_of(*scattered(s)) for s in range(2)])[:, None]
    models = np.stack([map_of(*scattered(s)) for s in range(3)])
    found = np.asarray(turn_correlation(jnp.asarray(observed), jnp.asarray(models)))
    assert found.shape == (2, 3, ANGLES)
    for i, k in np.ndindex(2, 3):
        np.testing.assert_allclose(found[i, k], correlation_twin(observed[i, 0], models[k]), atol=1e-5)


def test_no_turn_makes_a_map_of_its_mirror_image():
    radius, angle, values = scattered(2)
    mirrored = map_of(radius, -angle, values)
    found = np.asarray(turn_correlation(jnp.asarray(map_of(radius, angle, values)), jnp.asarray(mirrored)))
    assert found.max() < 0.9
    assert np.asarray(turn_correlation(jnp.asarray(mirrored), jnp.asarray(mirrored))).max() > 0.999


def test_an_empty_map_is_like_nothing_and_has_derivatives():
    empty, full = jnp.zeros((RADII, ANGLES, 2)), jnp.asarray(map_of(*scattered(3)))
    for pair in ((empty, full), (full, empty), (empty, empty)):
        np.testing.assert_array_equal(turn_correlation(*pair), 0.0)
    gradient = jax.grad(lambda m: turn_correlation(m, full).sum())(empty)
    assert np.isfinite(gradient).all()


def test_places_are_those_of_the_face():
    """Radius and angle of every pixel from the 3-D point, for a tilted plane."""
    p, q, pitch, size = 0.5, -0.3, 1.5, 16
    centroid, alpha = np.float32([2.0, -1.0]), 0.4
    window = Window(np.ones((size, size), bool), np.zeros((size, size, 3), np.float32), np.float32(pitch))
    T = affine_T(jnp.float32(p), jnp.float32(q))
    radius, angle = map(np.asarray, polar_place(window, T, jnp.asarray(centroid), jnp.float32(alpha)))
    offset = (np.arange(size) - (size - 1) / 2) * pitch
    x, y = np.meshgrid(offset - centroid[0], offset - centroid[1])
    X = np.stack([x, y, p * x + q * y], axis=-1).reshape(-1, 3)
    e1, e2 = (np.asarray(e) for e in face_axes(jnp.float32(p), jnp.float32(q)))
    np.testing.assert_allclose(radius, np.linalg.norm(X, axis=1) / (size * pitch / 2 / RADII), rtol=1e-5)
    expected = np.arctan2(X @ e2, X @ e1) - alpha
    np.testing.assert_allclose(np.exp(1j * angle), np.exp(1j * expected), atol=1e-5)


def test_the_direction_of_an_edge_is_that_on_the_face():
    p, q = 0.7, 0.4
    e1, e2 = (np.asarray(e) for e in face_axes(jnp.float32(p), jnp.float32(q)))
    phi = np.linspace(-1.5, 1.5, 9)
    double = 0.8 * np.stack([np.cos(2 * phi), np.sin(2 * phi)], axis=-1).astype(np.float32)
    along = np.stack([np.cos(phi), np.sin(phi), p * np.cos(phi) + q * np.sin(phi)], axis=-1)
    expected = np.arctan2(along @ e2, along @ e1)
    found = face_angle(jnp.asarray(double), jnp.float32(p), jnp.float32(q))
    np.testing.assert_allclose(np.exp(2j * np.asarray(found)), np.exp(2j * expected), atol=1e-5)  # up to a half turn


def test_the_strongest_places_are_kept_and_the_rest_counts_nothing():
    values = np.arange(10, dtype=np.float32)[:, None]
    weight = np.float32([0, 5, 0, 1, 0, 3, 0, 0, 2, 0])
    index, kept = map(np.asarray, strongest(jnp.asarray(values), jnp.asarray(weight), 6))
    assert index[:4].tolist() == [1, 5, 8, 3]
    np.testing.assert_array_equal(kept[:, 0], [1, 5, 8, 3, 0, 0])
    assert strongest(jnp.asarray(values), jnp.asarray(weight), 99)[0].shape == (10,)
