"""The curves as one figure: top pick, recall and precision along each, with 95 % intervals."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from degrading.counting import Step
from itree_jax.evaluation.report import Rate

COLUMNS = 3
SHOWN = (
    ("precision", "precision of answers not called ambiguous", "#0072b2", "o"),
    ("recall", "recall", "#d55e00", "s"),
    ("top_pick", "top pick right", "#009e73", "^"),
)  # colours of Okabe and Ito; marks tell them apart without colour
BESIDE = 0.08  # of a step: intervals stand beside each other


def draw_curves(steps: Sequence[Step], path: Path) -> None:
    """One panel per curve; each begins with the nominal scene."""
    nominal, curves = steps[0], list(dict.fromkeys(s.condition.curve for s in steps[1:]))
    rows = -(-len(curves) // COLUMNS)
    figure, axes = plt.subplots(rows, COLUMNS, figsize=(4.2 * COLUMNS, 3.1 * rows + 0.5), squeeze=False, sharey=True)
    for axis, curve in zip(axes.ravel(), curves, strict=False):
        panel = [nominal, *(s for s in steps if s.condition.curve == curve)]
        for k, (name, label, colour, mark) in enumerate(SHOWN):
            _line(axis, [getattr(s, name) for s in panel], BESIDE * (k - 1), label, colour, mark)
        axis.set_title(curve)
        axis.set_xticks(range(len(panel)), ["nominal", *(s.condition.step.replace(", ", ",\n") for s in panel[1:])])
        axis.tick_params(axis="x", labelsize=8)
        axis.set_ylim(0.0, 104.0)
        axis.grid(axis="y", color="#dddddd")
        axis.spines[["top", "right"]].set_visible(False)
    for axis in axes.ravel()[len(curves) :]:
        axis.set_visible(False)
    for row in axes:
        row[0].set_ylabel("%")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="lower center", ncols=len(SHOWN), frameon=False)
    figure.tight_layout(rect=(0.0, 0.06, 1.0, 1.0))
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=90)
    plt.close(figure)


def _line(axis: plt.Axes, rates: Sequence[Rate], aside: float, label: str, colour: str, mark: str) -> None:
    share = np.array([np.nan if r.fraction is None else 100.0 * r.fraction for r in rates])
    ends = 100.0 * np.array([r.interval for r in rates])
    known = np.isfinite(share)
    at = np.arange(len(rates)) + aside
    error = np.abs(np.stack([share - ends[:, 0], ends[:, 1] - share]))[:, known]
    axis.errorbar(at[known], share[known], error, label=label, color=colour, marker=mark, capsize=2, lw=1.2)
