"""What one tree makes of regions: groups, attitudes, poses that are refined and verified (Ikeuchi 1987, sec. 3)."""

from functools import partial

import numpy as np
from jaxtyping import Float, Int

from itree_jax.answers import Interpretation
from itree_jax.at_a_glance import best_at_a_glance
from itree_jax.backtracking import Beam, likeliest
from itree_jax.challenge import challenged
from itree_jax.competition import when_asked
from itree_jax.features.region import RegionFeatures
from itree_jax.narrowing import narrow, narrow_and_judge
from itree_jax.open_places import every_attitude, open_places
from itree_jax.prepared import Prepared
from itree_jax.refinement.hypotheses import RegionHypotheses, distinct, joined, place
from itree_jax.refinement.optimise import Hypotheses
from itree_jax.refinement.verify import visible_centres
from itree_jax.region_measures import Measured, features_of, in_batches
from itree_jax.root_answer import RootAnswer
from itree_jax.sight import Sight
from itree_jax.tree.classify import Classification, classify
from itree_jax.tree.determination_rules import Candidates
from itree_jax.tree.determine import determine
from itree_jax.tree.draws import BESIDE_REACH

AGAIN = slice(2, None)  # rounds that poses go through twice without a depth map: at first many stop on the way
PLACING_SIZE = 12  # window pixels for the mean of what a pose shows
BY_SHAPE, BY_EGI = 64, 96  # candidates per region from A1, A4, A5 and from A1, A2: leaves return tens of attitudes


def interpret(
    prepared: Prepared, part: int, asked: Int[np.ndarray, "asked"], said: RootAnswer, measured: Measured, sight: Sight,
    beam: Beam,
) -> Interpretation:
    """Regions -> groups -> attitudes -> refined and verified poses, all regions that are asked for in one batch."""
    tree, sensor = prepared.tree, sight.sensor
    features = features_of(measured, asked, sight.found, sensor, BESIDE_REACH * prepared.model.reach)
    classification, candidates = in_batches(partial(attitudes_of, prepared), features)
    hypotheses = likeliest(as_hypotheses(candidates, prepared, sight, asked, measured.R_ray_cam), beam.mass)
    hypotheses = joined(hypotheses, placed_by_segment(hypotheses, prepared, sight))
    hypotheses = hypotheses.take(distinct(hypotheses, prepared.symmetries, prepared.model.diameter))
    if beam.whole_dome:
        places = open_places(prepared, sight, asked)
        if len(places.region):
            hypotheses = joined(hypotheses, every_attitude(prepared, sight, places, measured.R_ray_cam))
        hypotheses = best_at_a_glance(hypotheses, prepared, sight)
    plan = sight.plan(tree.part.diameter, tree.spacing)
    rounds, keep = plan.rounds, beam.keep
    if sight.kind != "depth":
        keep = beam.keep_by_images
        hypotheses, rounds, keep = narrow(hypotheses, prepared, sight, rounds, plan, keep), rounds[AGAIN], keep[AGAIN]
    hypotheses, judged = narrow_and_judge(hypotheses, prepared, sight, rounds, plan, keep)
    answer = Interpretation(
        prepared, part, asked, features, classification, hypotheses, judged,
        when_asked(judged, prepared, hypotheses, sight), sight.found, said,
    )
    return challenged(answer, sight)


def attitudes_of(prepared: Prepared, features: RegionFeatures) -> tuple[Classification, Candidates]:
    """What the tree says of some regions: their groups, and attitudes of these."""
    classification = classify(features, prepared.classification)
    prior = classification.group_log_probability
    return classification, determine(features, prior, prepared.determination, BY_SHAPE, BY_EGI)


def as_hypotheses(
    candidates: Candidates, prepared: Prepared, sight: Sight, asked: Int[np.ndarray, "asked"],
    R_ray_cam: Float[np.ndarray, "regions 3 3"],
) -> RegionHypotheses:
    """Candidate attitudes placed so that the appearance's mean surface point lies on the region's."""
    found = sight.found
    R_ray_obj, row, score = map(np.asarray, candidates)
    # a part with few appearances leaves places in the list: they repeat the region's best
    empty = ~np.isfinite(score)
    best = np.argmax(score, axis=1)[:, None]
    pick = np.where(empty, best, np.arange(score.shape[1])[None])
    R_ray_obj = np.take_along_axis(R_ray_obj, pick[..., None, None], axis=1)
    row = np.take_along_axis(row, pick, axis=1)
    X_region = sight.sensor.camera.unproject(found.centroid_uv, found.mean_depth)
    from_middle = prepared.tree.appearances.centroid_obj[row] - prepared.middle
    R, t = place(R_ray_obj, from_middle, R_ray_cam[asked], X_region[asked])
    region = np.repeat(asked, row.shape[1])
    poses = Hypotheses(R.reshape(-1, 3, 3), t.reshape(-1, 3))
    log_likelihood = np.where(empty, -np.inf, score).reshape(-1)
    return RegionHypotheses(poses, region, row.reshape(-1), log_likelihood, *np.zeros((3, len(region)), bool))


def placed_by_segment(hypotheses: RegionHypotheses, prepared: Prepared, sight: Sight) -> RegionHypotheses:
    """The same attitudes, placed by all of the surface that hangs together with the region in the depth map.

    A region ends at shadows; the surface doesn't. So the mean of a whole part's surface places a pose well where a
    region was cut, and badly where parts touch: both placements go on.
    """
    shown = visible_centres(hypotheses.poses, prepared.rough, sight.sensor.camera, PLACING_SIZE)
    t_cam_obj = hypotheses.poses.t_cam_obj + sight.held.centre[hypotheses.region] - shown
    poses = Hypotheses(hypotheses.poses.R_cam_obj, t_cam_obj.astype(np.float32))
    return hypotheses._replace(poses=poses)
