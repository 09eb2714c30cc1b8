"""Segments of a depth map: cut at steps, joined by slopes, lit or not."""

from dataclasses import replace

import numpy as np
import pytest

from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.segments import depth_segments, extents, faces_of_segments, held_by


@pytest.fixture(scope="module")
def sensor():
    full = bundled_sensor("bench")
    camera = replace(full.camera, width=80, height=60, cx=39.5, cy=29.5)
    return replace(full, camera=camera)


def two_blocks() -> np.ndarray:
    """A slope on the left, a block 20 mm higher on the right, and a hole."""
    depth = np.full((60, 80), 900.0)
    depth[:, :40] += 0.2 * np.arange(40)
    depth[:, 40:] = 880.0
    depth[:5, :5] = 0.0
    return depth


def test_a_step_cuts_and_a_slope_does_not(sensor):
    labels = depth_segments(two_blocks(), sensor)
    left, right = labels[10:, 1:36], labels[:, 44:]
    assert np.unique(left).size == 1
    assert np.unique(right).size == 1
    assert left[0, 0] != right[0, 0]
    assert (labels[:4, :4] == 0).all()


def test_a_region_gets_the_centre_of_its_whole_segment(sensor):
    """However small the lit part of the block is, the centre is the block's."""
    labels = np.full((60, 80), -1)
    labels[10:15, 60:66] = 0
    labels[40:44, 10:14] = 1
    found = held_by(labels, two_blocks(), sensor)
    centres = found.centre
    assert found.segment[0] != found.segment[1]
    u = np.arange(40, 80)
    expected = sensor.camera.unproject(np.array([[u.mean(), 29.5]]), np.array([880.0]))[0]
    np.testing.assert_allclose(centres[0], expected, atol=2 * sensor.camera.mm_per_px(880.0))
    assert centres[1][2] == pytest.approx(900 + 0.2 * 19.5, abs=0.5)


def roof(turn: float) -> np.ndarray:
    """Normals of two planes that meet in column 40, either one turned by half of so many degrees."""
    half = np.radians(turn / 2)
    normals = np.zeros((60, 80, 3))
    normals[..., 2] = -np.cos(half)
    normals[:, :40, 0], normals[:, 40:, 0] = -np.sin(half), np.sin(half)
    return normals


@pytest.mark.parametrize(("turn", "count"), [(30.0, 2), (10.0, 1)])
def test_a_fold_parts_a_segment_and_a_slight_bend_does_not(turn, count):
    """Along columns as along rows, and nothing of one face gets into the other."""
    whole, normals = np.full((60, 80), 3), roof(turn)
    for pieces in (faces_of_segments(whole, normals), faces_of_segments(whole.T, normals.swapaxes(0, 1)).T):
        assert len(np.unique(pieces[pieces > 0])) == count
        assert (pieces[:, :37] > 0).all()
        assert (pieces[:, 43:] > 0).all()


def test_segments_stay_apart_and_pixels_without_a_normal_belong_to_none():
    segments = np.ones((60, 80), int)
    segments[:, 39:41] = 0
    normals = roof(0.0)
    normals[:10] = 0.0
    pieces = faces_of_segments(segments, normals)
    assert (pieces[:10] == 0).all()
    assert (pieces[10:, 39:41] == 0).all()
    assert pieces[20, 10] != pieces[20, 70]
    assert (pieces[10:, :39] == pieces[20, 10]).all()


def test_the_area_is_that_of_the_whole_segment(sensor):
    labels = np.full((60, 80), -1)
    labels[10:15, 60:66] = 0
    labels[30:32, 70:75] = 1
    found = held_by(labels, two_blocks(), sensor)
    assert found.segment[0] == found.segment[1]
    np.testing.assert_allclose(found.area_mm2, 60 * 40 * sensor.camera.mm_per_px(880.0) ** 2, rtol=0.05)


def test_a_region_on_no_segment_stands_for_itself(sensor):
    """As a sliver along a step does; beside it, others keep their own."""
    depth = two_blocks()
    nowhere = depth_segments(depth, sensor) == 0
    labels = np.where(nowhere & (depth > 0), 0, -1)
    labels[20:25, 60:66] = 1
    found = held_by(labels, depth, sensor)
    assert found.segment[0] != found.segment[1]
    v, u = np.nonzero(labels == 0)
    own = sensor.camera.unproject(np.stack([u, v], axis=-1).astype(float), depth[v, u])
    np.testing.assert_allclose(found.centre[0], own.mean(axis=0))
    assert found.area_mm2[0] == pytest.approx(len(v) * sensor.camera.mm_per_px(own[:, 2].mean()) ** 2)


def test_no_extent_is_more_than_the_points_are_apart_and_none_is_much_less():
    """Of two points it is their distance, less the cosine of their angle to the nearest of the directions."""
    rng = np.random.default_rng(8)
    pairs = rng.normal(size=(500, 2, 3)) * rng.uniform(1.0, 100.0, size=(500, 1, 1))
    apart = np.linalg.norm(pairs[:, 0] - pairs[:, 1], axis=-1)
    of, order = np.repeat(np.arange(500), 2), rng.permutation(1000)
    found = extents(pairs.reshape(-1, 3)[order], of[order], 501)
    assert (found[:500] <= apart * (1.0 + 1e-9)).all()
    assert (found[:500] >= apart * np.cos(np.radians(28.0))).all()
    assert found[500] == 0.0
    assert extents(np.zeros((0, 3)), np.zeros(0, int), 2).tolist() == [0.0, 0.0]


def test_a_region_is_held_by_all_that_reaches_as_far_as_its_segment(sensor):
    depth = np.zeros((60, 80), np.float32)
    depth[20:31, 10:71] = sensor.working_distance
    labels = np.full(depth.shape, -1)
    labels[22:26, 20:30] = 0
    size = sensor.camera.mm_per_px(sensor.working_distance)
    assert held_by(labels, depth, sensor).extent_mm[0] == pytest.approx(60 * size, rel=0.05)
