"""Prominent edges of drawn faces: found where they are, in a frame that tilt and turn don't change."""

from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from itree_jax.features.edge_support import edge_support
from itree_jax.features.edges import edge_map
from itree_jax.features.prominent_edges import (
    Edge,
    edge_table,
    face_frame,
    on_image,
    prominent_edges,
    search_areas,
)
from itree_jax.features.straight_edges import straight_edges
from itree_jax.features.window import Window

RECTANGLE = np.array([[-15, -9], [15, -9], [15, 9], [-15, 9], [-15, -9]], float)  # [mm] in the face frame
SLOT = np.array([[6, -6], [10, -6], [10, 6], [6, 6], [6, -6]], float)
LONG = [*pairwise(RECTANGLE), (SLOT[1], SLOT[2]), (SLOT[3], SLOT[4])]  # the short sides of the slot aren't prominent
VIEWS = [(0.0, 0.0, 0.0), (0.0, 0.0, 0.4), (0.5, 0.3, 0.4), (0.5, 0.3, 1.9), (-0.6, 0.4, -0.8), (0.2, -0.7, 2.8)]


def drawn_face(make_face_window, p: float, q: float, turn: float, pitch: float = 1.0, size: int = 48):
    """Edge map and window of a lit rectangle with a dark slot on one side, of gradient (p, q), turned in its plane.

    The slot belongs to the region here, so that mass centre and inertia are the rectangle's.
    """

    def in_box(box):
        def indicator(x, y):
            u, v = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
            return (u > box[0, 0]) & (u < box[2, 0]) & (v > box[0, 1]) & (v < box[2, 1])

        return indicator

    window = make_face_window(in_box(RECTANGLE), p, q, pitch, size)
    slot = make_face_window(in_box(SLOT), p, q, pitch, size).mask
    image = np.where(slot, 0.1, np.where(window.mask, 0.6, 0.0)).astype(np.float32)
    return np.asarray(jitted_map(jnp.asarray(image)[None], 1e-3).edges), window


jitted_map = jax.jit(edge_map)
jitted_support = jax.jit(edge_support)


def distance_to_nearest(edge, edges: tuple[Edge, ...], turned: bool) -> float:
    """Of the ends of a true edge to those of the nearest found one [mm], either end first."""
    a, b = (-np.array(e) if turned else np.array(e) for e in edge)
    pairs = [(e.start, e.end) for e in edges] + [(e.end, e.start) for e in edges]
    return min(max(np.linalg.norm(a - s), np.linalg.norm(b - e)) for s, e in pairs)


@pytest.mark.parametrize(("p", "q", "turn"), VIEWS)
@pytest.mark.parametrize(("pitch", "size"), [(1.0, 48), (0.25, 192)])
def test_the_edges_of_a_face_are_the_true_ones_however_it_is_tilted_and_turned(
    make_face_window, p: float, q: float, turn: float, pitch: float, size: int
) -> None:
    edges, window = drawn_face(make_face_window, p, q, turn, pitch, size)
    found = prominent_edges(edges, window)
    off = min(max(distance_to_nearest(edge, found, turned) for edge in LONG) for turned in (False, True))
    slanted = np.sqrt(1 + p**2 + q**2)  # a pixel of the image on the face, at most
    assert off < pitch * (1.0 + 1.5 * slanted)  # a corner is a pixel off in the image, and the direction by 1.5 px
    assert len(found) == 6
    assert min(e.strength for e in found) > 0.8


def test_ends_lie_within_a_pixel_where_the_pixels_do(make_face_window) -> None:
    edges, window = drawn_face(make_face_window, 0.0, 0.0, 0.0)
    found = prominent_edges(edges, window)
    assert max(distance_to_nearest(edge, found, False) for edge in LONG) < 1.0
    lengths = [np.linalg.norm(e.end - e.start) * e.strength for e in found]
    assert lengths == sorted(lengths, reverse=True)
    for one, other in zip(found, prominent_edges(edges, window), strict=True):
        for a, b in zip(one, other, strict=True):
            np.testing.assert_array_equal(a, b)
    assert len(prominent_edges(edges, window, most=2)) == 2


