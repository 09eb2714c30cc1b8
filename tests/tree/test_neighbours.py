"""A part beside another one: what is in front hides, and its shadow falls where geometry says."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from itree_kernels.apparent import cast_apparent_shapes

from itree_jax.tree.appearances import mesh_reach, window_camera
from itree_jax.tree.dome import camera_rotation, dome
from itree_jax.tree.neighbours import (
    BESIDE,
    FAR,
    STEP,
    STEPS,
    Views,
    alone,
    beside,
    either,
    shadowed,
    shifted,
    with_neighbours,
)

SIZE, PITCH, GROUND = 48, 1.0, 100.0


def toward(azimuth: float, elevation: float) -> np.ndarray:
    """Direction to a light [deg]: azimuth from x right to y down, elevation from the image plane toward the viewer."""
    a, e = np.radians([azimuth, elevation])
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), -np.sin(e)], np.float32)


def shadow_of(blocker: np.ndarray, light: np.ndarray, pitch: float = PITCH) -> np.ndarray:
    ground = jnp.full((SIZE, SIZE), GROUND)
    return np.asarray(jax.jit(shadowed)(ground, jnp.asarray(blocker, jnp.float32), jnp.float32(pitch), light))


def block(height: float, rows=slice(18, 30), columns=slice(22, 26)) -> np.ndarray:
    depth = np.full((SIZE, SIZE), FAR)
    depth[rows, columns] = GROUND - height
    return depth


@pytest.mark.parametrize(("elevation", "height"), [(45.0, 10.0), (60.0, 20.0), (30.0, 6.0)])
def test_a_shadow_is_as_long_as_the_height_over_the_tangent_of_the_elevation(elevation, height):
    """The light stands on the right: the shadow reaches to the left, over the block's rows and no others."""
    shadow = shadow_of(block(height), toward(0.0, elevation))
    length = height / np.tan(np.radians(elevation)) / PITCH
    column = np.arange(SIZE)
    left_of = 22 - column  # [px] from the block's side
    np.testing.assert_array_equal(shadow[18:30, (left_of > 0) & (left_of < length - STEP)], True)
    np.testing.assert_array_equal(shadow[:, left_of > length + STEP], False)
    np.testing.assert_array_equal(shadow[:, column > 26], False)
    np.testing.assert_array_equal(shadow[:18], False)
    np.testing.assert_array_equal(shadow[30:], False)


@pytest.mark.parametrize("quarter", [0, 1, 2, 3])
def test_a_turned_scene_has_a_turned_shadow(quarter):
    """A quarter turn from x to y takes rows and columns along (a step of half a pixel rounds to the even one)."""
    depth, light = block(12.0), toward(0.0, 50.0)
    turned = shadow_of(np.rot90(depth, -quarter), toward(90.0 * quarter, 50.0))
    assert (turned != np.rot90(shadow_of(depth, light), -quarter)).mean() < 0.01


def test_nothing_is_shadowed_by_what_lies_lower_or_under_a_light_on_the_axis():
    assert not shadow_of(block(-5.0), toward(20.0, 40.0)).any()
    assert not shadow_of(block(30.0), np.float32([0.0, 0.0, -1.0])).any()
    assert not shadow_of(np.full((SIZE, SIZE), FAR), toward(20.0, 40.0)).any()


def shadow_twin(depth: np.ndarray, blocker: np.ndarray, pitch: float, light: np.ndarray) -> np.ndarray:
    """Pixel by pixel and step by step."""
    size, found = len(depth), np.zeros(depth.shape, bool)
    across = float(np.hypot(*light[:2]))
    for i, j in np.ndindex(size, size):
        for k in range(1, STEPS + 1):
            v, u = i + k * STEP * light[1] / across, j + k * STEP * light[0] / across
            v, u = int(np.rint(v)), int(np.rint(u))
            if 0 <= v < size and 0 <= u < size:
                found[i, j] |= blocker[v, u] < depth[i, j] + k * STEP * pitch * light[2] / across
    return found


def test_the_walk_is_that_of_plain_numpy():
    rng = np.random.default_rng(0)
    depth = GROUND + rng.uniform(-3, 3, (20, 20))
    blocker = np.where(rng.random((20, 20)) < 0.1, GROUND - rng.uniform(0, 25, (20, 20)), FAR)
    for light in (toward(33.0, 40.0), toward(201.0, 60.0)):
        arrays = (jnp.asarray(a, jnp.float32) for a in (depth, blocker))
        found = np.asarray(shadowed(*arrays, jnp.float32(0.8), jnp.asarray(light)))
        assert (found != shadow_twin(depth, blocker, 0.8, light)).mean() < 0.01  # of steps between two pixels


@given(st.integers(-20, 20), st.integers(-20, 20))
@settings(deadline=None, max_examples=25)
def test_an_image_is_moved_by_whole_pixels_and_nothing_comes_in(down, right):
    image = np.random.default_rng(0).uniform(1, 2, (16, 16, 3)).astype(np.float32)
    moved = np.asarray(shifted(jnp.asarray(image), jnp.asarray([down, right]), 0.0))
    expected = np.zeros_like(image)
    for i, j in np.ndindex(16, 16):
        if 0 <= i - down < 16 and 0 <= j - right < 16:
            expected[i, j] = image[i - down, j - right]
    np.testing.assert_array_equal(moved, expected)


def random_view(seed: int, size: int = 24) -> Views:
    rng = np.random.default_rng(seed)
    there = rng.random((size, size)) < 0.6
    depth = np.where(there, GROUND + rng.uniform(-10, 10, (size, size)), FAR).astype(np.float32)
    normal = rng.normal(size=(size, size, 3)).astype(np.float32)
    lit = (rng.random((3, size, size)) < 0.7) & there
    return Views(there, depth, normal, lit, there)


