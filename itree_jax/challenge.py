"""The last word on accepted poses: each is challenged by the poses that it is easily mistaken for, and polished."""

from dataclasses import replace

import numpy as np

from itree_jax.answers import Interpretation
from itree_jax.competition import compete, select
from itree_jax.narrowing import judge, narrow, rivalry
from itree_jax.prepared import Prepared
from itree_jax.refinement.hypotheses import RegionHypotheses, joined, turned_about_axes
from itree_jax.refinement.optimise import Hypotheses, refine
from itree_jax.refinement.schedule import Schedule
from itree_jax.refinement.select import Judged, together
from itree_jax.refinement.verify import visible_centres
from itree_jax.sensor import Sensor
from itree_jax.sight import Sight

CHALLENGES = 2  # a winner that its place owes to a challenge may have to stand one more


def settled(answers: list[Interpretation], sight: Sight) -> list[Interpretation]:
    """Accepted poses that nothing near them beats, at the image's own resolution."""
    for _ in range(CHALLENGES):
        more = [challenged(a, sight) for a in answers]
        if all(new is old for new, old in zip(more, answers, strict=True)):
            break
        answers = compete(more, sight)
    return compete([polished(a, sight) for a in answers], sight)


def challenged(answer: Interpretation, sight: Sight) -> Interpretation:
    """The interpretation with the turned poses of those accepted ones that have not met theirs yet."""
    accepted = answer.selection.accepted
    new = accepted[~answer.hypotheses.challenged[accepted]]
    if not len(new):
        return answer
    prepared, plan = answer.prepared, plan_of(answer, sight)
    poses = answer.hypotheses.take(new)
    turned = turned_poses(poses, prepared, sight.sensor, plan.turned[0].stage.size)
    turned = narrow(turned, prepared, sight, plan.turned, plan)
    turned = turned._replace(region=poses.region[turned.region], challenged=np.ones(len(turned.region), bool))
    met = answer.hypotheses.challenged.copy()
    met[new] = True
    first = replace(answer, hypotheses=answer.hypotheses._replace(challenged=met))
    return with_more(first, turned, judge(turned, prepared, sight, plan), sight)


def turned_poses(
    accepted: RegionHypotheses, prepared: Prepared, sensor: Sensor, size: int
) -> RegionHypotheses:
    """Each accepted pose turned about the part's main axes, moved so that it shows its surface where the pose did.

    They explain the same place, and only one is right. `region` counts the accepted poses.
    """
    own = accepted._replace(region=np.arange(len(accepted.region)))
    turned = turned_about_axes(own, prepared.turns)
    there = visible_centres(own.poses, prepared.model, sensor.camera, size)
    here = visible_centres(turned.poses, prepared.model, sensor.camera, size)
    t_cam_obj = turned.poses.t_cam_obj + there[turned.region] - here
    return turned._replace(poses=Hypotheses(turned.poses.R_cam_obj, t_cam_obj))


def polished(answer: Interpretation, sight: Sight) -> Interpretation:
    """The accepted poses and their rivals, refined once more where the depth map's pixels err independently.

    How far neighbours' errors hang together no depth map tells. So the last step takes them to be independent, and is
    kept where the pose explains the scene better than before.
    """
    plan, accepted = plan_of(answer, sight), answer.selection.accepted
    if plan.last is None or not len(accepted):
        return answer
    close = [others for others, _ in answer.selection.rivals]
    tried = np.unique(np.concatenate([accepted, *close]))
    before = answer.hypotheses.take(tried)
    poses = refine(
        before.poses, answer.prepared.model, sight.observed, sight.sensor.camera, plan.independent, [plan.last],
        plan.jump, sight.others, sight.crease,
    )
    after = before._replace(poses=poses)
    judged = judge(after, answer.prepared, sight, plan)
    better = np.flatnonzero(judged.log_likelihood > answer.judged.log_likelihood[tried])
    kept = np.setdiff1d(np.arange(len(answer.selection.score)), tried[better])
    rest = replace(
        answer, hypotheses=answer.hypotheses.take(kept), judged=answer.judged.take(kept),
    )
    return with_more(rest, after.take(better), judged.take(better), sight)


def with_more(
    answer: Interpretation, more: RegionHypotheses, judged: Judged, sight: Sight
) -> Interpretation:
    """The interpretation with more hypotheses, selected anew."""
    hypotheses = joined(answer.hypotheses, more)
    all_judged = together(answer.judged, judged).with_rivalry(rivalry(hypotheses, answer.prepared))
    return replace(
        answer, hypotheses=hypotheses, judged=all_judged,
        selection=select(all_judged, answer.prepared, hypotheses, sight),
    )


def plan_of(answer: Interpretation, sight: Sight) -> Schedule:
    tree = answer.prepared.tree
    return sight.plan(tree.part.diameter, tree.spacing)

