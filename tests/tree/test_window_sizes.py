"""Windows come in a few sizes, so that a region is measured once for all parts of about one size."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from itree_jax.tree.appearances import SIZES_PER_OCTAVE, WINDOW_MARGIN, WINDOW_SIZE, window_camera

REACHES = st.floats(0.1, 1e4)


@given(REACHES)
def test_a_window_is_at_least_as_large_as_the_part_wants_and_less_than_a_size_larger(reach):
    wanted = WINDOW_MARGIN * 2.0 * reach / WINDOW_SIZE
    camera, pitch = window_camera(reach)
    assert wanted * (1 - 1e-9) <= pitch < wanted * 2.0 ** (1.0 / SIZES_PER_OCTAVE) * (1 + 1e-9)
    assert camera.mm_per_px(1.0) == pytest.approx(pitch)


@given(REACHES, REACHES)
def test_a_larger_part_has_no_smaller_window(a, b):
    assert window_camera(max(a, b))[1] >= window_camera(min(a, b))[1]


def test_sizes_are_a_quarter_of_an_octave_apart():
    pitches = {window_camera(reach)[1] for reach in np.linspace(20.0, 80.0, 500)}
    steps = SIZES_PER_OCTAVE * np.log2(sorted(pitches))
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert len(pitches) <= 2 * SIZES_PER_OCTAVE + 1  # two octaves


def test_a_size_is_its_own():
    """A part that just fits a size gets it."""
    for k in range(-8, 9):
        pitch = 2.0 ** (k / SIZES_PER_OCTAVE)
        assert window_camera(pitch * WINDOW_SIZE / (2.0 * WINDOW_MARGIN))[1] == pytest.approx(pitch, rel=1e-12)
