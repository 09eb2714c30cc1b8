"""How far a score can be believed: of the answers with score s, a fraction s should be right.

Bins of scores and the expected calibration error are those of Naeini, Cooper and Hauskrecht (2015); the share of a bin
that is right has Wilson's interval.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from itree_jax.evaluation.judged import ScoredAnswers
from itree_jax.evaluation.report import Rate

BINS = 10
THRESHOLDS = tuple(float(t) for t in np.round(np.arange(0.1, 0.96, 0.05), 2))  # of scores


@dataclass(frozen=True)
class ScoreBin:
    """The answers whose scores lie between two values."""

    low: float
    high: float
    mean_score: float | None  # None without an answer
    right: Rate

    @property
    def gap(self) -> float | None:
        """How far the share that is right lies above the mean score."""
        if self.mean_score is None or self.right.fraction is None:
            return None
        return self.right.fraction - self.mean_score


@dataclass(frozen=True)
class ScoreThreshold:
    """What is left of the answers when those of a lower score are not given."""

    score: float
    precision: Rate  # of the answers left
    recall: Rate  # of the visible instances


def equal_bins(
    score: Float[np.ndarray, "answers"], right: Bool[np.ndarray, "answers"], bins: int = BINS
) -> list[ScoreBin]:
    """Bins of equal width over 0..1; the last one holds its upper end."""
    edges = [k / bins for k in range(bins + 1)]
    which = np.digitize(score, edges[1:-1])
    return [_bin(edges[k], edges[k + 1], score[which == k], right[which == k]) for k in range(bins)]


def equal_count_bins(
    score: Float[np.ndarray, "answers"], right: Bool[np.ndarray, "answers"], bins: int = BINS
) -> list[ScoreBin]:
    """Bins of equally many answers, by rising score; fewer bins where there are fewer answers."""
    order = np.argsort(score, kind="stable")
    parts = np.array_split(order, min(bins, len(order))) if len(order) else []
    return [_bin(float(score[p[0]]), float(score[p[-1]]), score[p], right[p]) for p in parts]


def calibration_error(bins: Sequence[ScoreBin]) -> float | None:
    """Expected calibration error: mean |share right - mean score| over the answers; None without any."""
    gaps = [(b.right.total, abs(b.gap)) for b in bins if b.gap is not None]
    return float(sum(n * gap for n, gap in gaps) / sum(n for n, _ in gaps)) if gaps else None


def score_thresholds(answers: ScoredAnswers, thresholds: Sequence[float] = THRESHOLDS) -> list[ScoreThreshold]:
    """Precision and recall of the answers at or above each score.

    Answers find their instances by falling score, so that leaving out the lower ones changes no other's instance.
    """
    rows = []
    for threshold in thresholds:
        left = answers.score >= threshold
        precision = Rate(int(answers.right[left].sum()), int(left.sum()))
        rows.append(ScoreThreshold(threshold, precision, Rate(int(answers.found_visible[left].sum()), answers.visible)))
    return rows


def _bin(low: float, high: float, score: Float[np.ndarray, "n"], right: Bool[np.ndarray, "n"]) -> ScoreBin:
    mean = float(score.mean()) if len(score) else None
    return ScoreBin(low, high, mean, Rate(int(right.sum()), len(right)))
