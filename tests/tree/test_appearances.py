"""Appearances of shapes whose regions are known in closed form."""

import dataclasses

import numpy as np
import pytest
from itree_kernels.apparent import cast_apparent_shapes
from itree_kernels.mesh import ray_mesh

from itree_jax.tree.appearances import WINDOW_SIZE, appearances, interpretable, mesh_reach, turned, window_camera
from itree_jax.tree.dome import camera_rotation, dome
from itree_jax.tree.groups import roll_rotation
from itree_jax.tree.sights import MOST_REGIONS, largest_regions

from ..primitives import sphere_part

RADIUS = 25.0


@pytest.fixture(scope="module")
def sphere():
    part = sphere_part(RADIUS, 192)
    return ray_mesh(part.vertices, part.triangles, part.face_of_triangle)


def test_a_sphere_shows_the_cap_within_the_slant_limit_from_everywhere(sphere, sensor):
    directions = dome(1).directions[::15]
    table = appearances(sphere, sensor, camera_rotation(directions), np.arange(4), 3)
    limit = sensor.slant_limit
    np.testing.assert_array_equal(table.attitude, np.arange(12))
    np.testing.assert_array_equal(table.view, np.repeat(np.arange(4), 3))
    np.testing.assert_allclose(table.area, 2 * np.pi * RADIUS**2 * (1 - np.cos(limit)), rtol=0.02)
    np.testing.assert_allclose(table.mean_normal, np.tile([0, 0, -1], (12, 1)), atol=0.01)
    np.testing.assert_allclose(table.egi.sum(axis=1), table.area, rtol=1e-4)
    # a cap's mass centre is as far out as the middle of its height
    np.testing.assert_allclose(table.mass_centre, np.tile([0, 0, -(1 + np.cos(limit)) / 2], (12, 1)), atol=0.01)
    # mean height of the sphere above the disc of radius R sin(limit), by Cavalieri
    height = 2 / 3 * RADIUS * (1 - np.cos(limit) ** 3) / np.sin(limit) ** 2
    np.testing.assert_allclose(table.centroid_obj, height * np.repeat(directions, 3, axis=0), atol=0.02 * RADIUS)
    disc = RADIUS * np.sin(limit)
    np.testing.assert_allclose(table.outline, disc, rtol=0.06)  # of a disc of 9 pixels
    assert (table.inertia[:, 3] < 0.05).all()


def test_the_window_holds_the_part_at_any_attitude(gem):
    camera, pitch = window_camera(mesh_reach(gem))
    assert WINDOW_SIZE * pitch > 2 * np.linalg.norm(gem.vertices, axis=1).max()
    centre = camera.project(np.zeros((1, 3)))[0]
    np.testing.assert_allclose(centre, (WINDOW_SIZE - 1) / 2)
    assert camera.mm_per_px(1.0) == pytest.approx(pitch)


def test_a_roll_turns_the_image_and_keeps_the_viewer():
    R = camera_rotation(dome(1).directions[:5])
    rolled = turned(R, 8)
    assert rolled.shape == (5, 8, 3, 3)
    np.testing.assert_allclose(rolled[:, 0], R, atol=1e-12)
    np.testing.assert_allclose(rolled[:, :, 2], np.repeat(R[:, None, 2], 8, axis=1), atol=1e-12)
    np.testing.assert_allclose(rolled[:, 3], roll_rotation(np.array(3 * np.pi / 4)) @ R, atol=1e-12)
    np.testing.assert_allclose(rolled[:, 2, 1], R[:, 0], atol=1e-12)  # a quarter turn: what was along x is along y


def test_regions_are_connected_over_corners_large_enough_and_the_largest_first():
    mask = np.zeros((20, 20), bool)
    mask[0, 0:3] = True  # 3 pixels
    mask[5, 5] = mask[6, 6] = mask[7, 5] = mask[8, 4] = True  # 4 pixels, over corners
    mask[12:15, 2:4] = True  # 6 pixels
    mask[12:17, 10:12] = True  # 10 pixels
    mask[19, 19] = True
    assert [int(region.sum()) for region in largest_regions(mask, 3, most=9)] == [10, 6, 4, 3]
    assert [int(region.sum()) for region in largest_regions(mask, 4, most=9)] == [10, 6, 4]
    assert [int(region.sum()) for region in largest_regions(mask, 1)] == [10, 6, 4][:MOST_REGIONS]
    np.testing.assert_array_equal(np.sum(largest_regions(mask, 1, most=9), axis=0), mask)
    assert largest_regions(np.zeros((5, 5), bool), 1) == []


def test_three_of_more_lights_are_enough_and_three_of_three_are_the_detectable_ones(sensor):
    from itree_cad.bundled import bundled_part

    part = bundled_part("clevis")  # its arms shade each other
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle)
    camera, _ = window_camera(mesh_reach(mesh))
    R = camera_rotation(dome(1).directions[::7])
    four = np.array([[0.5736, 0, -0.8192], [0, 0.5736, -0.8192], [-0.5736, 0, -0.8192], [0, -0.5736, -0.8192]])

    def seen(lights):
        own = dataclasses.replace(sensor, light_directions=lights, light_intensities=np.ones(len(lights)))
        shapes = cast_apparent_shapes(mesh, R, np.zeros((len(R), 3)), camera, lights, sensor.slant_limit)
        return interpretable(shapes, own), shapes

    with_three, shapes = seen(sensor.light_directions)
    np.testing.assert_array_equal(with_three, shapes.detectable)
    with_four, shapes = seen(four)
    assert with_four[shapes.detectable].all()
    triples = [seen(np.delete(four, k, axis=0))[0] for k in range(4)]
    np.testing.assert_array_equal(with_four, np.any(triples, axis=0))
    assert with_four.sum() > shapes.detectable.sum()
