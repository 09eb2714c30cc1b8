"""Draws of a depth camera: their needles err as those of a rendered depth map do, and its trees know their sensor."""

from dataclasses import replace

import numpy as np
import pytest
from itree_cad.bundled import bundled_part
from itree_kernels.apparent import cast_apparent_shapes
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError
from itree_kernels.mesh import ray_mesh

from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.depth_camera import depth_needle_deviation
from itree_jax.sensing.depth_needles import RADIUS, depth_needles
from itree_jax.tree.appearances import appearances, interpretable
from itree_jax.tree.check_sensor import check_sensor
from itree_jax.tree.depth_draws import depth_camera_needles, slope_errors
from itree_jax.tree.dome import camera_rotation, dome
from itree_jax.tree.draws import noisy_draws
from itree_jax.tree.groups import attitude_groups
from itree_jax.tree.sights import sensor_needle_deviation, window_edges

SENSOR = bundled_sensor("depth-bench")
PITCH = 2.0 * SENSOR.mm_per_px  # of a window's pixels [mm]


@pytest.fixture(scope="module")
def block():
    part = bundled_part("ikeuchi-1987")
    return part, ray_mesh(part.vertices, part.triangles, part.face_of_triangle)


def test_slopes_err_as_those_of_a_depth_map():
    """Their deviation, and how neighbours share it, also where that is negative."""
    drawn = slope_errors((24, 48, 48), PITCH, SENSOR, np.random.default_rng(0))
    scale = 1.0 / SENSOR.mm_per_px
    camera = Camera("orthographic", scale, scale, 0.0, 0.0, 400, 300)
    depth = (900.0 + np.random.default_rng(1).normal(0.0, 0.3, (300, 400))).astype(np.float32)
    normals = depth_needles(depth, camera, 0.3).normals[RADIUS + 1 : -RADIUS - 1, RADIUS + 1 : -RADIUS - 1]
    fitted = (normals[..., :2] / -normals[..., 2:])[None]
    assert drawn.std() == pytest.approx(fitted.std(), rel=0.05)
    assert drawn.std() == pytest.approx(sensor_needle_deviation(SENSOR) / np.sqrt(2.0), rel=0.05)
    for lag in (1, 2, 3, 5):
        step = round(lag * PITCH / SENSOR.mm_per_px)
        for axis in (0, 1):
            alike = [
                (a[:, :, apart:, axis] * a[:, :, :-apart, axis]).mean() / a[..., axis].var()
                for a, apart in ((drawn, lag), (fitted, step))
            ]
            assert alike[0] == pytest.approx(alike[1], abs=0.08)


def test_needles_of_slanted_faces_err_as_predicted(angle_between_normals):
    slant = 0.6
    normal = np.broadcast_to(np.float32([np.sin(slant), 0.0, -np.cos(slant)]), (12, 48, 48, 3))
    there = np.ones((12, 48, 48), bool)
    seen, needles = depth_camera_needles(there, normal, PITCH, SENSOR, np.random.default_rng(0))
    rms = np.sqrt((angle_between_normals(needles, normal)[seen] ** 2).mean())
    frontal = depth_needle_deviation(0.3, SENSOR.mm_per_px)
    expected = frontal * np.cos(slant) * np.sqrt((1 + np.cos(slant) ** 2) / 2)
    assert seen.mean() > 0.99
    assert rms == pytest.approx(expected, rel=0.05)


@pytest.fixture
def angle_between_normals():
    return lambda a, b: 2 * np.arcsin(np.clip(np.linalg.norm(np.asarray(a, float) - b, axis=-1) / 2, 0, 1))


def test_the_slant_limit_cuts_and_back_faces_show_nothing():
    slant = np.linspace(0.0, 1.5, 48)
    normal = np.zeros((1, 48, 48, 3), np.float32)
    normal[..., 0], normal[..., 2] = np.sin(slant), -np.cos(slant)
    normal[:, :8, :, 2] *= -1.0
    there = np.ones((1, 48, 48), bool)
    quiet = replace(SENSOR, depth_noise=0.0)
    seen, needles = depth_camera_needles(there, normal, PITCH, quiet, np.random.default_rng(0))
    assert not seen[0, :8].any()
    np.testing.assert_array_equal(seen[0, 8:], np.broadcast_to(slant < SENSOR.slant_limit, (40, 48)))
    np.testing.assert_allclose(needles[seen], normal[seen], atol=1e-6)


def test_only_the_slant_counts_and_no_shadow_does(block):
    _, mesh = block
    R = camera_rotation(dome(1).directions)[:4]
    table = appearances(mesh, SENSOR, R, np.arange(4), 2)
    assert len(table.attitude)
    assert not table.edge_map.any()
    camera = Camera("orthographic", 1.0, 1.0, 39.5, 39.5, 80, 80)
    shapes = cast_apparent_shapes(mesh, R, np.zeros((4, 3)), camera, SENSOR.light_directions, SENSOR.slant_limit)
    assert shapes.lit.shape == (4, 0, 80, 80)
    facing = -shapes.normal[..., 2] > np.cos(SENSOR.slant_limit)
    np.testing.assert_array_equal(shapes.detectable, facing)
    np.testing.assert_array_equal(interpretable(shapes, SENSOR), facing)


def test_draws_alone_and_beside_others_follow_their_seed(block):
    _, mesh = block
    R = camera_rotation(dome(1).directions)[::5]
    group = np.zeros(len(R), int)
    first, again = (noisy_draws(mesh, SENSOR, R, group, np.random.default_rng(3)) for _ in range(2))
    assert first.cut.any()
    assert not first.cut.all()
    np.testing.assert_array_equal(first.features.egi, again.features.egi)
    assert not np.asarray(first.features.edge_map).any()
    for field in (first.features.outline, first.features.egi, first.features.brothers, first.features.mean_normal):
        assert np.isfinite(field).all()


def test_without_lights_there_are_no_edges():
    edges = window_edges(np.zeros((2, 0, 16, 16), np.float32), SENSOR.noise)
    assert edges.shape == (2, 16, 16, 2)
    assert not np.asarray(edges).any()


def test_a_hole_is_as_good_as_any_face(block):
    """It lights itself, which only lights suffer from: no group is pruned for it."""
    part, mesh = block
    groups = attitude_groups(mesh, part, SENSOR, 1)
    assert not groups.pruned.any()
    assert not groups.self_blocking.any()


def test_a_tree_of_one_kind_is_not_for_a_scene_of_the_other(paper_tree):
    with pytest.raises(ItreeError, match=r"compiled for 3 lights, and this scene is a depth camera's.*itree compile"):
        check_sensor(paper_tree, SENSOR)
    of_depth = replace(paper_tree, sensor=SENSOR)
    with pytest.raises(ItreeError, match=r"compiled for a depth camera, and this scene has lights.*without lit/"):
        check_sensor(of_depth, paper_tree.sensor)
    check_sensor(of_depth, replace(SENSOR, depth_noise=0.2))
    with pytest.raises(ItreeError, match="slant limit"):
        check_sensor(of_depth, replace(SENSOR, slant_limit=0.5))
