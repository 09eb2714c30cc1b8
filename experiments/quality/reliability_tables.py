"""Tables of how far a score can be believed, in Markdown."""

from collections.abc import Sequence

from itree_jax.evaluation.judged import ScoredAnswers
from itree_jax.evaluation.reliability import (
    ScoreBin,
    ScoreThreshold,
    calibration_error,
    equal_bins,
    equal_count_bins,
    score_thresholds,
)
from itree_jax.evaluation.report import Rate
from quality.comparison import markdown_table

ENOUGH = 30  # answers of a bin from which on its gap is held against the score
WITHIN = 0.05  # a gap that is not


def reliability_report(answers: ScoredAnswers) -> str:
    """Bins of equal width and of equal counts with their calibration errors, and thresholds of the score."""
    width = equal_bins(answers.score, answers.right)
    count = equal_count_bins(answers.score, answers.right)
    return (
        f"Ten equal bins of score: calibration error {error_text(width)}\n\n{bin_table(width)}\n"
        f"Bins of equally many answers: calibration error {error_text(count)}\n\n{bin_table(count)}\n"
        f"Answers of a score and above\n\n{threshold_table(score_thresholds(answers))}"
    )


def bin_table(bins: Sequence[ScoreBin]) -> str:
    """Bins that have answers; a gap of more than `WITHIN` over `ENOUGH` answers is marked."""
    rows = [
        [f"{b.low:.2f}-{b.high:.2f}", str(b.right.total), f"{b.mean_score:.3f}", share_text(b.right), gap_text(b)]
        for b in bins if b.right.total
    ]  # fmt: skip
    return markdown_table(["score", "answers", "mean score", "right (95 %)", "gap [points]"], rows)


def threshold_table(rows: Sequence[ScoreThreshold]) -> str:
    cells = [[f"{r.score:.2f}", str(r.precision.total), share_text(r.precision), share_text(r.recall)] for r in rows]
    return markdown_table(["score from", "answers", "precision (95 %)", "recall (95 %)"], cells)


def share_text(rate: Rate) -> str:
    """Such as "95 % (90-98)"; a dash where nothing was counted."""
    if rate.fraction is None:
        return "-"
    low, high = rate.interval
    return f"{100 * rate.fraction:.0f} % ({100 * low:.0f}-{100 * high:.0f})"


def gap_text(b: ScoreBin) -> str:
    assert b.gap is not None
    mark = " !" if b.right.total >= ENOUGH and abs(b.gap) > WITHIN else ""
    return f"{100 * b.gap:+.1f}{mark}"


def error_text(bins: Sequence[ScoreBin]) -> str:
    error = calibration_error(bins)
    return "-" if error is None else f"{error:.3f}"
