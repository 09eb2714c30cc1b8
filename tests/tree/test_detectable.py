"""Detectable areas and regions in closed form."""

import weakref

import numpy as np
import pytest
from itree_cad.bundled import bundled_part
from itree_kernels.mesh import ray_mesh

from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.tree import detectable as module
from itree_jax.tree.detectable import count_regions, detectable, part_camera, section_direction
from itree_jax.tree.dome import camera_rotation, dome


def test_a_face_seen_head_on_shows_its_area_and_a_slanted_one_its_cosine() -> None:
    part, sensor = bundled_part("plate"), bundled_sensor("ikeuchi-1987")
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle)
    slants = np.radians([0.0, 25.0, 50.0])
    directions = np.stack([np.zeros(3), np.sin(slants), np.cos(slants)], axis=1)
    seen = detectable(mesh, part, sensor, camera_rotation(directions))
    top = int(np.argmax(seen.face_area[0]))
    # Walls of the holes shade a little of nothing here: the top is the highest plane of the plate.
    np.testing.assert_allclose(seen.face_area[:2, top], part.face_areas[top] * np.cos(slants[:2]), rtol=0.01)
    assert seen.face_area[2, top] == 0.0  # beyond the slant limit of 42 degrees
    assert seen.region_count[0] == 1
    assert seen.face_area.shape == (3, part.face_count)


def test_the_views_do_not_depend_on_how_many_are_cast_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    part, sensor = bundled_part("clevis"), bundled_sensor("ikeuchi-1987")
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle)
    R = camera_rotation(np.array([[0.6, 0.0, 0.8], [0.0, 0.6, 0.8], [1.0, 0.0, 0.0]]))
    steps = []
    together = detectable(mesh, part, sensor, R)
    monkeypatch.setattr(module, "PIXELS_AT_ONCE", 1)
    one_by_one = detectable(mesh, part, sensor, R, lambda done, total: steps.append((done, total)))
    np.testing.assert_array_equal(together.face_area, one_by_one.face_area)
    np.testing.assert_array_equal(together.region_count, one_by_one.region_count)
    assert steps == [(1, 3), (2, 3), (3, 3)]


@pytest.mark.parametrize("views", [20, 80])
def test_what_is_held_at_once_is_bounded_whatever_the_number_of_views(
    views: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The maps of a launch and those of the one before: no more are alive at any time."""
    part, sensor = bundled_part("plate"), bundled_sensor("ikeuchi-1987")
    camera = part_camera(part, sensor)
    cast, held, launched, alive = module.cast_apparent_shapes, [], [], []

    def watched(mesh, R_cam_obj, *rest):
        shapes = cast(mesh, R_cam_obj, *rest)
        held.append(weakref.ref(shapes))
        launched.append(len(R_cam_obj))
        alive.append(sum(one() is not None for one in held))
        return shapes

    monkeypatch.setattr(module, "PIXELS_AT_ONCE", 4 * camera.width * camera.height)
    monkeypatch.setattr(module, "cast_apparent_shapes", watched)
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle)
    seen = detectable(mesh, part, sensor, camera_rotation(dome(2).directions[:views]))
    assert launched == [4] * (views // 4)
    assert max(alive) == 2
    assert len(seen.face_area) == views


def test_the_camera_holds_the_part_in_any_attitude() -> None:
    part, sensor = bundled_part("bracket"), bundled_sensor("bench")
    camera = part_camera(part, sensor)
    assert camera.is_orthographic
    assert camera.mm_per_px(1.0) == pytest.approx(sensor.mm_per_px)
    assert camera.width * camera.mm_per_px(1.0) >= part.diameter


def test_regions_touch_at_corners_and_are_larger_than_the_smallest() -> None:
    mask = np.zeros((20, 20), dtype=bool)
    mask[:4, :4] = mask[4:8, 4:8] = True  # joined at a corner: 32 px
    mask[10:14, 10:14] = True  # 16 px
    assert count_regions(mask, 0.0) == 2
    assert count_regions(mask, 15.9) == 2
    assert count_regions(mask, 16.0) == 1
    assert count_regions(mask, 32.0) == 0


@pytest.mark.parametrize("angle", [-1.2, -0.4, 0.0, 0.9])
def test_the_direction_of_a_section_is_its_long_axis(angle: float) -> None:
    x, y = np.meshgrid(np.arange(100) - 50, np.arange(100) - 50)
    along, across = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    assert section_direction((np.abs(along) < 40) & (np.abs(across) < 10)) == pytest.approx(angle, abs=0.01)
    assert section_direction(np.hypot(x, y) < 30) == 0.0
    assert section_direction(np.zeros((5, 5), dtype=bool)) == 0.0
