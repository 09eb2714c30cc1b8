"""Selection: hypotheses of one place compete, because one pixel belongs to one part."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from itree_jax.refine.hypotheses import agreement, evidence
from itree_jax.refine.verify import Verdict

LEAST_OWN_SHARE = 0.6  # of a pose's agreeing pixels that no better pose has explained already
USUAL_NEEDLES = 0.25  # of a part's visible pixels at least so many have a needle (half of it is lit by all lights)
LEAST_AGREEMENT = 0.25  # under it a pose is no answer


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


def select(
    verdict: Verdict,
    origin_uv: Float[np.ndarray, "hypotheses 2"],
    stride: int,
    image_shape: tuple[int, int],
    least_pixels: float,
    share_space: Callable[[int, int], bool],
) -> Selection:
    """Takes hypotheses greedily by evidence; each must explain pixels of its own and stay out of the others' solids.

    `least_pixels`: window pixels of the sensor's smallest region. `share_space(h, k)`: whether two poses collide.
    """
    count = len(verdict.agreeing)
    score, fit = score_of(verdict, least_pixels), agreement(verdict)
    owner = np.full((image_shape[0] // stride + 2, image_shape[1] // stride + 2), -1, np.int32)
    reason = ["" for _ in range(count)]
    accepted: list[int] = []
    for h in np.argsort(-evidence(verdict) * np.clip(score, 0.0, 1.0), kind="stable"):
        if verdict.agreeing[h] < least_pixels:
            reason[h] = "too few agreeing pixels"
            continue
        if fit[h] < LEAST_AGREEMENT:
            reason[h] = "the rendered pose contradicts the scene"
            continue
        i, j = np.nonzero(verdict.explained[h])
        row = np.clip(np.round(origin_uv[h, 1] / stride + i).astype(int), 0, owner.shape[0] - 1)
        column = np.clip(np.round(origin_uv[h, 0] / stride + j).astype(int), 0, owner.shape[1] - 1)
        free = owner[row, column] < 0
        if free.mean() < LEAST_OWN_SHARE:
            reason[h] = "a better pose explains the same pixels"
            continue
        if any(share_space(int(h), k) for k in accepted):
            reason[h] = "it would share space with a better pose"
            continue
        owner[row[free], column[free]] = h
        accepted.append(int(h))
    return Selection(np.array(accepted, int), score, tuple(reason))
