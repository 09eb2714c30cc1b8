"""Colours stay apart for colour-blind eyes, simulated as Machado, Oliveira and Fernandes (2009) do, severity 1."""

from itertools import combinations, pairwise

import cv2
import numpy as np
import pytest

from itree_jax.report.palette import AGREE, CONTRADICT, CYCLE, HIDDEN, ink_on
from itree_jax.report.residual_maps import diverging
from itree_jax.report.scene_pictures import colour_bar

EYES = {  # of linear RGB
    "usual": np.eye(3),
    "protanopia": np.array([
        [0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998],
    ]),
    "deuteranopia": np.array([
        [0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881],
    ]),
}  # fmt: skip
APART = 15.0  # Delta E (CIE 1976): six times what is just seen in patches beside each other; the least is 17
FAR_APART = 30.0  # of colours that mean opposite things


def seen(colours, eye: np.ndarray) -> np.ndarray:
    """CIELAB of sRGB colours (0..255) for an eye."""
    srgb = np.asarray(colours, float).reshape(-1, 3) / 255.0
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    there = np.clip(linear @ eye.T, 0.0, 1.0)
    shown = np.where(there <= 0.0031308, 12.92 * there, 1.055 * there ** (1 / 2.4) - 0.055)
    return cv2.cvtColor(shown[None].astype(np.float32), cv2.COLOR_RGB2Lab)[0]


@pytest.fixture(params=EYES)
def eye(request) -> np.ndarray:
    return EYES[request.param]


def test_grey_stays_grey(eye):
    lab = seen([[g] * 3 for g in (0, 90, 180, 255)], eye)
    np.testing.assert_allclose(lab[:, 1:], 0.0, atol=0.1)


def test_no_two_colours_of_the_cycle_are_alike(eye):
    lab = seen(CYCLE, eye)
    for a, b in combinations(range(len(CYCLE)), 2):
        assert np.linalg.norm(lab[a] - lab[b]) > APART, (a, b)


def test_agreeing_contradicting_and_hidden_are_far_apart(eye):
    lab = seen([AGREE, CONTRADICT, HIDDEN], eye)
    for a, b in combinations(range(3), 2):
        assert np.linalg.norm(lab[a] - lab[b]) > FAR_APART


def test_the_lightness_of_the_scale_orders_it(eye):
    lightness = seen(colour_bar(17), eye)[:, 0]
    assert all(a > b for a, b in pairwise(lightness))


def test_both_ends_of_the_diverging_scale_are_apart_and_darker_than_its_middle(eye):
    lab = seen(diverging(np.array([[-1.0, 0.0, 1.0]]))[0], eye)
    assert np.linalg.norm(lab[0] - lab[2]) > FAR_APART
    assert lab[1, 0] > lab[[0, 2], 0].max() + 20


def test_numbers_on_a_colour_can_be_read():
    """Lightness apart by 40: a contrast of about 3 and more."""
    usual = EYES["usual"]
    for colour in CYCLE:
        (a,), (b,) = seen(colour, usual), seen(ink_on(colour), usual)
        assert abs(a[0] - b[0]) > 40
