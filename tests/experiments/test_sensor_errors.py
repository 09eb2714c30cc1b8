"""What errors of the sensor cost: laws of the experiment's rig."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sensor_errors import ALBEDO, NOISELESS, OFF_AXIS, SLANT_LIMIT, Rig, ambient, cap, ring, shown, turned, wrong_gamma

RIG = ring(3, OFF_AXIS)


def test_the_cap_holds_every_slant_up_to_the_limit_once():
    normals, inside = cap(SLANT_LIMIT)
    cosine = -normals[inside][:, 2]
    assert cosine.min() > np.cos(np.radians(SLANT_LIMIT)) - 1e-12
    # equal areas of the sphere: the cosine is evenly distributed
    assert cosine.mean() == pytest.approx((1.0 + np.cos(np.radians(SLANT_LIMIT))) / 2.0, abs=1e-3)


def test_lights_told_as_they_are_turn_nothing():
    assert np.nanmax(turned(shown(RIG, SLANT_LIMIT), RIG, SLANT_LIMIT, NOISELESS)) < 0.02


def test_lights_that_are_told_turned_together_turn_every_needle_as_far():
    """About the optical axis a normal at slant s moves by 2 asin(sin(s) sin(angle / 2))."""
    angle = 4.0
    told = Rig(Rotation.from_euler("z", angle, degrees=True).apply(RIG.L), RIG.e)
    normals, inside = cap(SLANT_LIMIT)
    slant_sine = np.hypot(*normals[inside][:, :2].T)
    expected = np.degrees(2.0 * np.arcsin(slant_sine * np.sin(np.radians(angle / 2.0))))
    assert turned(shown(RIG, SLANT_LIMIT), told, SLANT_LIMIT, NOISELESS) == pytest.approx(expected, abs=0.02)


def test_light_of_the_room_flattens_needles_toward_the_lights():
    """I + a solves to b + a L^-1 1, and L^-1 1 lies along the axis for lights evenly around it."""
    percent = 5.0
    images, told, noise = ambient(percent)(RIG, np.random.default_rng(0))
    normals, inside = cap(SLANT_LIMIT)
    b = ALBEDO * normals[inside] + 0.01 * percent * ALBEDO * np.linalg.solve(RIG.L, np.ones(3))
    b /= np.linalg.norm(b, axis=1, keepdims=True)
    expected = np.degrees(np.arccos(np.clip((b * normals[inside]).sum(1), -1.0, 1.0)))
    assert turned(images, told, SLANT_LIMIT, noise) == pytest.approx(expected, abs=0.03)


def test_a_gamma_of_one_is_no_error():
    images, told, noise = wrong_gamma(1.0)(RIG, np.random.default_rng(0))
    assert np.nanmax(turned(images, told, SLANT_LIMIT, noise)) < 0.02
