"""What a pixel is worth beside a contour where images alone tell: which weight tells right poses best from wrong ones.

    python experiments/pixel_weight.py [--bins DIR] [--depth stereo|none] [--trees DIR] [--every N]

Every part of the validation bins that is visible by half or more: of the poses near it that reached the last
verification, the likeliest right one (MSSD under 5 % of the diameter; where there is none, the true pose, polished) is
held against the likeliest wrong ones of its place, some apart from another, that are right for no other part either.
For every weight of a pixel (`likelihood.BESIDE_CONTOURS`) the table counts the pairs whose right pose is the likelier
one. The poses are those that the weight in force has left over, so that others look a little better than they are.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

import numpy as np
from jaxtyping import Float
from quality.comparison import markdown_table
from quality.near_poses import errors_below
from true_scenes import TrueScene, bins_parser, true_scenes

from itree_jax.challenge import plan_of
from itree_jax.cli.scene_answer import load_with_trees, with_depth_from
from itree_jax.evaluation.pose_errors import Pose
from itree_jax.evaluation.score import STRICT
from itree_jax.prepared import Prepared, prepare_forest
from itree_jax.recognition import read_scene
from itree_jax.refinement import likelihood
from itree_jax.refinement.likelihood import support
from itree_jax.refinement.optimise import Hypotheses, refine
from itree_jax.refinement.pose_distance import NEARLY_SAME, first_apart
from itree_jax.refinement.schedule import Schedule
from itree_jax.refinement.window_totals import totals
from itree_jax.sight import Sight

WEIGHTS = (1.0, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001, 0.0001)
VISIBLE = 0.5
NEAR = 0.5  # of the diameter: poses whose middle lies nearer are of one place
MOST = 4  # wrong poses of a place


class Pairs(NamedTuple):
    """Of one part: by how much the right pose is likelier than each wrong one, by weight, and whether it was there."""

    nats: Float[np.ndarray, "weights wrong"]
    reached: bool  # recognition reached the right pose itself


def main(bins: Path, depth: str, trees: Path | None, every: int) -> None:
    taken = true_scenes(bins, Path("out/pixel_weight"), trees, every)
    pairs = [pair for one in taken for pair in pairs_of_scene(one, depth)]
    print(weights_table(pairs))


def weights_table(pairs: list[Pairs]) -> str:
    """Pairs whose right pose is the likelier one, by the weight of a pixel."""
    rows = []
    for k, weight in enumerate(WEIGHTS):
        cells = []
        for reached in (True, False):
            told = np.concatenate([np.zeros(0), *(p.nats[k] for p in pairs if p.reached == reached)]) > 0.0
            cells.append(f"{told.sum()} of {len(told)}")
        rows.append([f"{weight:g}", *cells])
    return markdown_table(["weight of a pixel", "right pose reached", "right pose not reached"], rows)


def pairs_of_scene(one: TrueScene, depth: str) -> Iterator[Pairs]:
    """Recognises one scene and pairs the poses of every part that is visible enough."""
    prepared, truth, model = one.prepared, one.truth, one.model
    scene, _ = load_with_trees(one.folder, [prepared])
    scene, second = with_depth_from(depth, scene, prepared.tree.sensor)
    answers, sight = read_scene(
        prepare_forest([prepared]), scene.images, scene.sensor, scene.depth, scene.R_w2c, second
    )
    if not answers:
        return
    plan = plan_of(answers[0], sight)
    R, t = (np.concatenate([np.asarray(a.hypotheses.poses[k], float) for a in answers]) for k in (0, 1))
    nats = np.concatenate([a.judged.log_likelihood for a in answers])
    of_object = Pose(*prepared.of_object(Hypotheses(R, t)))
    error = errors_below(of_object, truth.pose, model, model.diameter) / model.diameter
    R_true, t_true = prepared.about_middle(truth.pose.R, truth.pose.t)
    for k in np.flatnonzero(truth.visible >= VISIBLE):
        close = np.linalg.norm(t - t_true[k], axis=-1) < NEAR * model.diameter
        right = np.flatnonzero(close & (error[:, k] < STRICT))
        wrong = np.flatnonzero(close & (error.min(axis=1) >= STRICT))
        wrong = wrong[np.argsort(-nats[wrong], kind="stable")]
        wrong = wrong[first_apart(
            R[wrong], t[wrong], prepared.symmetries, model.diameter, NEARLY_SAME * model.diameter, MOST
        )]  # fmt: skip
        if not len(wrong):
            continue
        if len(right):
            best = right[nats[right].argmax()]
            first = R[best], t[best]
        else:
            first = true_pose(R_true[k], t_true[k], prepared, sight, plan)
        yield Pairs(ratios(first, R[wrong], t[wrong], prepared, sight, plan), bool(len(right)))


def true_pose(
    R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"], prepared: Prepared, sight: Sight, plan: Schedule
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """As answers are, polished: an exact pose is held against nothing that was fitted to the image."""
    one = Hypotheses(R[None].astype(np.float32), t[None].astype(np.float32))
    found = refine(
        one, prepared.model, sight.held_against, sight.sensor.camera, plan.independent, plan.last, plan.jump,
        sight.others, sight.crease,
    )
    return np.asarray(found.R_cam_obj[0], float), np.asarray(found.t_cam_obj[0], float)


def ratios(
    right: tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]], R: Float[np.ndarray, "wrong 3 3"],
    t: Float[np.ndarray, "wrong 3"], prepared: Prepared, sight: Sight, plan: Schedule,
) -> Float[np.ndarray, "weights wrong"]:
    """By how much the right pose is likelier than the wrong ones [nats], by the weight of a pixel."""
    poses = Hypotheses(*(np.concatenate([a[None], b]).astype(np.float32) for a, b in zip(right, (R, t), strict=True)))
    found = []
    for weight in WEIGHTS:
        with patch.object(likelihood, "BESIDE_CONTOURS", weight):
            seen = support(
                poses, prepared.model, sight.held_against, sight.sensor.camera, plan.errors, plan.jump, sight.others,
                crease=sight.crease,
            )
        summed = totals(seen)
        nats = seen.weight * (summed.spoken_for - summed.spoken_against) + seen.beside
        found.append(nats[0] - nats[1:])
    return np.array(found) * seen.stride**2


if __name__ == "__main__":
    parser = bins_parser(__doc__, every=1)
    parser.add_argument("--depth", choices=("stereo", "none"), default="stereo")
    given = parser.parse_args()
    main(given.bins, given.depth, given.trees, given.every)
