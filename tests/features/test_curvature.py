"""Gaussian and mean curvature against closed forms (Ikeuchi 1987, sec. 5.2)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from itree_jax.features.curvature import curvatures, fit_needles
from itree_jax.features.window import Window

measured = jax.jit(curvatures)
angle = st.floats(-3.0, 3.0, width=32)


def on_region(window: Window) -> tuple[np.ndarray, np.ndarray]:
    """K and H of the pixels that have them: nearly the whole region."""
    result = measured(window)
    valid = np.asarray(result.valid)
    assert valid.sum() > 0.9 * np.asarray(window.mask).sum()
    return np.asarray(result.K)[valid], np.asarray(result.H)[valid]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("radius", [8.0, 25.0])
@pytest.mark.parametrize("off_axis", [0.0, 0.75])
def test_a_sphere_seen_at_any_slant(make_surface_window, shapes, sign: float, radius: float, off_axis: float) -> None:
    at = off_axis * radius  # slants up to 60 degrees
    window = make_surface_window(
        shapes.sphere(radius, sign), lambda u, v: (np.hypot(u - at, v) < 0.5 * radius), pitch=radius / 20
    )
    K, H = on_region(window)
    np.testing.assert_allclose(K, 1 / radius**2, rtol=1e-3)
    np.testing.assert_allclose(H, sign / radius, rtol=1e-3)


@settings(max_examples=20, deadline=None)
@given(tilt=st.floats(-0.75, 0.75, width=32), roll=angle, sign=st.sampled_from([-1.0, 1.0]))
def test_a_cylinder_at_any_tilt_and_roll(make_surface_window, shapes, tilt: float, roll: float, sign: float) -> None:
    radius = 20.0
    window = make_surface_window(
        shapes.cylinder(radius, tilt, sign), lambda u, v: np.abs(u) < 25, roll, slant_limit=np.radians(55)
    )
    K, H = on_region(window)
    # Over the neighbourhood a tilted circle is no straight line in the normals: 8 % at the region's border.
    np.testing.assert_allclose(K, 0.0, atol=0.1 / radius**2)
    np.testing.assert_allclose(H, sign / (2 * radius), rtol=0.08)
    assert np.median(H) == pytest.approx(sign / (2 * radius), rel=0.01)
    assert abs(np.median(K)) < 0.01 / radius**2


@settings(max_examples=20, deadline=None)
@given(p=st.floats(-1.5, 1.5, width=32), q=st.floats(-1.5, 1.5, width=32))
def test_a_plane_at_any_slant_is_flat(make_face_window, p: float, q: float) -> None:
    K, H = on_region(make_face_window(lambda x, y: np.hypot(x, y) < 20, p, q, size=48))
    np.testing.assert_allclose(K, 0.0, atol=1e-9)
    np.testing.assert_allclose(H, 0.0, atol=1e-5)


@pytest.mark.parametrize("roll", [0.0, 0.4, 2.0])
def test_the_inner_side_of_a_torus_is_a_saddle(make_surface_window, shapes, roll: float) -> None:
    profile, centre, pitch, size = 30.0, 50.0, 0.5, 48
    window = make_surface_window(
        shapes.neck(profile, centre), lambda u, v: np.hypot(u, v) < 10, roll, pitch=pitch, size=size
    )
    offset = (np.arange(size) - (size - 1) / 2) * pitch
    x, y = np.meshgrid(offset, offset)
    u = np.cos(roll) * x + np.sin(roll) * y
    lean = np.sqrt(1 - (u / profile) ** 2)
    around, along = lean / (centre - profile * lean), -1 / profile
    result = measured(window)
    valid = np.asarray(result.valid)
    np.testing.assert_allclose(np.asarray(result.K)[valid], (around * along)[valid], rtol=0.02)
    np.testing.assert_allclose(np.asarray(result.H)[valid], ((around + along) / 2)[valid], atol=0.015 / profile)


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_quarter_turns_of_the_image_turn_K_and_H(make_surface_window, shapes, turns: int) -> None:
    window = make_surface_window(shapes.cylinder(20.0, 0.5), lambda u, v: np.abs(u - 4) < 20, 0.3, needle_std=0.02)
    c, s = np.cos(turns * np.pi / 2), np.sin(turns * np.pi / 2)
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]], dtype=np.float32)  # rot90 goes from x toward -y
    turned = Window(np.rot90(window.mask, turns), np.rot90(window.normals, turns) @ turn.T, window.pitch)
    one, other = measured(window), measured(turned)
    for a, b in zip(one, other, strict=True):
        np.testing.assert_allclose(np.rot90(a, turns), b, atol=1e-6)


def test_what_lies_off_the_region_has_no_weight(make_surface_window, shapes) -> None:
    window = make_surface_window(shapes.sphere(30.0), lambda u, v: (np.abs(u) < 12) & (np.abs(v) < 12))
    rubbish = np.where(window.mask[..., None], window.normals, np.float32(0.7))
    for a, b in zip(measured(window), measured(window._replace(normals=rubbish)), strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_region_two_pixels_wide_has_no_curvature_and_three_pixels_do(make_surface_window, shapes) -> None:
    for width, has in ((2, False), (3, True)):
        window = make_surface_window(shapes.sphere(30.0), lambda u, v: np.abs(v) < 20, pitch=1.0)
        mask = window.mask.copy()
        mask[:, :24] = False
        mask[:, 24 + width :] = False
        result = measured(Window(mask, np.where(mask[..., None], window.normals, 0), window.pitch))
        np.testing.assert_array_equal(result.valid, mask & has)
        np.testing.assert_array_equal(np.asarray(result.K)[~np.asarray(result.valid)], 0.0)


def test_the_noise_of_the_slopes_is_the_gain_times_that_of_the_needles(make_surface_window, shapes) -> None:
    std = 0.02
    window = make_surface_window(shapes.plane(0, 0), lambda u, v: np.hypot(u, v) < 35, needle_std=std)
    fit = jax.jit(fit_needles)(window)
    inner = np.asarray(fit.freedom) == 2 * (25 - 3)
    slopes = np.asarray(fit.slope)[inner].reshape(-1)
    assert slopes.std() == pytest.approx(std * float(np.asarray(fit.gain)[inner].mean()), rel=0.1)
    assert np.sqrt(np.asarray(fit.residual)[inner].mean()) == pytest.approx(std, rel=0.05)


def test_a_batch_equals_its_windows_one_by_one(make_surface_window, shapes) -> None:
    windows = [
        make_surface_window(shapes.sphere(r), lambda u, v: np.hypot(u, v) < 20) for r in (30.0, 50.0, 90.0)
    ]
    batch = jax.jit(jax.vmap(curvatures))(Window(*(np.stack(field) for field in zip(*windows, strict=True))))
    for k, window in enumerate(windows):
        for many, one in zip(batch, measured(window), strict=True):
            np.testing.assert_allclose(many[k], one, atol=1e-7)


def test_an_empty_region_is_zero_with_a_finite_derivative() -> None:
    def total(normals):
        K, H, _ = curvatures(Window(np.zeros((8, 8), dtype=bool), normals, np.float32(1)))
        return jnp.sum(K + H)

    value, slope = jax.jit(jax.value_and_grad(total))(jnp.zeros((8, 8, 3)))
    assert float(value) == 0.0
    np.testing.assert_array_equal(slope, 0.0)
