"""Reflected light predicted from posed parts is what reaches them, and images without it are those of the lamps."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from itree_kernels.camera import Camera
from itree_kernels.instances import Material
from itree_kernels.lit_scene import LitScene, render_scene
from itree_kernels.mesh import RayMesh, ray_mesh
from itree_kernels.reflected import reflected_light
from scipy.spatial.transform import Rotation

from itree_jax.recognised_reflections import (
    LEAST_LIGHT,
    PATHS,
    REACH,
    light_between,
    mean_over_face,
    strength_in_shadows,
    subtract_reflections,
    without_reflections,
)
from itree_jax.refinement.optimise import OtherView
from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.photometric import needle_map
from itree_jax.sensor import Sensor
from itree_jax.stereo.second_camera import SecondCamera

WIDE, HIGH = 96, 64
SENSOR = replace(
    bundled_sensor("ikeuchi-1987"), camera=Camera("orthographic", 1.0, 1.0, (WIDE - 1) / 2, (HIGH - 1) / 2, WIDE, HIGH)
)
ALBEDO = 0.6
STEEP, FLAT = np.radians(72.0), np.radians(25.0)  # slants of the groove's sides: two lights don't reach the steep one
LONG = 400.0  # [mm]
# rolled, so that no light comes along the groove or across it
R = np.tile(Rotation.from_euler("z", 8.0, degrees=True).as_matrix(), (2, 1, 1))
T = np.tile([[0.0, 0.0, 500.0]], (2, 1))


def rectangle(corners) -> RayMesh:
    return ray_mesh(np.array(corners, float), np.array([[0, 1, 2], [0, 2, 3]]), np.zeros(2, int), device="cpu")


def groove() -> list[RayMesh]:
    """Two sides that rise toward the camera from a line along x."""
    below, above = 10.0, -26.0
    rise, fall = -below * np.tan(STEEP), above * np.tan(FLAT)
    return [
        rectangle([[-LONG, 0, 0], [-LONG, below, rise], [LONG, below, rise], [LONG, 0, 0]]),
        rectangle([[-LONG, 0, 0], [LONG, 0, 0], [LONG, above, fall], [-LONG, above, fall]]),
    ]


def scene_of(meshes, sensor: Sensor, poses=(R, T)):
    return (meshes, range(len(meshes)), *poses, sensor.camera, sensor.light_directions, sensor.light_intensities,
            Material(ALBEDO))  # fmt: skip


def read(images: np.ndarray, sensor: Sensor = SENSOR) -> NeedleMap:
    return NeedleMap(*(np.asarray(a) for a in needle_map(images.astype(np.float32), sensor)))


@pytest.fixture(scope="module")
def lamps_alone() -> LitScene:
    return render_scene(*scene_of(groove(), SENSOR))


@pytest.fixture(scope="module")
def images(lamps_alone) -> np.ndarray:
    return lamps_alone.images + reflected_light(*scene_of(groove(), SENSOR), samples=200)


def test_a_wall_gets_half_of_what_the_floor_beside_it_sends():
    """In the corner the floor fills half of what the wall sees, and light that comes from above grazes the wall."""
    far, deep = 4000.0, 100.0
    wall = rectangle([[-far, -far, deep], [-far, 30.0, deep], [far, 30.0, deep], [far, -far, deep]])
    floor = rectangle([[-far, 30.0, deep], [-far, 30.0, deep - far], [far, 30.0, deep - far], [far, 30.0, deep]])
    assert -far < -HIGH / 2
    above = replace(SENSOR, light_directions=np.array([[0.0, -1.0, 0.0]]), light_intensities=np.array([0.9]))
    light, shown = light_between([wall, floor], np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 3)), above, ALBEDO)
    on_wall = light[0][shown.instance == 0]
    assert len(on_wall) > 0.9 * WIDE * HIGH
    assert on_wall.mean() == pytest.approx(0.9 * 0.5 * ALBEDO**2, rel=0.03)
    assert on_wall.std() < 1.3 / np.sqrt(PATHS * (2 * REACH + 1) ** 2) * on_wall.mean()  # every other path hits


def test_predicted_light_is_what_reflections_add(images, lamps_alone):
    light, shown = light_between(groove(), R, T, SENSOR, ALBEDO)
    added = images - lamps_alone.images
    part = shown.instance >= 0
    for side in (0, 1):
        here = shown.instance == side
        # four paths from each of a thousand pixels: 2 %, which all lights share
        np.testing.assert_allclose(light[:, here].mean(axis=1), added[:, here].mean(axis=1), rtol=0.06, atol=5e-4)
    # one pixel: the noise of either, and a mean over pixels where light falls off within some of them
    assert np.abs(light - added)[:, part].mean() < 0.2 * added[:, part].mean()
    assert not light[:, ~part].any()


def test_images_without_reflections_are_those_of_the_lamps(images, lamps_alone):
    before = read(images)
    cleared = without_reflections(images, before, SENSOR, groove(), R, T)
    assert cleared is not None
    assert cleared.dtype == np.float32
    assert (cleared >= 0.0).all()
    part = lamps_alone.instance >= 0
    off = [np.abs(some - lamps_alone.images)[:, part].mean() for some in (images, cleared)]
    assert off[1] < 0.15 * off[0]
    shadow = part & ~lamps_alone.lit
    assert cleared[shadow].mean() < 0.1 * images[shadow].mean()
    after = read(cleared)
    same = part & before.interpretable & after.interpretable & lamps_alone.lit.all(axis=0)
    assert same.sum() > 300
    angles = [np.degrees(np.linalg.norm(n.normals - lamps_alone.normal, axis=-1)[same]) for n in (before, after)]
    assert np.median(angles[0]) > 2.0
    assert np.median(angles[1]) < 0.2 * np.median(angles[0])


def test_a_part_alone_has_nothing_to_subtract(lamps_alone):
    one = groove()[:1]
    shown = render_scene(*scene_of(one, SENSOR, (R[:1], T[:1])))
    light, _ = light_between(one, R[:1], T[:1], SENSOR, ALBEDO)
    assert not light.any()
    assert without_reflections(shown.images, read(shown.images), SENSOR, one, R[:1], T[:1]) is None


def test_black_shadows_tell_that_nothing_is_reflected(lamps_alone):
    needle = read(lamps_alone.images)
    assert without_reflections(lamps_alone.images, needle, SENSOR, groove(), R, T) is None


def test_shadows_tell_how_strong_reflected_light_is(lamps_alone):
    rng = np.random.default_rng(3)
    light = rng.uniform(0.02, 0.08, lamps_alone.images.shape).astype(np.float32)
    for strength in (0.2, 0.7):
        seen = strength * light
        assert strength_in_shadows(seen, light, lamps_alone) == pytest.approx(strength, rel=1e-5)
        elsewhere = np.where(lamps_alone.lit, np.float32(1.0), seen)  # lit pixels have no say
        assert strength_in_shadows(elsewhere, light, lamps_alone) == pytest.approx(strength, rel=1e-5)
        some_wrong = np.where(rng.random(seen.shape) < 0.2, np.float32(0.5), seen)
        assert strength_in_shadows(some_wrong, light, lamps_alone) == pytest.approx(strength, rel=1e-5)
    assert strength_in_shadows(1.4 * light, light, lamps_alone) == 1.0
    assert strength_in_shadows(light, np.full_like(light, 0.9 * LEAST_LIGHT), lamps_alone) is None


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**31))
def test_the_mean_is_over_pixels_of_the_same_part_that_face_the_same_way(seed):
    rng = np.random.default_rng(seed)
    height, width = rng.integers(1, 12, 2)
    light = rng.random((2, height, width)).astype(np.float32)
    instance = rng.integers(-1, 2, (height, width)).astype(np.int16)
    ways = np.array([[0.0, 0.0, -1.0], [0.0, np.sin(0.1), -np.cos(0.1)], [0.0, np.sin(0.5), -np.cos(0.5)]], np.float32)
    way = rng.integers(0, 3, (height, width))
    shown: Any = SimpleNamespace(instance=instance, normal=ways[way])
    mean = mean_over_face(light, shown)
    alike = np.array([[True, True, False], [True, True, False], [False, False, True]])
    for i, j in np.ndindex(height, width):
        v, u = np.indices((height, width))
        near = (np.abs(v - i) <= REACH) & (np.abs(u - j) <= REACH)
        near &= (instance == instance[i, j]) & alike[way[i, j], way]
        expected = light[:, near].mean(axis=1) if instance[i, j] >= 0 else np.zeros(2)
        np.testing.assert_allclose(mean[:, i, j], expected, rtol=1e-5)


def answers(score: float = 0.9) -> list:
    """As recognition would answer: one side of the groove each, at the true poses."""
    return [
        SimpleNamespace(
            selection=SimpleNamespace(accepted=np.array([0]), score=np.array([score])),
            hypotheses=SimpleNamespace(poses=SimpleNamespace(R_cam_obj=R[k : k + 1], t_cam_obj=T[k : k + 1])),
            prepared=SimpleNamespace(model=SimpleNamespace(mesh=mesh)),
        )
        for k, mesh in enumerate(groove())
    ]  # fmt: skip


def test_answers_clear_the_images_of_both_cameras(images):
    turn = Rotation.from_euler("yz", [5.0, 2.0], degrees=True).as_matrix()
    shift = np.array([-40.0, 3.0, 2.0])
    second = SecondCamera(np.zeros_like(images), SENSOR, turn, shift).with_lights_of(SENSOR)
    there = scene_of(groove(), second.sensor, (turn @ R, T @ turn.T + shift))
    alone = render_scene(*there)
    second = replace(second, images=alone.images + reflected_light(*there, samples=100))
    not_looked_at: Any = None
    view = OtherView(not_looked_at, second.sensor.camera, turn, shift)
    beside = (read(second.images, second.sensor),)
    sight: Any = SimpleNamespace(sensor=SENSOR, needle=read(images), others=(view,), beside=beside)
    found = subtract_reflections(images, answers(), sight, second)
    assert found is not None
    cleared, other = found
    expected = without_reflections(images, sight.needle, SENSOR, groove(), R, T)
    np.testing.assert_array_equal(cleared, expected)
    assert other is not None
    assert np.abs(other.images - alone.images).mean() < 0.2 * np.abs(second.images - alone.images).mean()
    np.testing.assert_array_equal(other.sensor.light_directions, second.sensor.light_directions)
    assert subtract_reflections(images, answers(score=0.2), sight, second) is None
    alone_with_depth: Any = SimpleNamespace(sensor=SENSOR, needle=sight.needle, others=(), beside=())
    found = subtract_reflections(images, answers(), alone_with_depth)
    assert found is not None
    assert found[1] is None
    np.testing.assert_array_equal(found[0], cleared)
