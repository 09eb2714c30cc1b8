"""Attitudes of the whole dome, each once up to the part's symmetries."""

import numpy as np
import pytest
from itree_cad.bundled import bundled_part
from itree_cad.symmetry import Symmetries, symmetries

from itree_jax.open_attitudes import ROLLS, all_attitudes, distinct_attitudes, rolls, views

NONE = Symmetries(np.eye(4)[None], ())


@pytest.fixture(scope="module")
def bracket():
    return bundled_part("bracket")


def test_all_attitudes_are_the_views_under_all_rolls():
    R = all_attitudes()
    assert len(R) == 60 * ROLLS
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.tile(np.eye(3), (len(R), 1, 1)), atol=1e-12)
    np.testing.assert_allclose(R.reshape(60, ROLLS, 3, 3)[7, 4], rolls()[4] @ views()[7], atol=1e-12)


def test_a_part_without_symmetry_keeps_all(bracket):
    np.testing.assert_array_equal(distinct_attitudes(bracket, NONE), np.arange(60 * ROLLS))


def test_a_half_turn_leaves_half():
    clevis = bundled_part("clevis")
    own = symmetries(clevis)
    assert len(own.discrete) == 2
    assert 0.4 * 60 * ROLLS < len(distinct_attitudes(clevis, own)) < 0.6 * 60 * ROLLS


def test_of_a_part_of_revolution_every_direction_of_the_axis_is_kept():
    """About as many as the dome and rolls tell apart: every attitude's axis is within half a step of a kept one's."""
    bushing = bundled_part("stepped-bushing")
    own = symmetries(bushing)
    kept = distinct_attitudes(bushing, own)
    axes = all_attitudes() @ own.continuous[0][0]
    nearest = np.max(axes @ axes[kept].T, axis=1)
    assert np.degrees(np.arccos(np.clip(nearest, -1.0, 1.0))).max() < 12.0
    assert len(kept) < 0.2 * 60 * ROLLS
