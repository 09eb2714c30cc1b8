"""Selection: hypotheses of one place compete, because one pixel belongs to one part."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from itree_jax.refine.hypotheses import agreement
from itree_jax.refine.verify import Verdict

LEAST_OWN_SHARE = 0.6  # of a pose's agreeing pixels that no better pose has explained already
LEAST_AGREEMENT = 0.25  # under it a pose is no answer


@dataclass(frozen=True)
class Selection:
    """Accepted hypotheses in the order of acceptance, and why each of the others was not."""

    accepted: Int[np.ndarray, "accepted"]
    score: Float[np.ndarray, "hypotheses"]
    reason: tuple[str, ...]  # per hypothesis, "" if accepted


def score_of(verdict: Verdict, least_pixels: float) -> Float[np.ndarray, "hypotheses"]:
    """Agreement in 0..1, lowered where few pixels support it (half at the sensor's smallest region)."""
    size = verdict.agreeing / (verdict.agreeing + least_pixels)
    return np.clip(agreement(verdict), 0.0, 1.0) * size


def select(
    verdict: Verdict,
    origin_uv: Float[np.ndarray, "hypotheses 2"],
    stride: int,
    image_shape: tuple[int, int],
    least_pixels: float,
) -> Selection:
    """Takes hypotheses greedily by evidence; each must explain pixels of its own.

    `least_pixels`: window pixels of the sensor's smallest region.
    """
    count = len(verdict.agreeing)
    score = score_of(verdict, least_pixels)
    owner = np.full((image_shape[0] // stride + 2, image_shape[1] // stride + 2), -1, np.int32)
    evidence = score * np.sqrt(np.maximum(verdict.agreeing, 1.0))
    reason = ["" for _ in range(count)]
    accepted: list[int] = []
    for h in np.argsort(-evidence, kind="stable"):
        if verdict.agreeing[h] < least_pixels:
            reason[h] = "too few agreeing pixels"
            continue
        if agreement(Verdict(*(v[h] for v in verdict))) < LEAST_AGREEMENT:
            reason[h] = "the rendered pose contradicts the scene"
            continue
        i, j = np.nonzero(verdict.explained[h])
        row = np.clip(np.round(origin_uv[h, 1] / stride + i).astype(int), 0, owner.shape[0] - 1)
        column = np.clip(np.round(origin_uv[h, 0] / stride + j).astype(int), 0, owner.shape[1] - 1)
        free = owner[row, column] < 0
        if free.mean() < LEAST_OWN_SHARE:
            reason[h] = "a better pose explains the same pixels"
            continue
        owner[row[free], column[free]] = h
        accepted.append(int(h))
    return Selection(np.array(accepted, int), score, tuple(reason))
