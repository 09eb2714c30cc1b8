"""Two lights and a known albedo leave two normals, mirror images in the plane of the lights."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from itree_jax.sensing.two_lights import BRIGHTEST, LEAST_LIT, two_light_needles

TOWARD = np.array([0.0, 0.0, -1.0])
LIGHTS = np.array([[0.5, 0.0, -0.8], [-0.3, 0.45, -0.8], [-0.3, -0.45, -0.8]])
LIGHTS /= np.linalg.norm(LIGHTS, axis=1, keepdims=True)


def needles(shading, lights=LIGHTS):
    """Both normals of one pixel; None where one can't be seen."""
    both = two_light_needles(np.asarray(shading, float)[None], lights, TOWARD[None])
    return [n[0].astype(float) if seen[0] else None for n, seen in both]


@settings(max_examples=200)
@given(slant=st.floats(0.0, 1.2), azimuth=st.floats(0.0, 6.28), dark=st.integers(0, 2), fill=st.floats(0.0, 0.15))
def test_one_of_both_is_the_surface_s_own(slant, azimuth, dark, fill):
    """Whichever light is dark, with whatever reflected light in its shadow."""
    normal = np.array([np.sin(slant) * np.cos(azimuth), np.sin(slant) * np.sin(azimuth), -np.cos(slant)])
    shading = LIGHTS @ normal
    shading[dark] = fill
    others = np.delete(LIGHTS, dark, axis=0)
    both = needles(shading)
    if (np.delete(shading, dark) < LEAST_LIT + 1e-3).any():
        return
    told = [n for n in both if n is not None]
    assert min(np.linalg.norm(n - normal) for n in told) < 1e-3
    for n in told:
        np.testing.assert_allclose(others @ n, others @ normal, atol=1e-3)


def test_both_are_mirror_images_and_the_first_has_its_shadow_from_itself():
    shading = [0.9, 0.7, 0.05]
    first, second = needles(shading)
    across = np.cross(LIGHTS[0], LIGHTS[1])
    across /= np.linalg.norm(across)
    np.testing.assert_allclose(first - 2.0 * (first @ across) * across, second, atol=1e-6)
    assert LIGHTS[2] @ first < LIGHTS[2] @ second


def test_what_is_too_dark_or_too_bright_tells_nothing():
    assert needles([0.9, LEAST_LIT - 0.01, 0.0]) == [None, None]
    assert needles([1.3, 1.3, 0.0]) == [None, None]  # a highlight: no unit normal is so bright under both
    along = LIGHTS[0] + LIGHTS[1]
    most = LIGHTS @ (along / np.linalg.norm(along))
    noisy = needles([1.02 * most[0], 1.02 * most[1], 0.0])  # noise of a surface that faces both
    assert all(n is not None for n in noisy)
    assert BRIGHTEST > 1.02**2


def test_lights_in_one_direction_tell_nothing():
    twice = np.array([LIGHTS[0], LIGHTS[0]])
    assert needles([0.8, 0.8], twice) == [None, None]


@pytest.mark.parametrize("count", [2, 4])
def test_any_number_of_lights(count):
    lights = np.array([[np.cos(a), np.sin(a), -1.5] for a in 2.0 * np.pi * np.arange(count) / count + 0.3])
    if count == 2:
        lights[1] = [0.0, 1.0, -1.5]
    lights /= np.linalg.norm(lights, axis=1, keepdims=True)
    normal = np.array([0.1, -0.2, -1.0]) / np.linalg.norm([0.1, -0.2, -1.0])
    shading = lights @ normal
    shading[2:] = 0.0
    assert min(np.linalg.norm(n - normal) for n in needles(shading, lights) if n is not None) < 1e-3
