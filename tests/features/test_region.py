"""All work models of a region, one by one and in batches."""

import jax
import numpy as np
import pytest

from itree_jax.features.region import measure, measure_batch
from itree_jax.features.window import Window


def stack(windows: list[Window]) -> Window:
    return Window(*(np.stack(field) for field in zip(*windows, strict=True)))


def cylinder_window(radius: float, size: int = 64) -> Window:
    """A cylinder along x seen from the side, as far as slants of 60 degrees."""
    offset = np.arange(size) - (size - 1) / 2
    x, y = np.meshgrid(offset, offset)
    mask = (np.abs(y) < radius * np.sin(np.pi / 3)) & (np.abs(x) < 10)
    towards = np.sqrt(np.maximum(1 - (y / radius) ** 2, 0))
    normals = np.stack([np.zeros_like(y), y / radius, -towards], axis=-1)
    return Window(mask, np.where(mask[..., None], normals, 0).astype(np.float32), np.float32(1.0))


def test_a_batch_equals_its_regions_one_by_one(make_face_window) -> None:
    gradients = np.random.default_rng(0).uniform(-0.8, 0.8, (19, 2))
    windows = [make_face_window(lambda x, y: (np.abs(x) < 18) & (np.abs(y) < 7), p, q, size=48) for p, q in gradients]
    batch, alone = measure_batch(stack(windows)), jax.jit(measure)
    for k in (0, 7, 18):
        for one, many in zip(jax.tree.leaves(alone(windows[k])), jax.tree.leaves(batch), strict=True):
            np.testing.assert_allclose(many[k], one, rtol=2e-4, atol=2e-3)


def test_a_plane_has_no_scatter_and_its_egi_is_its_area_at_its_normal(make_face_window) -> None:
    features = measure(make_face_window(lambda x, y: np.hypot(x, y) < 20, 0.4, -0.3))
    np.testing.assert_allclose(features.normal_scatter, 0.0, atol=1e-6)
    np.testing.assert_allclose(features.mean_normal, np.array([0.4, -0.3, -1]) / np.sqrt(1.25), rtol=1e-5)
    np.testing.assert_allclose(features.mass_centre, features.mean_normal, atol=1e-5)
    assert float(features.area) == pytest.approx(np.pi * 20**2, rel=0.01)
    assert float(features.inertia.area) == pytest.approx(float(features.area), rel=1e-5)
    assert float(features.egi.sum()) == pytest.approx(float(features.area), rel=1e-5)


def test_a_cylinder_scatters_its_normals_along_one_axis() -> None:
    radius = 22 / np.sin(np.pi / 3)  # 60 degrees end between two rows of pixels
    features = measure(cylinder_window(radius))
    # sin(phi) over |phi| <= 60 degrees, uniform in sin(phi) over the pixels: variance s^2/3.
    np.testing.assert_allclose(features.normal_scatter, [0.75 / 3, 0.0], atol=0.01)
    assert float(features.area) == pytest.approx(20 * radius * 2 * np.pi / 3, rel=0.001)
    # Mass centre by surface: mean of cos(phi) over the arc = sin(60)/(pi/3).
    np.testing.assert_allclose(features.mass_centre, [0, 0, -np.sin(np.pi / 3) / (np.pi / 3)], atol=0.005)


def test_a_region_is_measured_alike_whatever_else_is_in_the_batch(make_face_window) -> None:
    one = make_face_window(lambda x, y: np.hypot(x, y) < 15, 0.2, 0.1, size=48)
    empty = Window(np.zeros((48, 48), bool), np.zeros((48, 48, 3), np.float32), np.float32(1))
    alone = measure_batch(stack([one, empty]))
    other = measure_batch(stack([one, make_face_window(lambda x, y: x > 0, 0.5, 0.0, size=48)]))
    for a, b in zip(jax.tree.leaves(alone), jax.tree.leaves(other), strict=True):
        np.testing.assert_array_equal(a[0], b[0])
    for value in jax.tree.leaves(alone):
        assert np.isfinite(value).all()
    assert float(alone.area[1]) == 0.0
    np.testing.assert_array_equal(alone.mean_normal[1], [0, 0, -1])


def test_the_features_have_finite_derivatives_in_the_normals(make_face_window) -> None:
    window = make_face_window(lambda x, y: (np.abs(x) < 12) & (np.abs(y) < 7), 0.3, 0.2, size=32)

    def total(normals):
        return sum(leaf.sum() for leaf in jax.tree.leaves(measure(window._replace(normals=normals))))

    assert np.isfinite(jax.jit(jax.grad(total))(jax.numpy.asarray(window.normals))).all()
