"""How far likelihood ratios scatter that should be zero: two refinements of one true pose, held against each other.

    python experiments/refinement_nats.py [--bins DIR] [--depth file|stereo|none] [--trees DIR] [--every N]

Every part visible by half or more of the validation bins is refined twice from its true pose, turned and shifted by
what the last but one round leaves, and polished as answers are. `scoring.Scoring.refinement` comes from here: smaller
ratios are no evidence.
"""

import argparse
from pathlib import Path

import numpy as np
from evaluate_scenes import Config as Evaluation
from evaluate_scenes import scenes_of_parts, tree_of
from scipy.spatial.transform import Rotation

from itree_jax.cli.scene_answer import load_with_trees, with_depth_from
from itree_jax.evaluation.truth import SceneTruth, load_truth
from itree_jax.prepared import Prepared, prepare
from itree_jax.refinement.likelihood import support
from itree_jax.refinement.optimise import Hypotheses, refine
from itree_jax.refinement.select import likelihood_ratio
from itree_jax.sight import look
from itree_jax.tree.tree_file import load_tree

VISIBLE = 0.5
TURN, SHIFT = np.radians(3.0), 1.0  # rms [rad], [mm]


def main(bins: Path, depth: str, trees: Path | None, every: int) -> None:
    truths = {t.scene_id: t for t in load_truth(bins)}
    evaluation = Evaluation(dataset=bins, out=Path("out/refinement_nats"), trees=trees)
    evaluation.out.mkdir(parents=True, exist_ok=True)
    ratios: list[float] = []
    for obj_id, folders in scenes_of_parts(bins):
        prepared: dict[int, Prepared] = {}
        for folder in folders[::every]:
            lights = len(list((folder / "lit").glob("000000_*")))
            if lights not in prepared:
                prepared[lights] = prepare(load_tree(tree_of(evaluation, obj_id, lights, folder)))
            ratios += ratios_of_scene(folder, prepared[lights], depth, truths[int(folder.name)])
    size = np.abs(ratios)
    print(f"{len(ratios)} pairs of refinements of one pose: |log likelihood ratio| median {np.median(size):.0f}, "
          f"68 % {np.percentile(size, 68):.0f}, 95 % {np.percentile(size, 95):.0f} nats")


def ratios_of_scene(folder: Path, prepared: Prepared, depth: str, truth: SceneTruth) -> list[float]:
    """Log likelihood ratios [nats] of pairs that should be equally likely."""
    scene, _ = load_with_trees(folder, [prepared])
    scene, second = with_depth_from(depth, scene, prepared.tree.sensor)
    sight = look(scene.images, scene.sensor, scene.depth, scene.R_w2c, second)
    seen = np.flatnonzero(truth.visible >= VISIBLE)
    if not len(seen):
        return []
    rng = np.random.default_rng(truth.scene_id)
    R = np.repeat(truth.pose.R[seen], 2, axis=0)
    R = Rotation.from_rotvec(rng.normal(0.0, TURN / np.sqrt(3.0), (len(R), 3))).as_matrix() @ R
    t = np.repeat(truth.pose.t[seen], 2, axis=0) + rng.normal(0.0, SHIFT / np.sqrt(3.0), (len(R), 3))
    plan = sight.plan(prepared.tree.part.diameter, prepared.tree.spacing)
    camera, model = scene.sensor.camera, prepared.model
    stages = [(step.stage, plan.deviations) for step in plan.rounds[-2:]]
    stages.append((plan.last, plan.independent))
    poses = Hypotheses(*(a.astype(np.float32) for a in prepared.about_middle(R, t)))
    for stage, deviations in stages:
        poses = refine(
            poses, model, sight.held_against, camera, deviations, [stage], plan.jump, sight.others, sight.crease
        )
    weighed = support(
        poses, model, sight.held_against, camera, plan.errors, plan.jump, sight.others, crease=sight.crease
    )
    return [likelihood_ratio(weighed, k, k + 1) for k in range(0, len(R), 2)]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bins", type=Path, default=Path("out/validation_bins"))
    parser.add_argument("--depth", choices=("file", "stereo", "none"), default="file")
    parser.add_argument("--trees", type=Path, default=None)
    parser.add_argument("--every", type=int, default=4, help="takes every n-th scene of each part")
    given = parser.parse_args()
    main(given.bins, given.depth, given.trees, given.every)
