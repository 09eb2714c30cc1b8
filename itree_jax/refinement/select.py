"""Selection: hypotheses of one place compete, because one pixel belongs to one part."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from itree_jax.refinement.hypotheses import agreement, evidence
from itree_jax.refinement.verify import Verdict

Key = tuple[int, int]  # (part, index of the hypothesis)

LEAST_OWN_SHARE = 0.6  # of a pose's agreeing pixels that no better pose has explained already
USUAL_NEEDLES = 0.25  # of a part's visible pixels at least so many have a needle (half of it is lit by all lights)
# Under it a pose is no answer. On simulated bins of the bundled parts nearly all wrong poses ended below and right ones
# began above (experiments/validate_simulated.py).
LEAST_SCORE = 0.3


@dataclass(frozen=True)
class Selection:
    """Accepted hypotheses in the order of acceptance, and why each of the others was not."""

    accepted: Int[np.ndarray, "accepted"]
    score: Float[np.ndarray, "hypotheses"]
    reason: tuple[str, ...]  # per hypothesis, "" if accepted


def score_of(verdict: Verdict, least_pixels: float) -> Float[np.ndarray, "hypotheses"]:
    """Agreement in 0..1, lowered where few pixels support it (half at the sensor's smallest region), and where hardly
    any of them has an agreeing needle: what only lies at the right depth may be anything.
    """
    size = verdict.agreeing / (verdict.agreeing + least_pixels)
    needles = verdict.needles_agreeing / np.maximum(USUAL_NEEDLES * verdict.agreeing, 1.0)
    return np.clip(agreement(verdict), 0.0, 1.0) * size * np.clip(0.5 + 0.5 * needles, 0.0, 1.0)


class Judged(NamedTuple):
    """The verified hypotheses of one part."""

    verdict: Verdict
    origin_uv: Float[np.ndarray, "hypotheses 2"]  # image point of window pixel (0, 0) [px]
    stride: int  # [px]
    least_pixels: float  # window pixels of the sensor's smallest region


def select(
    verdict: Verdict,
    origin_uv: Float[np.ndarray, "hypotheses 2"],
    stride: int,
    image_shape: tuple[int, int],
    least_pixels: float,
    share_space: Callable[[int, int], bool],
) -> Selection:
    """`select_jointly` for the hypotheses of one part. `share_space(h, k)`: whether two poses collide."""
    one = Judged(verdict, origin_uv, stride, least_pixels)
    return select_jointly([one], image_shape, lambda a, b: share_space(a[1], b[1]))[0]


def select_jointly(
    judged: Sequence[Judged], image_shape: tuple[int, int], share_space: Callable[[Key, Key], bool]
) -> list[Selection]:
    """Takes hypotheses of all parts greedily by evidence in image pixels; each must explain pixels of its own and stay
    out of the others' solids.

    A hypothesis is keyed by (part, index); `share_space(a, b)` tells whether two poses collide. Returns one selection
    per part.
    """
    scores = [score_of(j.verdict, j.least_pixels) for j in judged]
    reasons = [["" for _ in score] for score in scores]
    owned = np.zeros(image_shape, bool)
    accepted: list[Key] = []
    for part, h in _by_evidence(judged, scores):
        one = judged[part]
        if one.verdict.agreeing[h] < one.least_pixels:
            reasons[part][h] = "too few agreeing pixels"
            continue
        if scores[part][h] < LEAST_SCORE:
            reasons[part][h] = "the rendered pose contradicts the scene"
            continue
        rows, columns = _pixels(one, h, image_shape)
        if np.mean(~owned[rows, columns]) < LEAST_OWN_SHARE:
            reasons[part][h] = "a better pose explains the same pixels"
            continue
        if any(share_space((part, h), other) for other in accepted):
            reasons[part][h] = "it would share space with a better pose"
            continue
        for i in range(one.stride):  # a window pixel stands for a square of the image
            for j in range(one.stride):
                owned[np.minimum(rows + i, image_shape[0] - 1), np.minimum(columns + j, image_shape[1] - 1)] = True
        accepted.append((part, h))
    return [
        Selection(np.array([h for p, h in accepted if p == part], int), scores[part], tuple(reasons[part]))
        for part in range(len(judged))
    ]


def _by_evidence(judged: Sequence[Judged], scores: Sequence[Float[np.ndarray, "hypotheses"]]) -> list[Key]:
    """All hypotheses, those of most evidence (in image pixels, times score) first; ties by part and index."""
    weighed = [
        (-float(weight), part, h)
        for part, (one, score) in enumerate(zip(judged, scores, strict=True))
        for h, weight in enumerate(evidence(one.verdict) * score * one.stride**2)
    ]
    return [(part, h) for _, part, h in sorted(weighed)]


def _pixels(
    one: Judged, h: int, image_shape: tuple[int, int]
) -> tuple[Int[np.ndarray, "pixels"], Int[np.ndarray, "pixels"]]:
    """Rows and columns of the image pixels that a hypothesis explains."""
    i, j = np.nonzero(one.verdict.explained[h])
    u0, v0 = one.origin_uv[h].astype(int)
    rows = np.clip(v0 + one.stride * i, 0, image_shape[0] - 1)
    return rows, np.clip(u0 + one.stride * j, 0, image_shape[1] - 1)
