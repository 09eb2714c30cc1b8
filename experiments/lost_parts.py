"""Where recognition loses a part: at its regions, its hypotheses, their refinement, or their selection.

    python experiments/lost_parts.py [--bins DIR] [--depth file|stereo|none] [--trees DIR] [--every N]

Of every part of the validation bins that is visible by 70 % or more: the first step after which no trace of it is left.
A region is a trace if most of it lies on the part; a hypothesis, if refinement can reach the part from it (MSSD under
25 % of the diameter); a refined one, if it is right (under 5 %).
"""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from hypothesis_ranks import REACHED
from jaxtyping import Float, Int
from quality.comparison import markdown_table
from quality.near_poses import errors_below
from true_scenes import TrueScene, bins_parser, true_scenes

from itree_jax import interpreting
from itree_jax.answers import Interpretation, pose_matrix
from itree_jax.cli.scene_answer import load_with_trees, with_depth_from
from itree_jax.evaluation.pose_errors import Pose
from itree_jax.evaluation.score import STRICT, VISIBLE
from itree_jax.evaluation.truth import Model, SceneTruth
from itree_jax.prepared import Prepared, prepare_forest
from itree_jax.recognition import read_scene
from itree_jax.refinement.hypotheses import RegionHypotheses
from itree_jax.sight import Sight
from itree_jax.world.explained import rendered

FOUND, UNSELECTED, UNREFINED, NO_HYPOTHESIS, NO_REGION = (
    "found", "a right pose is not selected", "refinement reaches no right pose", "no hypothesis within reach",
    "no region",
)  # fmt: skip


class Fate(NamedTuple):
    """Of one part."""

    scene_id: int
    instance: int
    step: str
    why: str  # of an unselected pose, "" elsewhere
    score: float  # of its best right pose, 0 where there is none


def main(bins: Path, depth: str, trees: Path | None, every: int) -> None:
    fates = list(fates_of_bins(bins, depth, trees, every))
    for fate in fates:
        if fate.step != FOUND:
            why = f" ({fate.score:.2f}, {fate.why})" if fate.why else ""
            print(f"{fate.scene_id:06d} part {fate.instance}: {fate.step}{why}")
    print(fates_table(fates))


def fates_table(fates: list[Fate]) -> str:
    counts = Counter(fate.step for fate in fates)
    steps = (FOUND, NO_REGION, NO_HYPOTHESIS, UNREFINED, UNSELECTED)
    rows = [[step, str(counts[step]), f"{counts[step] / max(len(fates), 1):.0%}"] for step in steps]
    return markdown_table(["step", "parts", "of all"], rows)


def fates_of_bins(bins: Path, depth: str, trees: Path | None, every: int) -> Iterator[Fate]:
    for one in true_scenes(bins, Path("out/lost_parts"), trees, every):
        yield from fates_of_scene(one, depth)


def fates_of_scene(one: TrueScene, depth: str) -> list[Fate]:
    """Recognises one scene and follows every part that is visible enough."""
    prepared = one.prepared
    scene, _ = load_with_trees(one.folder, [prepared])
    scene, second = with_depth_from(depth, scene, prepared.tree.sensor)
    starts: list[RegionHypotheses] = []
    first = "narrow_and_judge" if depth == "file" else "narrow"  # without a depth map poses are narrowed twice
    narrow = getattr(interpreting, first)

    def followed(hypotheses: RegionHypotheses, *rest) -> Any:
        starts.append(hypotheses)
        return narrow(hypotheses, *rest)

    with patch.object(interpreting, first, followed):
        answers, sight = read_scene(
            prepare_forest([prepared]), scene.images, scene.sensor, scene.depth, scene.R_w2c, second
        )
    return fates(answers, sight, starts, prepared, one.truth, one.model)


def fates(
    answers: list[Interpretation], sight: Sight, starts: list[RegionHypotheses], prepared: Prepared, truth: SceneTruth,
    model: Model,
) -> list[Fate]:
    """`starts`: the hypotheses that refinement began with, of every reading."""
    owned = np.zeros(len(truth.visible), int)
    instance = true_instances(prepared, truth, sight)
    for found in {id(a.found): a.found for a in answers}.values():
        owned += [bool((most_of(found.labels, instance) == k).any()) for k in range(len(owned))]
    nothing = np.full((1, len(owned)), np.inf)
    begun = np.concatenate([nothing, *(near_errors(s, prepared, truth, model) for s in starts)]).min(axis=0)
    ended = [near_errors(a.hypotheses, prepared, truth, model) for a in answers]
    score = np.concatenate([a.selection.score for a in answers]) if answers else np.zeros(0)
    reason = [r for a in answers for r in a.selection.reason]
    error = np.concatenate(ended) if ended else np.zeros((0, len(owned)))
    taken = np.concatenate(
        [np.isin(np.arange(len(a.selection.score)), a.selection.accepted) for a in answers]
    ) if answers else np.zeros(0, bool)  # fmt: skip
    result = []
    for k in np.flatnonzero(truth.visible >= VISIBLE):
        right = np.flatnonzero(error[:, k] < STRICT)
        if taken[right].any():
            step = FOUND
        elif len(right):
            step = UNSELECTED
        elif begun[k] < REACHED:
            step = UNREFINED
        else:
            step = NO_HYPOTHESIS if owned[k] else NO_REGION
        best = right[score[right].argmax()] if len(right) else -1
        why = reason[best] if step == UNSELECTED else ""
        result.append(Fate(truth.scene_id, int(k), step, why, float(score[best]) if best >= 0 else 0.0))
    return result


def near_errors(
    hypotheses: RegionHypotheses, prepared: Prepared, truth: SceneTruth, model: Model
) -> Float[np.ndarray, "hypotheses instances"]:
    """MSSD over the diameter, infinity where refinement surely can't reach the part."""
    poses = Pose(*prepared.of_object(hypotheses.poses))
    return errors_below(poses, truth.pose, model, REACHED * model.diameter) / model.diameter


def true_instances(prepared: Prepared, truth: SceneTruth, sight: Sight) -> Int[np.ndarray, "height width"]:
    """The part that is seen at each pixel, by the true poses; -1 none."""
    T = [pose_matrix(R, t) for R, t in zip(truth.pose.R, truth.pose.t, strict=True)]
    return rendered([(prepared.tree.part, one) for one in T], None, sight.sensor.camera)[1]


def most_of(labels: Int[np.ndarray, "height width"], instance: Int[np.ndarray, "height width"]) -> np.ndarray:
    """The part that most of each region lies on; -1 none."""
    count = int(labels.max(initial=-1)) + 1
    votes: Float[np.ndarray, "regions parts"] = np.zeros((count, int(instance.max(initial=-1)) + 2))
    inside = labels >= 0
    np.add.at(votes, (labels[inside], instance[inside] + 1), 1.0)
    return votes.argmax(axis=1) - 1


if __name__ == "__main__":
    parser = bins_parser(__doc__, every=1)
    parser.add_argument("--depth", choices=("file", "stereo", "none"), default="stereo")
    given = parser.parse_args()
    main(given.bins, given.depth, given.trees, given.every)
