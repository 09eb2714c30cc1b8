"""Which light an image is of: by where its shadows end, by one normal per pixel, by the depth map."""

from dataclasses import replace
from functools import cache
from itertools import permutations

import numpy as np
import pytest
from itree_cad.bundled import bundled_part
from itree_kernels.camera import Camera
from scipy.spatial.transform import Rotation

from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.light_order import depth_normals, light_order, normal_support, one_normal_support, other_orders
from itree_jax.sensing.shadow_edges import shadow_support, toward_light
from itree_jax.simulate.bin import Bin
from itree_jax.simulate.imaging import LOOKS, image_bin

CAMERA = Camera("pinhole", 900.0, 900.0, 159.5, 119.5, 320, 240)
BIN = Bin((260.0, 190.0), 30.0)


@cache
def scene(count: int, look: str = "lambert"):
    azimuth = 0.4 + 2 * np.pi * np.arange(count) / count
    L = np.stack([0.5736 * np.cos(azimuth), 0.5736 * np.sin(azimuth), np.full(count, -0.8192)], axis=1)
    L /= np.linalg.norm(L, axis=1, keepdims=True)
    sensor = replace(bundled_sensor("bench"), camera=CAMERA, light_directions=L, light_intensities=np.ones(count))
    part = bundled_part("bracket")
    T = np.tile(np.eye(4), (3, 1, 1))
    T[:, :3, :3] = Rotation.from_rotvec([[0.3, 0.2, 0.5], [-0.5, 0.4, 2.0], [0.2, -0.6, 3.6]]).as_matrix()
    places = np.array([[-65.0, 0.0, 25.0], [10.0, 40.0, 26.0], [60.0, -35.0, 25.0]])
    T[:, :3, 3] = places - T[:, :3, :3] @ part.vertices.mean(axis=0)
    return image_bin(part, T, BIN, sensor, LOOKS[look], seed=1)[0]


@pytest.mark.parametrize("look", ["lambert", "metal"])
@pytest.mark.parametrize("with_depth", [False, True])
def test_the_right_order_passes_and_every_other_of_three_is_refused(look, with_depth):
    s = scene(3, look)
    depth = s.depth if with_depth else None
    right = light_order(s.images, s.sensor, depth)
    assert not right.wrong
    assert right.margin > 2.0
    assert set(right.cues) == {"shadows", "depth"} if with_depth else {"shadows"}
    for order in permutations(range(3)):
        if order != (0, 1, 2):
            found = light_order(s.images[list(order)], s.sensor, depth)
            assert found.margin < -2.0
            assert found.rival == order
            assert found.wrong or not with_depth


@pytest.mark.parametrize("count", [4, 5])
def test_swapped_lights_among_more_are_refused(count):
    s = scene(count)
    assert not light_order(s.images, s.sensor, None).wrong
    swapped = [1, 0, *range(2, count)]
    found = light_order(s.images[swapped], s.sensor, s.depth)
    assert found.wrong
    assert found.rival == tuple(swapped)


def test_an_empty_floor_cannot_tell():
    s = scene(3)
    flat = np.broadcast_to(np.float32(0.3), s.images.shape) + np.random.default_rng(0).normal(0, 0.004, s.images.shape)
    found = light_order(flat.astype(np.float32), s.sensor, None)
    assert found.doubtful
    assert not found.wrong


def test_a_shadow_brightens_away_from_its_light():
    """A dark square under light 0 only, whose near edge the other lights see too (the thing that casts it)."""
    s = scene(3)
    toward = toward_light(CAMERA, s.sensor.light_directions[0])[120, 160]
    offset = np.stack(np.meshgrid(np.arange(320) - 160.0, np.arange(240) - 120.0), axis=-1)
    along = offset @ (toward / np.hypot(*toward))
    images = np.full((3, 240, 320), 0.4, np.float32)
    images[:, (along > 0) & (along < 40)] = 0.6  # the thing
    images[0, (along < 0) & (along > -30)] = 0.0  # its shadow
    support = shadow_support(images, s.sensor)
    total = support.sum(axis=(2, 3))
    assert total[0].argmax() == 0
    assert total[0, 0] > 0.0
    assert (total[0, 1:] < 0.0).all()
    assert not support[1:].any()


def test_toward_light_is_the_motion_of_a_projected_point():
    light = np.array([0.3, -0.4, -np.sqrt(0.75)])
    uv, z, step = np.array([40.0, 200.0]), 700.0, 1e-4
    X = CAMERA.unproject(uv, np.array(z))
    moved = CAMERA.project(X + step * light) - uv
    expected = moved * z / (CAMERA.fx * step)
    np.testing.assert_allclose(toward_light(CAMERA, light)[200, 40], expected, rtol=1e-5)


def test_one_normal_is_full_support_for_the_right_lights_only(sphere, shade):
    rng = np.random.default_rng(3)
    L = rng.normal([0, 0, -2.0], 0.5, (5, 3))
    L /= np.linalg.norm(L, axis=1, keepdims=True)
    x = shade(sphere, L, np.ones(5))
    lit = (x > 0.05).all(axis=0)
    np.testing.assert_allclose(one_normal_support(x, lit, L)[lit], 1.0, atol=1e-12)
    assert one_normal_support(x[[1, 0, 2, 3, 4]], lit, L)[lit].mean() < 0.5
    np.testing.assert_allclose(normal_support(x, lit, sphere, L)[lit], 1.0, atol=1e-12)
    assert normal_support(x[[1, 0, 2, 3, 4]], lit, sphere, L)[lit].mean() < 0.99


@pytest.mark.parametrize("kind", ["pinhole", "orthographic"])
def test_normals_of_a_tilted_plane(kind):
    f = 900.0 if kind == "pinhole" else 2.0
    sensor = replace(bundled_sensor("bench"), camera=Camera(kind, f, f, 31.5, 31.5, 64, 64))
    normal = np.array([0.3, -0.2, -1.0]) / np.linalg.norm([0.3, -0.2, -1.0])
    v, u = np.indices((64, 64), dtype=float)
    at_one = sensor.camera.unproject(np.stack([u, v], axis=-1), np.ones((64, 64)))
    if kind == "pinhole":
        depth = 800.0 * normal[2] / (at_one @ normal)
    else:
        depth = 800.0 - (at_one[..., :2] @ normal[:2]) / normal[2]
    found, known = depth_normals(depth, sensor)
    inside = known[16:-16, 16:-16]
    assert inside.all()
    np.testing.assert_allclose(found[16:-16, 16:-16], np.broadcast_to(normal, (32, 32, 3)), atol=2e-3)


def test_the_orders_that_are_compared():
    assert len(other_orders(np.eye(3))) == 5
    assert len(other_orders(np.eye(4))) == 23
    assert len(other_orders(np.eye(6))) == 15
    turned = np.roll(np.eye(6), 1, axis=1)
    assert other_orders(turned)[-1] == (1, 2, 3, 4, 5, 0)