def test_edges_away_from_the_region_are_left_out(make_face_window) -> None:
    edges, window = drawn_face(make_face_window, 0.0, 0.0, 0.0)
    column = np.arange(48)
    mask = np.asarray(window.mask) & (column < 20)[None]
    normals = np.where(mask[..., None], np.asarray(window.normals), 0).astype(np.float32)
    assert len(prominent_edges(edges, Window(mask, normals, np.float32(1)))) == 3
    empty = Window(np.zeros_like(mask), np.zeros_like(normals), np.float32(1))
    assert prominent_edges(edges, empty) == ()


@pytest.mark.parametrize("degrees", [0, 17, 45, 80, 90, 140])
def test_pieces_of_one_line_are_one_segment_and_parallels_are_two(degrees: float) -> None:
    y, x = np.mgrid[0:48, 0:48] - 23.5
    phi = np.radians(degrees)
    along, off = x * np.cos(phi) + y * np.sin(phi), y * np.cos(phi) - x * np.sin(phi)
    strength = (np.abs(off) < 0.75) & (np.abs(along) < 15) & (np.abs(along) > 1)
    strength |= (np.abs(off - 6) < 0.75) & (np.abs(along) < 8)
    edges = strength[..., None] * np.array([np.cos(2 * phi), np.sin(2 * phi)])
    found = straight_edges(edges, 8)
    assert [e.length for e in found] == pytest.approx([30, 16], abs=1.5)
    direction = np.array([np.cos(phi), np.sin(phi)])
    for edge in found:
        chord = edge.ends[1] - edge.ends[0]
        assert abs(chord @ direction) / np.linalg.norm(chord) > np.cos(np.radians(2.0))


@pytest.mark.parametrize(("p", "q", "turn"), VIEWS)
def test_on_image_is_the_inverse(make_face_window, p: float, q: float, turn: float) -> None:
    """Laid back under its own direction, an edge lies on the edge map; the opposite direction mirrors it."""
    edges, window = drawn_face(make_face_window, p, q, turn)
    found, frame = prominent_edges(edges, window), face_frame(Window(*map(jnp.asarray, window)))
    T, centroid = np.asarray(frame.T), np.asarray(frame.centroid)
    near = window.mask | np.roll(window.mask, 1, 0) | np.roll(window.mask, -1, 0)
    near = near | np.roll(near, 1, 1) | np.roll(near, -1, 1)
    near = near | np.roll(near, 1, 0) | np.roll(near, -1, 0) | np.roll(near, 1, 1) | np.roll(near, -1, 1)
    again = [e.ends for e in straight_edges(np.where(near[..., None], edges, 0), 8)]
    placed = on_image(found, T, centroid, float(frame.alpha), 1.0, 48)
    for segment in placed.reshape(-1, 2, 2):
        assert min(np.abs(segment - ends).max() for ends in again) < 0.05
    centre = centroid + 23.5
    mirrored = on_image(found, T, centroid, float(frame.alpha) + np.pi, 1.0, 48)
    np.testing.assert_allclose(mirrored + placed, np.broadcast_to(2 * np.tile(centre, 2), placed.shape), atol=1e-3)


def test_the_search_area_surrounds_its_edge_and_grows_with_the_distance() -> None:
    placed = np.array([[10, 20, 30, 20], [10, 40, 30, 40]], np.float32)
    corners = search_areas(placed, np.array([20, 20], np.float32))
    np.testing.assert_allclose(corners.mean(axis=1), [[20, 20], [20, 40]], atol=1e-5)
    near, far = np.ptp(corners[:, :, 1], axis=1) / 2
    assert near == pytest.approx(1 + 2 * 0.5)  # a pixel, and two standard deviations of the mass centre
    assert far == pytest.approx(1 + 2 * np.hypot(0.5, 0.035 * 20))


