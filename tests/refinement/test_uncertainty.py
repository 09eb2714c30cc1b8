"""Covariance and unobservable directions: closed forms, and the names of what a few scenes leave open."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from itree_jax.refinement.uncertainty import (
    FREE,
    RimMotions,
    rim_motions,
    rim_uncertainty,
    turn_about,
    twist_covariance,
    twist_deviation,
    without_free_turns,
)
from itree_jax.refinement.unobservable import unobservable

DIAMETER = 60.0
BOX = np.array([[-10.0, -20.0, 5.0], [30.0, 20.0, 25.0]])  # corners [mm]; the middle is (10, 0, 15)
R = Rotation.from_rotvec([0.4, -0.9, 0.3]).as_matrix()
T = np.array([40.0, -30.0, 800.0])
RIM = rim_motions(BOX, DIAMETER, R)
AXIS = (np.array([0.0, 0.0, 1.0]), np.array([1.0, 2.0, 0.0]))


def random_information(seed: int = 0) -> np.ndarray:
    A = np.random.default_rng(seed).normal(size=(20, 6)) * np.repeat([300.0, 10.0], 3)
    return A.T @ A


def blind_to(*twists: np.ndarray) -> np.ndarray:
    """Information that tells all motions of the rim alike, but for some."""
    motions = np.stack([RIM.from_twist @ twist for twist in twists], axis=1)
    Q = np.linalg.qr(motions)[0]
    return RIM.from_twist.T @ (100.0 * (np.eye(6) - Q @ Q.T)) @ RIM.from_twist


def test_a_motion_of_the_rim_is_a_turn_about_the_middle_or_a_shift():
    middle = R @ BOX.mean(axis=0)
    for k in range(3):
        np.testing.assert_allclose(RIM.to_twist[:, k], turn_about(np.eye(3)[k], middle) * 2.0 / DIAMETER, atol=1e-12)
        np.testing.assert_array_equal(RIM.to_twist[:, 3 + k], np.eye(6)[3 + k])


def test_the_covariance_is_that_of_the_least_squares_estimate():
    information, spread = random_information(), random_information(1)
    uncertain = rim_uncertainty(information, spread, RIM)
    assert not uncertain.lost.any()
    covariance = twist_covariance(uncertain, RIM)
    inverse = np.linalg.inv(information)
    np.testing.assert_allclose(covariance, inverse @ spread @ inverse, rtol=1e-6)
    np.testing.assert_allclose(twist_deviation(uncertain, RIM), np.sqrt(np.diag(covariance)), rtol=1e-9)


def test_what_nothing_measures_has_a_hundred_diameters_and_the_rest_stays_exact():
    twist = turn_about(R @ AXIS[0], R @ AXIS[1])
    information = without_free_turns(random_information(), [AXIS], R)
    uncertain = rim_uncertainty(information, information, RIM)
    covariance = twist_covariance(uncertain, RIM)
    assert np.isfinite(covariance).all()
    largest, direction = (a[..., -1] for a in np.linalg.eigh(uncertain.covariance))
    assert np.sqrt(largest) == pytest.approx(FREE * DIAMETER, rel=1e-6)
    along = RIM.from_twist @ twist
    assert abs(direction @ along) / np.linalg.norm(along) == pytest.approx(1.0, abs=1e-6)
    # in the space that is left, what is known there
    np.testing.assert_allclose(information @ covariance @ information, information, rtol=1e-3, atol=1e-3)


def test_turns_about_an_axis_of_revolution_are_infinite():
    """The part lies along the camera's x: only turns about that line are free. A turn about it moves the part's origin
    too, so neither omega_x nor the shift alone is at fault."""
    lying = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    measured = np.diag([4.0, 9.0, 16.0, 1.0, 1.0, 1.0])
    information = without_free_turns(measured, [AXIS], lying)
    twist = turn_about(lying @ AXIS[0], lying @ AXIS[1])
    np.testing.assert_allclose(information @ twist, 0.0, atol=1e-12)
    assert np.linalg.matrix_rank(information) == 5
    rim = RimMotions(40.0, np.array([5.0, 0.0, 0.0]))
    std = twist_deviation(rim_uncertainty(information, information, rim), rim)
    np.testing.assert_array_equal(np.isinf(std), np.abs(twist) > 0)
    np.testing.assert_allclose(std[1:3], [1 / 3, 1 / 4])
    np.testing.assert_array_equal(without_free_turns(measured, [], lying), measured)


MIDDLE = R @ BOX.mean(axis=0)


@pytest.mark.parametrize(
    ("twists", "words"),
    [
        ([turn_about(R @ AXIS[0], R @ AXIS[1])], ["turn about its axis of revolution"]),
        ([np.concatenate([np.zeros(3), T])], ["distance from the camera"]),
        ([np.concatenate([np.zeros(3), R[:, 0]])], ["slide along its own x axis"]),
        (
            [np.concatenate([np.zeros(3), R[:, 0]]), np.concatenate([np.zeros(3), R[:, 1]]),
             turn_about(R[:, 2], MIDDLE)],
            ["slide along its own x axis", "slide along its own y axis", "turn about its own z axis"],
        ),
        ([np.concatenate([np.zeros(3), R @ [0.6, 0.8, 0.0]])], ["slide along (0.60, 0.80, 0.00) of its own axes"]),
        ([turn_about(R @ [0.6, -0.8, 0.0], MIDDLE)], ["turn about (-0.60, 0.80, 0.00) of its own axes"]),
        (
            [turn_about(R[:, 0], MIDDLE + R @ [0.0, 0.0, 20.0])],
            ["turn about (1.00, 0.00, 0.00) of its own axes, 20.0 mm beside its middle"],
        ),
        ([], []),
    ],
)  # fmt: skip
def test_directions_that_nothing_measures_have_names(twists, words):
    information = blind_to(*twists) if twists else random_information()
    axes = [AXIS] if "turn about its axis of revolution" in words else []
    found = unobservable(rim_uncertainty(information, information, RIM), RIM, axes, R, T)
    assert [u.words for u in found] == words
    for u in found:
        assert u.deviation == np.inf
        rim = RIM.from_twist @ u.twist
        assert rim @ RIM.to_twist.T @ information @ RIM.to_twist @ rim < 1e-6 * (rim @ rim)
        unit = u.twist[:3] if np.linalg.norm(u.twist[:3]) > 1e-6 else u.twist[3:]
        assert np.linalg.norm(unit) == pytest.approx(1.0)


@pytest.mark.parametrize(("deviation", "count"), [(2.9, 0), (3.1, 1)])
def test_a_deviation_of_five_percent_of_the_diameter_is_none(deviation, count):
    along = RIM.from_twist @ np.concatenate([np.zeros(3), R[:, 1]])
    motions = np.eye(6) * 100.0 + np.outer(along, along) * (deviation**-2 - 100.0)
    information = RIM.from_twist.T @ motions @ RIM.from_twist
    found = unobservable(rim_uncertainty(information, 0.04 * information, RIM), RIM, [], R, T)
    assert [u.deviation for u in found] == pytest.approx([deviation] * count)
