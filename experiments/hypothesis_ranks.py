"""How much of the posterior lies before the first attitude that refinement can reach: where a reading may stop.

    python experiments/hypothesis_ranks.py [--bins DIR] [--trees DIR] [--every N]

Of every region of the validation bins: how many of the tree's attitudes hold 75 and 99 % of the posterior mass, and how
much mass lies before the first one within reach of a true pose (MSSD under 25 % of the diameter).
"""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from quality.comparison import markdown_table
from true_scenes import TrueScene, bins_parser, true_scenes

from itree_jax.backtracking import FIRST
from itree_jax.cli.scene_answer import load_with_trees
from itree_jax.evaluation.pose_errors import Pose, mssd
from itree_jax.evaluation.truth import Model, SceneTruth
from itree_jax.interpreting import as_hypotheses, attitudes_of, placed_by_segment
from itree_jax.prepared import Prepared
from itree_jax.refinement.hypotheses import RegionHypotheses
from itree_jax.region_measures import features_of, in_batches, measure_regions
from itree_jax.sight import look
from itree_jax.tree.draws import BESIDE_REACH

REACHED = 0.25  # of the diameter
LEVELS = (0.25, 0.5, 0.75, 0.9, 0.99)


class Ranks(NamedTuple):
    """Of one region."""

    visible: float  # of the instance that its best attitude is nearest to
    before: float  # posterior mass before the first attitude within reach; 1 where none is
    few: int  # attitudes that hold three quarters of the mass
    most: int  # ... and 99 %


def main(bins: Path, trees: Path | None, every: int) -> None:
    taken = true_scenes(bins, Path("out/hypothesis_ranks"), trees, every)
    found = [ranks for one in taken for ranks in ranks_of_scene(one)]
    seen = [r for r in found if r.visible >= 0.7]
    reached = [r for r in seen if r.before < 1.0]
    rows = [
        [f"{level:.0%}", *(f"{np.mean([r.before < level for r in some]):.0%}" for some in (reached, seen))]
        for level in LEVELS
    ]
    print(f"{len(seen)} regions of parts visible by 70 % or more; {len(reached)} have an attitude within reach\n")
    print(markdown_table(["mass looked at", "reached, of these", "reached, of all"], rows))
    print(f"attitudes per region: median {np.median([r.few for r in seen]):.0f} hold 75 %, "
          f"{np.median([r.most for r in seen]):.0f} hold 99 %; the first reading stops at {FIRST.mass:.0%}")


def ranks_of_scene(one: TrueScene) -> Iterator[Ranks]:
    """One for each region of the scene, by its depth map."""
    prepared = one.prepared
    scene, _ = load_with_trees(one.folder, [prepared])
    sight = look(scene.images, scene.sensor, scene.depth, scene.R_w2c)
    if not sight.found.count:
        return
    asked = np.arange(sight.found.count)
    measured = measure_regions(sight.found, sight.needle, scene.images, scene.sensor, prepared.pitch)
    features = features_of(measured, asked, sight.found, scene.sensor, BESIDE_REACH * prepared.model.reach)
    _, candidates = in_batches(partial(attitudes_of, prepared), features)
    first = as_hypotheses(candidates, prepared, sight, asked, measured.R_ray_cam)
    by_segment = placed_by_segment(first, prepared, sight)
    error = np.minimum(*(errors(h, prepared, one.truth, one.model) for h in (first, by_segment)))
    for region in asked:
        mine = np.flatnonzero(first.region == region)
        order = mine[np.argsort(-first.log_likelihood[mine], kind="stable")]
        p = np.exp(first.log_likelihood[order] - first.log_likelihood[order[0]])
        mass = np.cumsum(p) / p.sum()
        instance = int(error[mine].min(axis=0).argmin())
        near = np.flatnonzero(error[order, instance] < REACHED)
        before = float(mass[near[0]] - p[near[0]] / p.sum()) if len(near) else 1.0
        few, most = (int((mass < level).sum()) + 1 for level in (0.75, 0.99))
        yield Ranks(float(one.truth.visible[instance]), before, few, most)


def errors(hypotheses: RegionHypotheses, prepared: Prepared, truth: SceneTruth, model: Model) -> np.ndarray:
    """MSSD over the diameter of every hypothesis to every instance."""
    R, t = prepared.of_object(hypotheses.poses)
    true = Pose(truth.pose.R[None], truth.pose.t[None])
    parts = [
        mssd(Pose(R[k : k + 256, None], t[k : k + 256, None]), true, model.hull, model.symmetries)
        for k in range(0, len(R), 256)
    ]
    return np.concatenate(parts) / model.diameter


if __name__ == "__main__":
    given = bins_parser(__doc__, every=4).parse_args()
    main(given.bins, given.trees, given.every)