@pytest.mark.parametrize("seed", range(4))
def test_the_nearer_surface_is_seen_and_the_rest_is_that_of_the_z_buffer(seed):
    own, other = random_view(2 * seed), random_view(2 * seed + 1)
    shift, lift = np.array([3, -5]), np.float32(2.0)
    L = np.stack([toward(a, 50.0) for a in (10, 130, 250)])
    seen = jax.jit(beside)(*jax.tree.map(jnp.asarray, (own, other, shift, lift, L, np.float32(1.0))))
    size = len(own.there)
    for i, j in np.ndindex(size, size):
        v, u = i - shift[0], j - shift[1]
        inside = 0 <= v < size and 0 <= u < size and other.there[v, u]
        in_front = inside and (not own.there[i, j] or other.depth[v, u] + lift < own.depth[i, j])
        assert bool(seen.there[i, j]) == bool(own.there[i, j] or inside)
        assert bool(seen.own[i, j]) == bool(own.there[i, j] and not in_front)
        if in_front:
            assert float(seen.depth[i, j]) == pytest.approx(float(other.depth[v, u] + lift))
            np.testing.assert_array_equal(seen.normal[i, j], other.normal[v, u])
            np.testing.assert_array_equal(seen.lit[:, i, j], other.lit[:, v, u])
        else:
            assert float(seen.depth[i, j]) == float(own.depth[i, j])
            np.testing.assert_array_equal(seen.normal[i, j], own.normal[i, j])
            assert not (np.asarray(seen.lit[:, i, j]) & ~own.lit[:, i, j]).any()  # light is only lost


@pytest.fixture(scope="module")
def views(gem, sensor):
    camera, _ = window_camera(mesh_reach(gem))
    R = camera_rotation(dome(1).directions[::5])
    shapes = cast_apparent_shapes(gem, R, np.zeros((len(R), 3)), camera, sensor.light_directions, sensor.slant_limit)
    return alone(shapes)


def with_others(views, gem, sensor, seed=0) -> Views:
    reach = mesh_reach(gem)
    pitch = window_camera(reach)[1]
    return with_neighbours(views, sensor.light_directions, pitch, reach, np.random.default_rng(seed))


def test_alone_all_that_is_seen_is_the_part_and_beyond_it_is_nothing(views):
    np.testing.assert_array_equal(views.there, views.own)
    assert (np.asarray(views.depth)[~views.there] == FAR).all()
    assert (np.asarray(views.depth)[views.there] < FAR / 2).all()


def test_a_neighbour_takes_pixels_and_light_and_gives_none(views, gem, sensor):
    seen = with_others(views, gem, sensor)
    assert not (seen.own & ~views.own).any()
    assert (seen.there & ~seen.own).any(axis=(1, 2)).all()  # every part has a neighbour in its window
    own = seen.own[:, None]
    assert not (seen.lit & ~views.lit & own).any()
    lost = (views.own & ~seen.own).sum(axis=(1, 2)) + (views.lit & ~seen.lit & own).any(axis=1).sum(axis=(1, 2))
    assert (lost > 0).mean() > 0.5
    np.testing.assert_array_equal(seen.normal[seen.own], views.normal[seen.own])
    np.testing.assert_array_equal(seen.depth[seen.own], views.depth[seen.own])


def test_neighbours_follow_their_seed_and_are_other_views(views, gem, sensor):
    count, size = views.there.shape[:2]
    named = views._replace(normal=np.broadcast_to(
        np.arange(count, dtype=np.float32)[:, None, None, None], (count, size, size, 3)
    ))  # fmt: skip
    first, again, other = (with_others(named, gem, sensor, seed) for seed in (1, 1, 2))
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a, b)
    assert any((a != b).any() for a, b in zip(first, other, strict=True))
    for k in range(count):
        of = np.unique(first.normal[k][first.there[k] & ~first.own[k]])
        assert len(of) == 1
        assert of[0] != k


def test_a_neighbour_lies_as_far_away_as_parts_that_touch_or_less(views, gem, sensor):
    """Flat discs that hide nothing of each other show where their neighbour's middle is."""
    size, radius = views.there.shape[-1], 6
    y, x = np.mgrid[:size, :size] - (size - 1) / 2
    disc = np.broadcast_to(np.hypot(x, y) < radius, (8, size, size))
    depth = np.where(disc, GROUND, FAR).astype(np.float32)
    flat = Views(disc, depth, np.zeros((8, size, size, 3), np.float32), np.broadcast_to(disc[:, None], (8, 3, size, size)),
                 disc)  # fmt: skip
    seen = with_others(flat, gem, sensor)
    for k in range(8):
        if (seen.there[k] & ~seen.own[k] & disc[k]).any():
            v, u = np.nonzero(seen.there[k] & ~seen.own[k])  # the neighbour is in front: all of it shows
            apart = np.hypot(v.mean() - (size - 1) / 2, u.mean() - (size - 1) / 2)
            assert BESIDE[0] * 2 * radius - 1 <= apart <= BESIDE[1] * 2 * radius + 1


def test_either_takes_whole_views(views, gem, sensor):
    seen = with_others(views, gem, sensor)
    first = np.arange(len(views.there)) % 2 == 0
    mixed = either(first, seen, views)
    for m, a, b in zip(mixed, seen, views, strict=True):
        np.testing.assert_array_equal(m[first], a[first])
        np.testing.assert_array_equal(m[~first], b[~first])
