"""From the measures of a pose to the probability that it is right."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

HOPELESS = 0.02  # less probable poses don't compete


class Measures(NamedTuple):
    """What a pose's score goes by; free of the part's size and of the image's scale."""

    size: Float[np.ndarray, "*h"]  # log of the agreeing pixels over those of the sensor's smallest region
    fit: Float[np.ndarray, "*h"]  # [nats] of an agreeing pixel
    against: Float[np.ndarray, "*h"]  # nats of the contradicting pixels over those of the agreeing ones
    hidden: Float[np.ndarray, "*h"]  # share of the pose behind something nearer that is no recognised part
    lit: Float[np.ndarray, "*h"]  # share of the agreeing pixels that a light shows
    needles: Float[np.ndarray, "*h"]  # share of the agreeing pixels with an agreeing needle
    contour: Float[np.ndarray, "*h"]  # share of the visible contour at which the surface ends
    beside: Float[np.ndarray, "*h"]  # nats of image edges and other cameras over those of the agreeing pixels
    own: Float[np.ndarray, "*h"]  # share of its support that no better pose explains
    margin: Float[np.ndarray, "*h"]  # [nats] by which it beats the best other pose of its place; infinite without one


class Scoring(NamedTuple):
    """A logistic model of the measures."""

    weights: Float[np.ndarray, "terms"]
    bias: float
    least: float  # a less probable pose is no answer


def terms(measures: Measures) -> Float[np.ndarray, "*h terms"]:
    """What the logistic model adds up."""
    m = measures
    return np.stack(
        [
            m.size, m.fit, np.log(1e-3 + m.against), m.hidden, m.lit, m.needles, m.contour,
            np.clip(m.beside, -1.0, 1.0), m.own, np.tanh(np.clip(m.margin, -1e3, 1e3) / 100.0),
        ],
        axis=-1,
    )  # fmt: skip


def probability(measures: Measures, scoring: Scoring) -> Float[np.ndarray, "*h"]:
    """That of being right."""
    return 1.0 / (1.0 + np.exp(-(terms(measures) @ scoring.weights + scoring.bias)))


START = Scoring(np.array([0.3, 0.0, -1.0, -1.0, 1.0, 1.0, 3.0, 0.0, 1.0, 1.0]), -7.0, 0.02)
SCORINGS = {"depth": START, "stereo": START, "none": START}
