"""How far likelihood ratios scatter that should be zero: two refinements of one true pose, held against each other.

    python experiments/refinement_nats.py [--bins DIR] [--depth file|stereo|none] [--trees DIR] [--every N]

Every part visible by half or more of the validation bins is refined twice from its true pose, turned and shifted by
what the last but one round leaves, and polished as answers are. `scoring.Scoring.refinement` comes from here: smaller
ratios are no evidence.
"""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from true_scenes import TrueScene, bins_parser, true_scenes

from itree_jax.cli.scene_answer import load_with_trees, with_depth_from
from itree_jax.refinement.likelihood import support
from itree_jax.refinement.optimise import Hypotheses, refine
from itree_jax.refinement.select import likelihood_ratio
from itree_jax.sight import look

VISIBLE = 0.5
TURN, SHIFT = np.radians(3.0), 1.0  # rms [rad], [mm]


def main(bins: Path, depth: str, trees: Path | None, every: int) -> None:
    taken = true_scenes(bins, Path("out/refinement_nats"), trees, every)
    ratios = [ratio for one in taken for ratio in ratios_of_scene(one, depth)]
    size = np.abs(ratios)
    print(f"{len(ratios)} pairs of refinements of one pose: |log likelihood ratio| median {np.median(size):.0f}, "
          f"68 % {np.percentile(size, 68):.0f}, 95 % {np.percentile(size, 95):.0f} nats")


def ratios_of_scene(one: TrueScene, depth: str) -> list[float]:
    """Log likelihood ratios [nats] of pairs that should be equally likely."""
    prepared, truth = one.prepared, one.truth
    scene, _ = load_with_trees(one.folder, [prepared])
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
    stages = [([step.stage], plan.deviations) for step in plan.rounds[-2:]]
    stages.append((plan.last, plan.independent))
    poses = Hypotheses(*(a.astype(np.float32) for a in prepared.about_middle(R, t)))
    for some, deviations in stages:
        poses = refine(
            poses, model, sight.held_against, camera, deviations, some, plan.jump, sight.others, sight.crease
        )
    weighed = support(
        poses, model, sight.held_against, camera, plan.errors, plan.jump, sight.others, crease=sight.crease
    )
    return [likelihood_ratio(weighed, k, k + 1) for k in range(0, len(R), 2)]


if __name__ == "__main__":
    parser = bins_parser(__doc__, every=4)
    parser.add_argument("--depth", choices=("file", "stereo", "none"), default="file")
    given = parser.parse_args()
    main(given.bins, given.depth, given.trees, given.every)
