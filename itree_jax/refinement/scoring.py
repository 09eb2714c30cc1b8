"""From the measures of a pose to the probability that it is right."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import expit

HOPELESS = 0.02  # less probable poses don't compete
LEAST_AGAINST = 1e-3  # contradiction below it is the raster's
LEAST_NATS = 1e-3  # of an agreeing pixel
MOST_BESIDE = 4.0  # [nats] a point of its contour: what a pose gains beyond is the number of its creases


class Measures(NamedTuple):
    """What a pose's score goes by; free of the part's size and of the image's scale."""

    size: Float[np.ndarray, "*h"]  # log of the agreeing pixels over those of the sensor's smallest region
    fit: Float[np.ndarray, "*h"]  # [nats] of an agreeing pixel
    against: Float[np.ndarray, "*h"]  # nats of the contradicting pixels over those of the agreeing ones
    hidden: Float[np.ndarray, "*h"]  # share of the pose behind something nearer that is no recognised part
    lit: Float[np.ndarray, "*h"]  # share of the agreeing pixels that a light shows
    needles: Float[np.ndarray, "*h"]  # share of the agreeing pixels with an agreeing needle
    contour: Float[np.ndarray, "*h"]  # share of the visible contour at which the surface ends
    beside: Float[np.ndarray, "*h"]  # nats of image edges and other cameras by points of a contour of its size
    own: Float[np.ndarray, "*h"]  # share of its support that no better pose explains
    margin: Float[np.ndarray, "*h"]  # [nats] by which it beats the best other pose of its place; infinite without one


class Scoring(NamedTuple):
    """A logistic model of the terms: that the place of a pose is a part's, in this pose or in its best rival's."""

    weights: tuple[float, ...]  # one per term
    bias: float
    least: float  # a pose whose place is less probable is no answer
    # [nats] by which likelihood ratios of two refinements of one pose scatter, as refinement stops a bit off the best
    # pose: so much is no evidence. With a depth map 95 % lie within 18 (experiments/refinement_nats.py); by images
    # alone 10 and 20 fit the answers alike (experiments/calibrate_scores.py).
    refinement: float
    least_pose: float = 0.0  # a pose that is less probable itself is not answered: a rival is nearly as good


# What the model adds up, and the sign that each weight must have: doubt never makes a pose more probable.
SIGNS = {
    "size": 1, "fit": 1, "against": -1, "hidden": -1, "lit": 1, "needles": 1, "contour": 1, "beside": 1, "own": 1,
    "nats": 1,
}  # fmt: skip


def contour_of(pixels: Float[np.ndarray, "*h"]) -> Float[np.ndarray, "*h"]:
    """Points of the contour of a square region of so many pixels."""
    return 4.0 * np.sqrt(pixels)


def terms(measures: Measures) -> Float[np.ndarray, "*h terms"]:
    """The measures but the margin, each on a scale on which a logistic model may add them up, and all that pixels come
    to: the logarithm of what the pose explains [nats], in units of the sensor's smallest region.
    """
    beside = np.clip(measures.beside, -MOST_BESIDE, MOST_BESIDE)
    of_pixel = np.maximum(measures.fit, LEAST_NATS) * (1.0 - measures.against)
    nats = measures.size + np.log(np.maximum(of_pixel, LEAST_NATS))
    values = measures._replace(against=np.log(LEAST_AGAINST + measures.against), beside=beside)
    return np.stack([*values[:-1], nats], axis=-1)


def share(margin: Float[np.ndarray, "*h"], refinement: float) -> Float[np.ndarray, "*h"]:
    """Of belief that a pose keeps beside its best rival: a half where the scene doesn't tell them apart."""
    return expit(margin / refinement)


def of_place(measures: Measures, scoring: Scoring) -> Float[np.ndarray, "*h"]:
    """Probability that the pose or its best rival is right."""
    return expit(terms(measures) @ np.array(scoring.weights) + scoring.bias)


def probability(measures: Measures, scoring: Scoring) -> Float[np.ndarray, "*h"]:
    """That of being right: the place's times the pose's share of it."""
    return of_place(measures, scoring) * share(measures.margin, scoring.refinement)


# Fitted to simulated bins by experiments/calibrate_scores.py, by where depth comes from: of the bundled parts; those of
# images alone of fifteen more (experiments/forest_parts.py), where answers of a score from 0.8 on were 99 % right with
# two cameras and 93 % with one, by weights that were fitted without their part. With two cameras 98 % from 0.7 on were
# right, and 93 % from 0.5 on: hence `least_pose`.
SCORINGS = {
    "depth": Scoring((0.901, 0.085, -1.455, -7.802, 2.538, 0.649, 8.506, 0.0, 0.012, 0.0), -17.652, 0.75, 20.0),
    "stereo": Scoring((1.687, 0.0, -0.353, -6.489, 0.418, 0.0, 1.241, 1.588, 0.546, 0.0), -7.347, 0.6, 20.0, 0.7),
    "none": Scoring((1.901, 1.962, -0.015, 0.0, 0.0, 0.0, 0.0, 2.726, 0.0, 0.208), -10.786, 0.6, 20.0),
}
