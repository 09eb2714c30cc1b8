"""Too dark, too bright, the same image twice: refused with the number that says why."""

import numpy as np
import pytest
from itree_kernels.errors import ItreeError
from itree_kernels.noise import sensor_noise

from itree_jax.sensing.exposure import check_different, check_exposure, differing_share
from itree_jax.sensor import Noise

NOISE = Noise()
NAMES = ("a.png", "b.png", "c.png")
ONES = np.ones(3)


@pytest.fixture
def taken(make_lights, sphere, shade):
    """A sphere under three lights of a given full albedo, with the sensor's noise."""

    def images(albedo=0.6, e=ONES, seed=0):
        ideal = shade(sphere, make_lights(3), e, albedo)
        noise = NOISE.full_well_e, NOISE.read_noise_e, NOISE.bits
        return np.stack([sensor_noise(image, *noise, seed + k) for k, image in enumerate(ideal)])

    return images


def test_a_good_exposure_passes_without_a_word(taken):
    images = taken()
    assert check_exposure(images, ONES, NOISE, NAMES) == []
    check_different(images, NOISE, NAMES)


def test_too_dark_is_refused_and_dark_is_warned_of(taken):
    with pytest.raises(ItreeError, match=r"too dark: .*png, the brightest, has 0.00\d+ of full scale"):
        check_exposure(taken(0.005), ONES, NOISE, NAMES)
    (warning,) = check_exposure(taken(0.04), ONES, NOISE, NAMES)
    assert "is dark: 0.0" in warning
    assert "needles want 27 times" in warning


def test_a_lamp_that_is_off_is_named(taken):
    images = taken()
    images[1] = taken(0.01)[1]
    with pytest.raises(ItreeError, match=r"b.png \(light 1\) is dark: .* Was lamp 1 on\?"):
        check_exposure(images, ONES, NOISE, NAMES)
    # a weak lamp that is told to be weak is none that is off
    weak = np.array([1.0, 0.05, 1.0])
    check_exposure(taken(0.9, weak), weak, NOISE, NAMES)


def test_saturation_is_refused_by_faces_and_warned_of_by_highlights(taken):
    with pytest.raises(ItreeError, match=r"a.png: \d\d.\d % of the lit pixels are saturated, at most 25 % may be"):
        check_exposure(taken(1.6), ONES, NOISE, NAMES)
    (*_, warning) = check_exposure(taken(1.03), ONES, NOISE, NAMES)
    assert "c.png" in warning
    assert "saturated; they carry no needle" in warning


def test_the_same_file_twice_is_refused(taken):
    images = taken()
    images[2] = images[0]
    with pytest.raises(ItreeError, match=r"a.png and c.png \(lights 0 and 2\) are the same image"):
        check_different(images, NOISE, NAMES)


@pytest.mark.parametrize("exposure", [1.0, 0.7])
def test_a_lamp_that_was_not_switched_is_refused(taken, exposure):
    images = taken()
    images[2] = taken(0.6 * exposure, seed=50)[1]
    with pytest.raises(ItreeError, match=r"b.png and c.png \(lights 1 and 2\) show the same light"):
        check_different(images, NOISE, NAMES)
    assert differing_share(images[1], images[2], NOISE) < 0.001
    assert differing_share(images[0], images[1], NOISE) > 0.3


def test_a_face_that_only_one_light_reaches_tells_two_lights_apart():
    """What both lights reach may be one flat face, which looks the same under both but for its brightness."""
    a, b = np.full((40, 40), 0.02), np.full((40, 40), 0.02)
    a[5:20, 5:35], b[5:20, 5:35] = 0.7, 0.3
    a[20:25, 5:35], b[20:25, 5:35] = 0.03, 0.6
    assert differing_share(a, b, NOISE) == pytest.approx(5 / 20)
    assert differing_share(b, a, NOISE) == pytest.approx(5 / 20)


def test_black_images_differ_in_nothing_that_could_be_told():
    assert differing_share(np.zeros((8, 8)), np.zeros((8, 8)), NOISE) == 1.0
