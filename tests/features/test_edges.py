"""The edge map: steps count, whatever their direction, sign and light; shading and noise don't."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from itree_jax.features.edges import EdgeMap, edge_map, seen_by

SIZE = 48
INNER = slice(4, -4)  # away from the window's rim, where an edge ends
measured = jax.jit(edge_map)


def drawn(values, samples: int = 4) -> np.ndarray:
    """An image of `values(x, y)`, x and y from the window's centre [px], each pixel the mean of `samples`^2 points."""
    offset = (np.arange(SIZE * samples) + 0.5) / samples - SIZE / 2
    image = values(*np.meshgrid(offset, offset))
    return image.reshape(SIZE, samples, SIZE, samples).mean(axis=(1, 3)).astype(np.float32)


def step(degrees: float, low: float = 0.3, high: float = 0.6, samples: int = 4) -> np.ndarray:
    """A straight edge in this direction, a little off the centre of its pixels."""
    phi = np.radians(degrees)
    return drawn(lambda x, y: np.where(y * np.cos(phi) - x * np.sin(phi) > 0.13, high, low), samples)


def edges_of(*images: np.ndarray, std: float = 1e-4) -> EdgeMap:
    return EdgeMap(*map(np.asarray, measured(jnp.stack([jnp.asarray(i) for i in images]), std)))


def strength(edges) -> np.ndarray:
    return np.linalg.norm(np.asarray(edges), axis=-1)


@pytest.mark.parametrize("samples", [1, 4])
@pytest.mark.parametrize("degrees", [0, 10, 22, 45, 63, 90, 117, 170])
def test_a_step_is_a_thin_band_in_its_direction(degrees: float, samples: int) -> None:
    edges = edges_of(step(degrees, samples=samples)).edges[INNER, INNER]
    s = strength(edges)
    phi = np.radians(degrees)
    length = (SIZE - 8) / max(abs(np.cos(phi)), abs(np.sin(phi)))
    assert 0.9 < s.sum() / length < 2.1  # 1 to 2 pixels wide
    assert s.max() == pytest.approx(1.0)
    off = np.degrees(np.arctan2(edges[..., 1], edges[..., 0]) / 2) - degrees
    off = np.abs((off + 90) % 180 - 90)[s > 0.05]
    assert off.max() < (10.0 if samples == 1 else 3.0)  # whole pixels make steps
    y, x = np.nonzero(s > 0.05)
    away = (y + 4.5 - SIZE / 2) * np.cos(phi) - (x + 4.5 - SIZE / 2) * np.sin(phi) - 0.13
    assert np.abs(away).max() < 1.5


def test_the_strength_does_not_depend_on_the_exposure() -> None:
    weak = step(30, 0.5, 0.6)
    whole, eighth = edges_of(weak, std=0).edges, edges_of(weak / 8, std=0).edges
    assert 0.05 < strength(whole)[INNER, INNER].max() < 0.7
    np.testing.assert_allclose(whole, eighth, atol=1e-5)


def test_the_sign_of_the_contrast_does_not_matter_nor_do_equal_lights() -> None:
    rising, falling = step(30), step(30, 0.6, 0.3)
    one = edges_of(rising)
    for images in ([falling], [rising, falling], [rising, rising, rising]):
        several = edges_of(*images)
        np.testing.assert_allclose(several.edges, one.edges, atol=1e-4)
        assert several.lights_share[strength(several.edges) > 0.05].min() > 0.99


