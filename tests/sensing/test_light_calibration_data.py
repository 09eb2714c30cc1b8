"""Real photographs: lights from a mirror and from a matte sphere, and needle maps of whole folders as they are."""

import os
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from itree_jax.sensing.light_calibration.calibrate import calibrate, load_sphere
from itree_jax.sensing.light_calibration.matte import lights_from_shading
from itree_jax.sensing.light_source import FROM_VIEWER
from itree_jax.sensing.needle_input import load_needle_input
from itree_jax.sensing.photometric import least_squares, needle_map

from .rendered_spheres import degrees_between

REPOSITORY = Path(__file__).resolve().parents[2]
PHOTOGRAPHS = Path(os.environ.get("ITREE_DATA", REPOSITORY.parent / "shared" / "data")) / "photometric"

pytestmark = pytest.mark.skipif(not PHOTOGRAPHS.is_dir(), reason=f"no photographs at {PHOTOGRAPHS} (set ITREE_DATA)")


@pytest.fixture(scope="module")
def matte():
    return load_sphere(PHOTOGRAPHS / "gray_sphere")


def test_mirror_and_matte_sphere_agree_on_most_lights(matte):
    """Two degrees: the grey ball is stained and flatter than Lambert's law, and its images leave 3 to 5 % of it."""
    chrome = calibrate([load_sphere(PHOTOGRAPHS / "chrome_sphere")], "chrome", matte=matte)
    shaded = calibrate([matte], "matte")
    apart = degrees_between(chrome.directions, shaded.directions)
    assert len(apart) == 12
    assert np.median(apart) < 2.0
    np.testing.assert_allclose(chrome.intensities, shaded.intensities, rtol=0.03)


def test_half_of_the_pixels_agree_within_a_degree(matte):
    v, u = np.indices(matte.images.shape[1:]) // 16
    halves = [lights_from_shading(matte.images, matte.sphere, (u + v) % 2 == k).directions for k in (0, 1)]
    assert degrees_between(*halves).max() < 1.0


def test_the_colours_of_a_mirror_agree_within_a_degree():
    found = [calibrate([load_sphere(PHOTOGRAPHS / "chrome_sphere", channel=c)], "chrome") for c in ("red", "blue")]
    assert degrees_between(found[0].directions, found[1].directions).max() < 1.0


def test_robust_stereo_of_the_ball_as_it_is_errs_a_third_less_than_least_squares():
    given = load_needle_input(PHOTOGRAPHS / "ball")
    v, u = np.nonzero(given.mask)
    box = np.s_[..., v.min() : v.max() + 1, u.min() : u.max() + 1]
    truth = scipy.io.loadmat(PHOTOGRAPHS / "ball" / "Normal_gt.mat")["Normal_gt"] * FROM_VIEWER
    images, mask, truth, s = given.images[box], given.mask[box], truth[box[1:]], given.sensor
    plain = least_squares(images, s.light_directions, s.light_intensities, s.noise)
    errors = []
    for needle in (plain, needle_map(images, s)):
        there = np.asarray(needle.interpretable) & mask
        assert there.sum() > 0.95 * mask.sum()
        errors.append(degrees_between(needle.normals, truth)[there].mean())
    assert errors[1] < 0.7 * errors[0]
