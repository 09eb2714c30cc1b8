"""What the weights of the very last step are worth: errors of true poses, turned, refined and polished as answers are.

    python experiments/exact_poses.py [--bins DIR] [--trees DIR] [--every N]

Of parts visible by 70 % or more, with a depth map; parts of revolution are left out. Then once more, as
`settling.exact` does it, with what a depth's variance across a surface seen edge-on is taken to be (1: the same weight
on every surface): medians of rotation and position.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from quality.comparison import markdown_table
from scipy.spatial.transform import Rotation
from true_scenes import TrueScene, bins_parser, true_scenes

from itree_jax.cli.scene_answer import load_with_trees
from itree_jax.refinement.optimise import Hypotheses, Stage, refine
from itree_jax.refinement.residuals import Deviations
from itree_jax.refinement.schedule import Schedule
from itree_jax.sight import look

VISIBLE = 0.7
TURN, SHIFT = np.radians(1.0), 0.3  # rms [rad], [mm]: what the last but one round leaves
GRAZING = (1.0, 0.25, 0.1, 0.03, 0.01)
POLISHED, STATED = "polished", "as the sensor says"


def main(bins: Path, trees: Path | None, every: int) -> None:
    found: dict[str, list[tuple[float, float]]] = {}
    for one in true_scenes(bins, Path("out/exact_poses"), trees, every):
        for name, errors in errors_of_scene(one):
            found.setdefault(name, []).extend(errors)
    rows = [
        [name, f"{len(errors)}", f"{np.median([e[0] for e in errors]):.4f} deg",
         f"{np.quantile([e[0] for e in errors], 0.75):.4f} deg", f"{np.median([e[1] for e in errors]):.4f} mm"]
        for name, errors in found.items()
    ]  # fmt: skip
    print(markdown_table(["variance seen edge-on", "poses", "rotation", "75 %", "position"], rows))


def ways(plan: Schedule) -> Iterator[tuple[str, Deviations]]:
    """Deviations of the very last step."""
    assert plan.exact is not None
    for grazing in GRAZING:
        yield f"{grazing:g}", plan.independent._replace(grazing=np.float32(grazing))
    yield STATED, plan.exact[1]


def errors_of_scene(one: TrueScene) -> Iterator[tuple[str, list[tuple[float, float]]]]:
    """Errors in rotation [deg] and position [mm] of the part's middle, by way."""
    prepared, truth = one.prepared, one.truth
    seen = np.flatnonzero(truth.visible >= VISIBLE)
    if prepared.symmetries.continuous or not len(seen):
        return
    scene, _ = load_with_trees(one.folder, [prepared])
    sight = look(scene.images, scene.sensor, scene.depth, scene.R_w2c)
    plan = sight.plan(prepared.tree.part.diameter, prepared.tree.spacing)
    true = prepared.about_middle(truth.pose.R[seen], truth.pose.t[seen])
    rng = np.random.default_rng(truth.scene_id)
    off = Rotation.from_rotvec(rng.normal(0.0, TURN / np.sqrt(3.0), (len(seen), 3))).as_matrix()
    shift = rng.normal(0.0, SHIFT / np.sqrt(3.0), (len(seen), 3))
    poses = Hypotheses((off @ true.R_cam_obj).astype(np.float32), (true.t_cam_obj + shift).astype(np.float32))

    def refined(poses: Hypotheses, stages: Sequence[Stage], deviations: Deviations) -> Hypotheses:
        return refine(poses, prepared.model, sight.held_against, scene.sensor.camera, deviations, stages, plan.jump)

    def errors(poses: Hypotheses) -> list[tuple[float, float]]:
        turned = Rotation.from_matrix(np.asarray(poses.R_cam_obj, float) @ true.R_cam_obj.swapaxes(1, 2)).magnitude()
        shifted = np.linalg.norm(poses.t_cam_obj - true.t_cam_obj, axis=1)
        return list(zip(np.degrees(turned).tolist(), shifted.tolist(), strict=True))

    poses = refined(poses, [plan.rounds[-1].stage], plan.deviations)
    poses = refined(poses, plan.last, plan.independent)
    yield POLISHED, errors(poses)
    assert plan.exact is not None
    for name, deviations in ways(plan):
        yield name, errors(refined(poses, [plan.exact[0]], deviations))


if __name__ == "__main__":
    given = bins_parser(__doc__, every=1).parse_args()
    main(given.bins, given.trees, given.every)