def test_an_edge_under_one_light_keeps_its_strength_and_is_told_apart() -> None:
    flat = np.full((SIZE, SIZE), 0.5, np.float32)
    shadow, crease = step(20, 0.0, 0.6), step(110)
    edges = edges_of(shadow + 0.6 * (crease - 0.45), crease, flat)
    there = strength(edges_of(shadow).edges) > 0.5
    away = np.abs(np.arange(SIZE) - SIZE / 2) > 6
    there &= away[:, None] | away[None]  # where the two don't cross
    there[:4] = there[-4:] = False
    assert strength(edges.edges)[there].min() > 0.5
    np.testing.assert_allclose(edges.lights_share[there], 1 / 3, atol=0.05)
    twice = np.asarray(seen_by(EdgeMap(*map(jnp.asarray, edges)), lights=3))
    assert strength(twice)[there].max() < 1e-3
    both = (strength(edges_of(crease).edges) > 0.5) & away[:, None]
    assert strength(twice)[both].mean() > 0.8


@pytest.mark.parametrize("radius", [12.0, 20.0, 40.0])
@pytest.mark.parametrize("light", [(0, -0.5736, -0.8192), (-0.4967, 0.2868, -0.8192), (0.5736, 0, -0.8192)])
def test_the_shading_of_a_cylinder_is_no_edge(radius: float, light: tuple[float, float, float]) -> None:
    """Up to 60 degrees of slant, more than photometric stereo sees; the border of its own shadow included."""
    x = np.arange(SIZE) - (SIZE - 1) / 2
    across = np.clip(x / radius, -1, 1)
    normal = np.stack([across, np.zeros(SIZE), -np.sqrt(1 - across**2)], axis=-1)
    image = np.broadcast_to(np.maximum(normal @ np.array(light), 0.0), (SIZE, SIZE)).astype(np.float32)
    s = strength(edges_of(image).edges)[:, np.abs(x) < np.sin(np.radians(60)) * radius]
    assert s.max() < 0.1
    assert s.mean() < 0.01


@pytest.mark.parametrize(("level", "std"), [(0.5, 0.01), (0.5, 0.1), (0.0, 0.01)])
def test_noise_alone_is_almost_no_edge(level: float, std: float) -> None:
    noise = np.random.default_rng(1).normal(level, std, (3, 200, 200)).astype(np.float32)
    assert (strength(measured(jnp.asarray(noise), std).edges) > 0.05).mean() < 2e-4


def test_an_empty_image_is_zero() -> None:
    for value in edges_of(np.zeros((SIZE, SIZE), np.float32), std=0.0):
        np.testing.assert_array_equal(value, 0.0)


def test_a_batch_is_its_elements() -> None:
    images = jnp.asarray(np.stack([[step(d), step(d + 40)] for d in (5, 33, 80)]))
    batch = jax.jit(jax.vmap(lambda i: edge_map(i, 0.002)))(images)
    for k in range(3):
        for many, one in zip(batch, measured(images[k], 0.002), strict=True):
            np.testing.assert_allclose(many[k], one, atol=1e-6)


def test_the_derivative_is_that_of_finite_differences() -> None:
    rng = np.random.default_rng(2)
    image = np.stack([step(33, 0.50, 0.61), step(33, 0.40, 0.46)])
    image += rng.normal(0, 0.002, image.shape).astype("f4")
    weights = jnp.asarray(rng.normal(size=(SIZE, SIZE, 2)).astype("f4"))
    change = jnp.asarray(rng.normal(size=image.shape).astype("f4"))

    def value(t):
        return jnp.sum(edge_map(jnp.asarray(image) + t * change, 0.002).edges * weights)

    value, slope = jax.jit(value), jax.jit(jax.grad(value))
    h = jnp.float32(3e-5)
    assert float(slope(jnp.float32(0))) == pytest.approx(float((value(h) - value(-h)) / (2 * h)), rel=0.02)
    assert np.isfinite(np.asarray(jax.grad(lambda i: edge_map(i, 0.0).edges.sum())(jnp.zeros((1, 8, 8))))).all()


def test_neither_rank_nor_dtype_is_promoted() -> None:
    with jax.numpy_rank_promotion("raise"), jax.numpy_dtype_promotion("strict"):
        edges = edge_map(jnp.asarray(step(10))[None], 0.01)
        assert seen_by(edges, 1, 1).dtype == jnp.float32
