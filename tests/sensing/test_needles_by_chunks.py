"""A needle map by chunks of pixels is the needle map, for images of any size, from one compiled program."""

from dataclasses import replace

import numpy as np
import pytest

from itree_jax.sensing import needles_by_chunks
from itree_jax.sensing.needles_by_chunks import CHUNK, needle_map_on_host
from itree_jax.sensing.photometric import needle_map, read_pixels

SIZES = ((80, 120), (CHUNK // 160, 160), (150, 170))  # less than a chunk, one, and more


@pytest.fixture(scope="module")
def scene(paper_part_on_a_table):
    return paper_part_on_a_table[0]


def part_of(scene, height, width):
    camera = scene.sensor.camera.cropped(20, 10, width, height)
    return scene.images[:, 10 : 10 + height, 20 : 20 + width], replace(scene.sensor, camera=camera)


@pytest.mark.parametrize(("height", "width"), SIZES)
def test_chunks_make_the_needle_map(scene, height, width):
    images, sensor = part_of(scene, height, width)
    found, whole = needle_map_on_host(images, sensor, None), needle_map(images, sensor)
    for name, of_chunks, expected in zip(found._fields, found, whole, strict=True):
        expected = np.asarray(expected)
        assert of_chunks.shape == expected.shape, name
        assert of_chunks.dtype == expected.dtype, name
        np.testing.assert_allclose(of_chunks, expected, atol=2e-5, err_msg=name)


def test_images_of_all_sizes_are_read_by_one_program(scene, monkeypatch):
    shapes = set()

    def counted(images, *rest):
        shapes.add((images.shape, images.dtype))
        return read_pixels(images, *rest)

    monkeypatch.setattr(needles_by_chunks, "read_pixels", counted)
    for size in SIZES:
        needle_map_on_host(*part_of(scene, *size), None)
    assert len(shapes) == 1


def test_lights_that_stand_near_differ_from_pixel_to_pixel(scene):
    images, sensor = part_of(scene, 40, 60)
    near = replace(sensor, light_positions=sensor.light_directions * 700.0 + [0.0, 0.0, sensor.working_distance])
    found, whole = needle_map_on_host(images, near, None), needle_map(images, near)
    np.testing.assert_array_equal(found.normals, np.asarray(whole.normals))
    distant = needle_map_on_host(images, sensor, None)
    assert np.abs(found.normals - distant.normals).max() > 0.01
