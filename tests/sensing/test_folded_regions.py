"""What is longer than any part is of several parts, and is cut where it folds; the rest stays as it is."""

from dataclasses import replace

import numpy as np
import pytest

from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.folded_regions import parted_at_folds
from itree_jax.sensing.regions import regions

from .test_regions import needles

HEIGHT, WIDTH = 60, 120
TURN = np.radians(30.0)


@pytest.fixture(scope="module")
def sensor():
    full = bundled_sensor("bench")
    return replace(full, camera=replace(full.camera, width=WIDTH, height=HEIGHT, cx=59.5, cy=29.5), smallest_region=0.0)


def two_faces(sensor, turn):
    """A level face, and from column 50 on one that falls away by `turn` [rad]: needles, depth [mm]."""
    depth = np.full((HEIGHT, WIDTH), sensor.working_distance, np.float32)
    size = sensor.camera.mm_per_px(sensor.working_distance)
    depth[:, 50:] += (np.tan(turn) * size * np.arange(1, WIDTH - 49)).astype(np.float32)
    normals = np.tile([0.0, 0.0, -1.0], (HEIGHT, WIDTH, 1))
    normals[:, 50:] = -np.sin(turn), 0.0, -np.cos(turn)
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[20:40, 10:110] = True
    return needles(mask, normals), depth


def test_a_region_of_two_parts_is_cut_at_the_fold(sensor):
    needle, depth = two_faces(sensor, TURN)
    whole = regions(needle, depth, sensor)
    assert whole.count == 1
    size = sensor.camera.mm_per_px(sensor.working_distance)
    parted = parted_at_folds(whole, needle.normals, depth, sensor, longest=70 * size)
    assert parted.count == 2
    assert parted.height[0] > parted.height[1]  # the level one is the higher
    assert (parted.labels[25:35, 12:47] == 0).all()
    assert (parted.labels[25:35, 54:108] == 1).all()
    np.testing.assert_allclose(parted.mean_normal[1], [-np.sin(TURN), 0.0, -np.cos(TURN)], atol=1e-6)
    assert not (parted.labels[whole.labels < 0] >= 0).any()


def test_what_may_be_one_part_s_is_not(sensor):
    needle, depth = two_faces(sensor, TURN)
    whole = regions(needle, depth, sensor)
    size = sensor.camera.mm_per_px(sensor.working_distance)
    assert parted_at_folds(whole, needle.normals, depth, sensor, longest=150 * size) is whole


def test_nor_is_what_does_not_fold(sensor):
    """Parts that lie flush are found as pieces of one region."""
    needle, depth = two_faces(sensor, 0.0)
    whole = regions(needle, depth, sensor)
    assert parted_at_folds(whole, needle.normals, depth, sensor, longest=1.0) is whole


def test_regions_beside_stay_and_the_highest_comes_first(sensor):
    needle, depth = two_faces(sensor, TURN)
    mask = np.asarray(needle.interpretable).copy()
    mask[2:8, 2:8] = True
    depth[:12, :12] -= 40.0
    normals = np.where(mask[..., None], np.where(needle.interpretable[..., None], needle.normals, [0, 0, -1.0]), 0.0)
    both = needles(mask, normals)
    whole = regions(both, depth, sensor)
    assert whole.count == 2
    size = sensor.camera.mm_per_px(sensor.working_distance)
    parted = parted_at_folds(whole, both.normals, depth, sensor, longest=70 * size)
    assert parted.count == 3
    assert (np.diff(parted.height) <= 0).all()
    np.testing.assert_array_equal(parted.labels == 0, whole.labels == 0)
    assert parted.area_px[0] == 36