@pytest.mark.parametrize(("p", "q", "turn"), VIEWS)
def test_the_true_rotation_has_the_edges_and_the_half_turn_has_not(
    make_face_window, p: float, q: float, turn: float
) -> None:
    model = prominent_edges(*drawn_face(make_face_window, 0.0, 0.0, 0.0))
    model = tuple(e for e in model if np.abs([e.start[1], e.end[1]]).max() < 8)  # the slot: what tells the two apart
    edges, window = drawn_face(make_face_window, p, q, turn)
    frame = face_frame(Window(*map(jnp.asarray, window)))
    best = [
        np.asarray(jitted_support(jnp.asarray(edges), jnp.asarray(edge_table(model)), frame.T, frame.centroid, a, 1.0))
        for a in (frame.alpha, frame.alpha + np.float32(np.pi))
    ]
    true, false = sorted(best, key=lambda s: -s.sum())
    assert len(model) == 2
    assert true[:2].min() > 0.7
    assert false[:2].max() < 0.4
    np.testing.assert_array_equal(true[2:], 0.0)
    is_turned = abs((float(frame.alpha) - turn + np.pi) % (2 * np.pi) - np.pi) > np.pi / 2
    assert true is best[int(is_turned)]


def smooth_edges(rng: np.random.Generator) -> jnp.ndarray:
    y, x = np.mgrid[0:48, 0:48] / 8.0
    waves = [np.sin(x * a + y * b + c) for a, b, c in rng.uniform(0.5, 2.0, (2, 3))]
    return jnp.asarray(np.stack(waves, axis=-1).astype(np.float32) / 1.5)


def test_the_derivative_of_the_support_is_that_of_finite_differences() -> None:
    """In double precision, with steps so small that none of the places looked up changes pixels within them: there the
    support has a kink."""
    rng = np.random.default_rng(0)
    with jax.enable_x64(True):
        edges = jnp.asarray(smooth_edges(rng), jnp.float64)
        segments = jnp.asarray(rng.uniform(-12, 12, (8, 4))).at[5:].set(0.0)
        T, centroid = jnp.array([[1.2, 0.2], [0.0, 1.1]]), jnp.array([1.0, -2.0])

        def total(x):
            support = edge_support(edges * x[3], segments, T, centroid + x[1:3], x[0], 1.0 + x[4])
            return jnp.sum(support)

        total, slope = jax.jit(total), jax.jit(jax.grad(total))
        x, steps = np.array([0.3, 0.1, 0.2, 1.0, 0.1]), 1e-7 * np.eye(5)
        exact = np.asarray(slope(x))
        numeric = np.array([float(total(x + h) - total(x - h)) / 2e-7 for h in steps])
    assert np.abs(exact).min() > 1e-3
    np.testing.assert_allclose(exact, numeric, rtol=1e-4, atol=1e-5)


def test_a_batch_of_candidates_and_windows_is_its_elements() -> None:
    rng = np.random.default_rng(3)
    edges = jnp.stack([smooth_edges(rng) for _ in range(2)])
    segments = jnp.asarray(rng.uniform(-12, 12, (2, 8, 4)).astype(np.float32))
    alphas = jnp.array([0.2, 0.2 + np.pi, 1.0], jnp.float32)
    T, centroid, pitch = jnp.eye(2), jnp.zeros(2), jnp.float32(1.0)
    with jax.numpy_rank_promotion("raise"), jax.numpy_dtype_promotion("strict"):
        candidates = jax.vmap(edge_support, in_axes=(None, None, None, None, 0, None))
        batch = jax.jit(jax.vmap(candidates, in_axes=(0, 0, None, None, None, None)))
        support = batch(edges, segments, T, centroid, alphas, pitch)
    assert support.shape == (2, 3, 8)
    for w in range(2):
        for a in range(3):
            one = edge_support(edges[w], segments[w], T, centroid, alphas[a], pitch)
            np.testing.assert_allclose(support[w, a], one, atol=1e-5)
