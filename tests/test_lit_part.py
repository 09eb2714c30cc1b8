"""A scene with a depth map is read where a light shows it, and answered as a whole."""

from dataclasses import replace

import numpy as np
import pytest

from itree_jax import recognition
from itree_jax.lit_part import Seen, in_whole_image, lit_part
from itree_jax.prepared import prepare
from itree_jax.recognition import recognize
from itree_jax.sensing.near_lights import lights_of
from itree_jax.sight import look


@pytest.fixture(scope="module")
def scene(paper_part_on_a_table):
    return paper_part_on_a_table[0]


@pytest.fixture(scope="module")
def seen(scene) -> Seen:
    return Seen(scene.images, scene.sensor, scene.depth)


def test_the_part_that_is_read_holds_what_a_light_shows(scene, seen):
    inside, box = lit_part(seen)
    lit = look(scene.images, scene.sensor, scene.depth).lit
    v, u = np.nonzero(lit)
    # nothing is as bright that a glance at every fourth pixel misses but specks
    assert np.mean((v >= box.top) & (v < box.bottom) & (u >= box.left) & (u < box.right)) > 0.999
    assert box.pixels < 0.9 * lit.size
    np.testing.assert_array_equal(inside.images, scene.images[:, box.top : box.bottom, box.left : box.right])
    np.testing.assert_array_equal(inside.depth, scene.depth[box.top : box.bottom, box.left : box.right])
    camera = inside.sensor.camera
    assert (camera.height, camera.width) == inside.depth.shape
    X_cam, corner = np.array([3.0, -2.0, 870.0]), np.array([box.left, box.top])
    np.testing.assert_allclose(camera.project(X_cam) + corner, scene.sensor.camera.project(X_cam))


def test_a_region_of_interest_is_cut_with_the_image(scene, seen):
    wanted = np.random.default_rng(0).random(scene.depth.shape) < 0.5
    inside, box = lit_part(seen._replace(sensor=replace(scene.sensor, region_of_interest=wanted)))
    np.testing.assert_array_equal(inside.sensor.region_of_interest, box.of(wanted))


def test_an_image_is_not_cut_where_nothing_tells_what_is_lit(scene, seen):
    bright = np.full_like(scene.images, 0.5)
    assert lit_part(seen._replace(images=bright)) is None  # all of it
    assert lit_part(seen._replace(images=np.zeros_like(bright))) is None
    near = replace(scene.sensor, light_positions=700.0 * np.asarray(lights_of(scene.sensor)[0]))
    assert lit_part(seen._replace(sensor=near)) is None
    no_lights = replace(
        scene.sensor, light_directions=np.zeros((0, 3)), light_intensities=np.zeros(0), depth_noise=0.3
    )
    assert lit_part(Seen(scene.images[:0], no_lights, scene.depth)) is None


@pytest.fixture(scope="module")
def answered(paper_tree, scene):
    return recognize(prepare(paper_tree), scene.images, scene.sensor, scene.depth, scene.R_w2c)


def test_answers_are_those_of_the_whole_image(paper_tree, scene, answered, monkeypatch):
    monkeypatch.setattr(recognition, "lit_part", lambda _: None)
    whole = recognize(prepare(paper_tree), scene.images, scene.sensor, scene.depth, scene.R_w2c)
    assert len(answered) == len(whole) == 1
    assert np.abs(answered[0].R_cam_obj - whole[0].R_cam_obj).max() < 1e-3
    assert np.abs(answered[0].t_cam_obj - whole[0].t_cam_obj).max() < 0.05
    assert answered.labels.shape == whole.labels.shape == scene.depth.shape
    _, box = lit_part(Seen(scene.images, scene.sensor, scene.depth))
    bright = look(scene.images, scene.sensor, scene.depth).lit
    both = box.of(bright)
    assert np.mean((box.of(answered.labels) >= 0)[both] == (box.of(whole.labels) >= 0)[both]) > 0.99
    np.testing.assert_array_equal(answered.depth, scene.depth)


def test_places_are_told_in_the_whole_image(scene, seen, answered):
    _, box = lit_part(seen)
    for region in answered.not_recognised:
        v, u = np.nonzero(answered.labels == region["region"])
        assert len(v) == region["pixels"]
        np.testing.assert_allclose(region["uv"], [u.mean(), v.mean()])
    nowhere = replace(answered, labels=None, not_recognised=({"region": 0, "uv": None, "pixels": 0},))
    told = in_whole_image(nowhere, box, seen)
    assert told.labels is None
    assert told.not_recognised[0]["uv"] is None
