"""The frame with every lamp off: subtracted, or refused."""

import numpy as np
import pytest
from itree_kernels.errors import ItreeError
from itree_kernels.noise import sensor_noise

from itree_jax.sensing.ambient import subtract_ambient
from itree_jax.sensor import Noise

NOISE = Noise()


def frames(seed=0, size=64):
    """Images under three lamps and ambient light, the frame of it alone, and what the lamps alone give."""
    rng = np.random.default_rng(seed)
    lamps = rng.uniform(0.0, 0.6, (3, size, size))
    ambient = np.linspace(0.02, 0.2, size)[None] * np.ones((size, 1))

    def taken(image, k):
        return sensor_noise(image, NOISE.full_well_e, NOISE.read_noise_e, NOISE.bits, 10 * seed + k)

    return np.stack([taken(lamp + ambient, k) for k, lamp in enumerate(lamps)]), taken(ambient, 9), lamps


def test_what_is_left_is_what_the_lamps_give():
    images, ambient, lamps = frames()
    left = subtract_ambient(images, ambient, NOISE)
    assert left.dtype == np.float32
    assert np.abs(left - lamps).max() < 0.06
    assert abs((left - lamps).mean()) < 2e-4  # noise below zero is not cut off


def test_one_frame_per_light_and_batches():
    images, ambient, _ = frames()
    one = subtract_ambient(images, ambient, NOISE)
    np.testing.assert_array_equal(subtract_ambient(images, np.stack([ambient] * 3), NOISE), one)
    np.testing.assert_array_equal(subtract_ambient(np.stack([images, images]), ambient, NOISE), np.stack([one, one]))


def test_saturated_pixels_stay_saturated():
    images, ambient, _ = frames()
    images[1, 3, 4], ambient[7, 8] = 1.0, 1.0
    images[:, 7, 8] = 1.0
    left = subtract_ambient(images, ambient, NOISE)
    assert left[1, 3, 4] == 1.0
    assert (left[:, 7, 8] == 1.0).all()
    assert left[0, 3, 4] < 1.0


def test_another_size_is_refused():
    images, ambient, _ = frames()
    with pytest.raises(ItreeError, match=r"the ambient frame has shape \(63, 64\)"):
        subtract_ambient(images, ambient[1:], NOISE)


def test_a_frame_that_is_brighter_than_an_image_is_refused():
    images, ambient, _ = frames()
    with pytest.raises(ItreeError, match="brighter than image 2 at 100 % of the pixels"):
        subtract_ambient(images, images[2] + 0.1, NOISE)
    subtract_ambient(images, np.where(np.arange(64) < 0, 1.0, ambient), NOISE)
    something_moved = ambient.copy()
    something_moved[:4, :8] = 0.9  # 0.8 % of the pixels
    subtract_ambient(images, something_moved, NOISE)
