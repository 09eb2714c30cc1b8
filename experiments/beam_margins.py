"""How far behind its region's best a pose that turns out right may lie, round by round: what may be left behind.

    python experiments/beam_margins.py [--bins DIR] [--trees DIR] [--every N]

Every round of refinement keeps so many poses of a region. Of each round of the validation bins' readings, by their
depth maps and with no pose left behind: the five lowest shares of its region's best score that the best pose had which
ends up right (MSSD under 5 % of the diameter); how many of the kept poses lie under a margin; and the regions in which
no pose scores more than nothing, with how many of them end up with a right pose.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

import numpy as np
from hypothesis_ranks import errors
from quality.comparison import markdown_table
from true_scenes import TrueScene, bins_parser, true_scenes

from itree_jax import challenge, narrowing, settling
from itree_jax.backtracking import DEEP, FIRST
from itree_jax.cli.scene_answer import load_with_trees
from itree_jax.prepared import prepare_forest
from itree_jax.recognition import read_scene
from itree_jax.refinement.hypotheses import RegionHypotheses

RIGHT = 0.05  # of the diameter
MARGINS = (0.1, 0.2, 0.4)
LEAST = 5  # shares that are told
READINGS = {FIRST.keep: "first reading", DEEP.keep: "backtracking"}


class Kept(NamedTuple):
    """One round's selection."""

    of: str  # which reading's which round
    score: np.ndarray  # of every pose before
    region: np.ndarray
    kept: np.ndarray  # indices


class Share(NamedTuple):
    """Of one region in one round."""

    of: str
    agrees: bool  # some pose scores more than nothing
    ended_right: bool
    right: float  # best score that ended right over the region's best
    kept: np.ndarray  # kept scores over the region's best


def main(bins: Path, trees: Path | None, every: int) -> None:
    shares = [s for one in true_scenes(bins, Path("out/beam_margins"), trees, every) for s in shares_of_scene(one)]
    rows = [row_of(of, [s for s in shares if s.of == of]) for of in dict.fromkeys(s.of for s in shares)]
    under = (f"kept under {margin:g}" for margin in MARGINS)
    header = ["round", "regions", "ended right", "least", "poses kept", *under, "none agrees", "ended right"]
    print(markdown_table(header, rows))


def row_of(of: str, shares: list[Share]) -> list[str]:
    """Of one round."""
    agree = [s for s in shares if s.agrees]
    right = sorted(s.right for s in agree if s.ended_right)
    kept = np.concatenate([s.kept for s in agree]) if agree else np.zeros(0)
    under = (f"{(kept < margin).mean():.0%}" if len(kept) else "-" for margin in MARGINS)
    none = [s for s in shares if not s.agrees]
    return [
        of, str(len(agree)), str(len(right)), " ".join(f"{r:.2f}" for r in right[:LEAST]), str(len(kept)), *under,
        str(len(none)), str(sum(s.ended_right for s in none)),
    ]  # fmt: skip


def shares_of_scene(one: TrueScene) -> Iterator[Share]:
    """One for each region and round of the scene, the rounds of a reading in their order."""
    scene, _ = load_with_trees(one.folder, [one.prepared])
    with noted() as readings:
        read_scene(prepare_forest([one.prepared]), scene.images, scene.sensor, scene.depth, scene.R_w2c)
    for rounds, last in readings:
        if not len(last.region):
            continue
        ended = errors(last, one.prepared, one.truth, one.model).min(axis=1) < RIGHT
        ends = []
        for step in reversed(rounds):
            before = np.zeros(len(step.score), bool)
            before[step.kept] = ended
            ended = before
            ends.append(ended)
        for step, ended in zip(rounds, reversed(ends), strict=True):
            for region in np.unique(step.region):
                yield share_of(step, step.region == region, ended)


def share_of(step: Kept, mine: np.ndarray, ended: np.ndarray) -> Share:
    """Of the poses of one region."""
    best, right = step.score[mine].max(), mine & ended
    if best <= 0.0:
        return Share(step.of, False, bool(right.any()), np.nan, np.zeros(0))
    there = step.score[right].max() / best if right.any() else np.nan
    return Share(step.of, True, bool(right.any()), there, step.score[step.kept[mine[step.kept]]] / best)


@contextmanager
def noted() -> Iterator[list[tuple[list[Kept], RegionHypotheses]]]:
    """Notes what every reading's rounds keep, none left behind, and the poses that they end with."""
    readings: list[tuple[list[Kept], RegionHypotheses]] = []
    narrowed, best, as_they_are = narrowing._narrowed, narrowing.best_of_each_region, challenge.best_as_they_are
    current: list[Kept] = []
    names: list[str] = []

    def all_rounds(hypotheses, prepared, sight, rounds, plan, keep):
        current.clear()
        reading = READINGS.get(tuple(keep or ()), "turned")
        names[:] = [f"{reading}, {step.stage.size} px" for step in rounds]
        result = narrowed(hypotheses, prepared, sight, rounds, plan, keep)
        readings.append((list(current), result[0]))
        return result

    def all_looks(accepted, turned, prepared, sight, plan):
        current.clear()
        names[:] = [f"turned, as they are, {step.stage.size} px" for step in (plan.turned[0], plan.turned[-2])]
        found = as_they_are(accepted, turned, prepared, sight, plan)
        readings.append((list(current), found))
        return found

    def keep_best(score, hypotheses, most, *others):
        kept = best(score, hypotheses, most, *others)
        current.append(Kept(names[len(current)], score, hypotheses.region, kept))
        return kept

    def all_abreast(score, region, behind):
        return np.ones(len(score), bool)

    with (
        patch.object(narrowing, "_narrowed", all_rounds), patch.object(narrowing, "best_of_each_region", keep_best),
        patch.object(challenge, "best_as_they_are", all_looks),
        patch.object(challenge, "best_of_each_region", keep_best),
        patch.object(narrowing, "abreast", all_abreast), patch.object(challenge, "abreast", all_abreast),
        patch.object(settling, "on_all_cores", lambda step, answers: [step(a) for a in answers]),
    ):  # fmt: skip
        yield readings


if __name__ == "__main__":
    given = bins_parser(__doc__, every=4).parse_args()
    main(given.bins, given.trees, given.every)
