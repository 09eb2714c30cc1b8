"""How far behind its region's best a pose that turns out right may lie, round by round: what a beam may leave out.

    python experiments/beam_margins.py [--bins DIR] [--trees DIR] [--every N]

Every round of refinement keeps so many poses of a region. Of each round of the validation bins' readings, by their
depth maps: the score of the best pose that ends up right (MSSD under 5 % of the diameter) over the best score of its
region, in quantiles over the regions that have a right pose in the end; and the share of the kept poses that lie under
a margin.
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
from itree_jax.cli.scene_answer import load_with_trees
from itree_jax.prepared import prepare_forest
from itree_jax.recognition import read_scene
from itree_jax.refinement.hypotheses import RegionHypotheses

RIGHT = 0.05  # of the diameter
QUANTILES = (0.002, 0.005, 0.01, 0.02, 0.05)
MARGINS = (0.1, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6)


class Kept(NamedTuple):
    """One round's selection."""

    of: str  # which reading's which round
    score: np.ndarray  # of every pose before
    region: np.ndarray
    kept: np.ndarray  # indices


class Ratio(NamedTuple):
    """Of one region in one round."""

    of: str
    right: float  # best right score over the region's best; nan where none ends up right
    kept: np.ndarray  # kept scores over the region's best


def main(bins: Path, trees: Path | None, every: int) -> None:
    ratios = [r for one in true_scenes(bins, Path("out/beam_margins"), trees, every) for r in ratios_of_scene(one)]
    rows = []
    for of in dict.fromkeys(r.of for r in ratios):
        mine = [r for r in ratios if r.of == of]
        right = np.array([r.right for r in mine if np.isfinite(r.right)])
        kept = np.concatenate([r.kept for r in mine])
        told = [f"{q:.2f}" for q in np.quantile(right, QUANTILES)] if len(right) else ["-"] * len(QUANTILES)
        under = (f"{(kept < margin).mean():.0%}" for margin in MARGINS)
        least = " ".join(f"{r:.2f}" for r in np.sort(right)[:5])
        rows.append([of, str(len(mine)), str(len(right)), str(len(kept)), least, *told, *under])
    print(markdown_table(
        ["round", "regions", "with a right pose", "poses kept", "least", *(f"right, {q:.1%}" for q in QUANTILES),
         *(f"kept under {m:g}" for m in MARGINS)], rows,
    ))


def ratios_of_scene(one: TrueScene) -> Iterator[Ratio]:
    """One for each region and round of the scene."""
    scene, _ = load_with_trees(one.folder, [one.prepared])
    with noted() as readings:
        read_scene(prepare_forest([one.prepared]), scene.images, scene.sensor, scene.depth, scene.R_w2c)
    for rounds, last in readings:
        if not len(last.region):
            continue
        right = errors(last, one.prepared, one.truth, one.model).min(axis=1) < RIGHT
        for step in reversed(rounds):
            ended = np.zeros(len(step.score), bool)
            ended[step.kept] = right
            right = ended
            for region in np.unique(step.region):
                mine = step.region == region
                best = step.score[mine].max()
                if best <= 0.0:
                    continue
                is_right = mine & ended
                there = step.score[is_right].max() / best if is_right.any() else np.nan
                of_region = step.kept[mine[step.kept]]
                yield Ratio(step.of, there, step.score[of_region] / best)


@contextmanager
def noted() -> Iterator[list[tuple[list[Kept], RegionHypotheses]]]:
    """Notes what every reading's rounds keep, and the poses that they end with."""
    readings: list[tuple[list[Kept], RegionHypotheses]] = []
    narrowed, best, as_they_are = narrowing._narrowed, narrowing.best_of_each_region, challenge.best_as_they_are
    current: list[Kept] = []

    def all_rounds(hypotheses, prepared, sight, rounds, plan, keep):
        current.clear()
        sizes = "-".join(str(step.stage.size) for step in rounds)
        names.append(f"{sizes} keep {list(keep) if keep else [step.keep for step in rounds]}")
        result = narrowed(hypotheses, prepared, sight, rounds, plan, keep)
        readings.append((list(current), result[0]))
        return result

    def all_looks(accepted, turned, prepared, sight, plan):
        current.clear()
        names.append("as they are")
        found = as_they_are(accepted, turned, prepared, sight, plan)
        readings.append((list(current), found))
        return found

    def all_abreast(score, region, behind):
        return np.ones(len(score), bool)

    def keep_best(score, hypotheses, most, *others):
        kept = best(score, hypotheses, most, *others)
        current.append(Kept(f"{names[-1]}: {len(current)}", score, hypotheses.region, kept))
        return kept

    names: list[str] = []
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
