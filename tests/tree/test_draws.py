"""Noisy draws: attitudes of their group, regions as the sensor sees them, alone and beside another part."""

import dataclasses

import numpy as np
import pytest
from itree_kernels.errors import ItreeError

from itree_jax.sensor import Noise
from itree_jax.tree.dome import dome
from itree_jax.tree.draws import noisy_draws, random_attitudes

QUIET = Noise(full_well_e=1e9, read_noise_e=0.0, bits=24)


def rng(*seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_attitudes_look_from_within_the_cells_of_their_group_at_any_roll():
    cells = dome(1).triangles
    group = np.arange(60) % 3
    R, of_draw = random_attitudes(cells, group, 500, rng(0))
    np.testing.assert_array_equal(np.bincount(of_draw), [500, 500, 500])
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.tile(np.eye(3), (1500, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(R), 1.0, atol=1e-12)
    toward_viewer = -R[:, 2]
    # barycentric coordinates in the cone of every cell: all positive in exactly one
    weights = np.einsum("cij,dj->dci", np.linalg.inv(cells.transpose(0, 2, 1)), toward_viewer)
    inside = (weights > -1e-9).all(axis=-1)
    assert (inside.sum(axis=1) == 1).all()
    cell = inside.argmax(axis=1)
    np.testing.assert_array_equal(group[cell], of_draw)
    assert len(np.unique(cell)) == 60
    # rolls: the images of a fixed direction of the part point everywhere
    angle = np.arctan2(R[:, 1, 2], R[:, 0, 2])
    assert np.abs(np.exp(1j * angle).mean()) < 3.0 / np.sqrt(1500)


def test_attitudes_follow_their_seed():
    cells, group = dome(1).triangles, np.zeros(60, int)
    first, again, other = (random_attitudes(cells, group, 5, rng(s))[0] for s in (4, 4, 5))
    np.testing.assert_array_equal(first, again)
    assert (np.abs(first - other).max(axis=(1, 2)) > 1e-3).all()


def test_draws_are_measured_as_the_sensor_sees_them(gem, sensor):
    """Lights on the axis tell no normal, so these are the paper's: a convex solid has no cast shadow."""
    R, group = random_attitudes(dome(1).triangles, np.zeros(60, int), 40, rng(1))
    noisy, quiet = (
        noisy_draws(gem, s, R, group, rng(2), cut=False) for s in (sensor, dataclasses.replace(sensor, noise=QUIET))
    )
    for draws in (noisy, quiet):
        assert len(draws.group) + draws.empty == 40
        assert len(draws.features.area) == len(draws.R_cam_obj) == len(draws.group)
    assert quiet.empty == 0
    common = np.array([np.flatnonzero((quiet.R_cam_obj == one).all(axis=(1, 2)))[0] for one in noisy.R_cam_obj])
    turn = np.arccos(np.clip((noisy.features.mean_normal * quiet.features.mean_normal[common]).sum(1), -1, 1))
    assert 0 < np.median(np.degrees(turn)) < 2.0
    ratio = noisy.features.area / quiet.features.area[common]
    assert abs(np.median(ratio) - 1.0) < 0.05


def test_noise_that_hides_the_part_is_an_error(gem, sensor):
    blind = dataclasses.replace(sensor, noise=Noise(full_well_e=100.0, read_noise_e=1000.0, bits=8))
    R, group = random_attitudes(dome(1).triangles, np.zeros(60, int), 4, rng(0))
    with pytest.raises(ItreeError, match=r"none of 4 views .* noise"):
        noisy_draws(gem, blind, R, group, rng(0))
