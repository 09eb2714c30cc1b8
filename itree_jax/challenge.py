"""Accepted poses are challenged by those that they are easily mistaken for: turned about the part's main axes."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Int

from itree_jax.answers import Interpretation
from itree_jax.competition import when_asked
from itree_jax.narrowing import judge, narrow, narrow_and_judge, rivalry
from itree_jax.prepared import Prepared
from itree_jax.refinement.hypotheses import (
    RegionHypotheses,
    abreast,
    agreement,
    best_of_each_region,
    joined,
    turned_about_axes,
)
from itree_jax.refinement.optimise import Hypotheses
from itree_jax.refinement.pose_distance import NEARLY_SAME, same_part_distance
from itree_jax.refinement.schedule import Schedule
from itree_jax.refinement.select import Judged, together
from itree_jax.refinement.verify import verify, visible_centres
from itree_jax.sensor import Sensor
from itree_jax.sight import Sight

MOST_ROUGHLY = 10  # turned poses that are looked at finely: of the 23 turns of a cube less than half
MOST_AS_THEY_ARE = 4  # turned poses that are looked at closer without being moved: a plain block has three


def challenged(answer: Interpretation, sight: Sight) -> Interpretation:
    """The interpretation with the turned poses of those accepted ones that have not met theirs yet."""
    accepted = answer.selection.accepted
    new = accepted[~answer.hypotheses.challenged[accepted]]
    if not len(new):
        return answer
    prepared, plan = answer.prepared, plan_of(answer, sight)
    poses = answer.hypotheses.take(new)
    found = challengers(poses._replace(region=np.arange(len(new))), prepared, sight, plan)
    met = answer.hypotheses.challenged.copy()
    met[new] = True
    first = replace(answer, hypotheses=answer.hypotheses._replace(challenged=met))
    if found is None:
        return first
    turned, judged = found
    turned = turned._replace(region=poses.region[turned.region])
    return with_more(first, turned, judged, sight)


def challengers(
    accepted: RegionHypotheses, prepared: Prepared, sight: Sight, plan: Schedule
) -> tuple[RegionHypotheses, Judged] | None:
    """Poses that each accepted pose is easily mistaken for, refined and judged; None if there are none. `region` counts
    the accepted ones.

    They are turned about the part's main axes. Where the part repeats itself in all but a small feature, a turned pose
    is right as it is, and rough rounds would only lead it astray; where it repeats some faces, it has to be moved. The
    accepted poses go along, and set the measure of what agrees enough (`Round.behind`).
    """
    turned = turned_about_axes(accepted, prepared.turns).unmet
    moved = shown_at(accepted, turned, prepared, sight.sensor, plan.turned[0].stage.size)
    moved = narrow(joined(accepted.unmet, moved), prepared, sight, plan.turned[:-1], plan)
    closest = best_as_they_are(accepted.unmet, turned, prepared, sight, plan)
    closest = narrow(closest, prepared, sight, plan.turned[-2:-1], plan, [MOST_AS_THEY_ARE + 1])
    both = others_than(accepted, joined(moved, closest), prepared)
    if not len(both.region):
        return None
    return narrow_and_judge(both, prepared, sight, plan.turned[-1:], plan, [MOST_AS_THEY_ARE])


def beside_turned(answer: Interpretation, sight: Sight) -> Interpretation:
    """The interpretation with the turned poses of all accepted ones that fit best as they are.

    Those that an accepted pose met before it was refined last are no match for it any more.
    """
    prepared, accepted = answer.prepared, answer.selection.accepted
    if not len(accepted) or not len(prepared.turns):
        return answer
    plan = plan_of(answer, sight)
    poses = answer.hypotheses.take(accepted)._replace(region=np.arange(len(accepted)))
    turned = turned_about_axes(poses, prepared.turns).unmet
    closest = others_than(poses, best_as_they_are(poses.unmet, turned, prepared, sight, plan), prepared)
    if not len(closest.region):
        return answer
    closest = closest._replace(region=answer.hypotheses.region[accepted][closest.region])
    return with_more(answer, closest, judge(closest, prepared, sight, plan), sight)


def best_as_they_are(
    accepted: RegionHypotheses, turned: RegionHypotheses, prepared: Prepared, sight: Sight, plan: Schedule
) -> RegionHypotheses:
    """The `MOST_AS_THEY_ARE` turned poses of every accepted one (`region`) that agree best without any refinement, fine
    enough to see the small feature that tells them apart; with a depth map of the `MOST_ROUGHLY` that do so in the
    first round's windows. The accepted pose is one more of them.
    """
    symmetries, diameter = prepared.symmetries, prepared.model.diameter
    last = replace(plan.turned[-2], tolerances=plan.turned[-1].tolerances)
    looks = [(plan.turned[0], prepared.rough, MOST_ROUGHLY), (last, prepared.model, MOST_AS_THEY_ARE)]
    found = joined(accepted, turned)
    for step, model, most in looks if sight.kind == "depth" else looks[1:]:
        verdict, _, _ = verify(
            found.poses, model, sight.held_against, sight.sensor.camera, step.tolerances, step.stage.size, plan.jump,
            sight.others,
        )
        score = agreement(verdict)
        kept = best_of_each_region(score, found, most + 1, symmetries, diameter)
        found = found.take(kept[abreast(score, found.region, last.behind)[kept]])
    return found


def others_than(
    accepted: RegionHypotheses, hypotheses: RegionHypotheses, prepared: Prepared
) -> RegionHypotheses:
    """Those that did not come back to the accepted pose that they were turned from (`region`)."""
    return hypotheses.take(np.flatnonzero(~came_back(accepted, hypotheses, prepared)))


def came_back(
    accepted: RegionHypotheses, hypotheses: RegionHypotheses, prepared: Prepared
) -> Bool[np.ndarray, "hypotheses"]:
    """Which of them are nearly the accepted pose that they were turned or moved from (`region`)."""
    R, t = (np.asarray(a, float) for a in hypotheses.poses)
    near = np.zeros(len(t), bool)
    R_own, t_own = (np.asarray(a, float) for a in accepted.poses)
    for k in range(len(t_own)):
        mine = hypotheses.region == k
        apart = same_part_distance(
            R[mine], t[mine], R_own[k], t_own[k], prepared.symmetries, prepared.model.diameter
        )
        near[mine] = apart < NEARLY_SAME * prepared.model.diameter
    return near


def shown_at(
    accepted: RegionHypotheses, turned: RegionHypotheses, prepared: Prepared, sensor: Sensor, size: int
) -> RegionHypotheses:
    """The turned poses, moved so that each shows its surface where the accepted pose did that it was turned from."""
    there = visible_centres(accepted.poses, prepared.rough, sensor.camera, size)
    here = visible_centres(turned.poses, prepared.rough, sensor.camera, size)
    t_cam_obj = turned.poses.t_cam_obj + there[turned.region] - here
    return turned._replace(poses=Hypotheses(turned.poses.R_cam_obj, t_cam_obj))


def with_more(
    answer: Interpretation, more: RegionHypotheses, judged: Judged, sight: Sight
) -> Interpretation:
    """The interpretation with more hypotheses, selected anew."""
    hypotheses = joined(answer.hypotheses, more)
    all_judged = together(answer.judged, judged).with_rivalry(rivalry(hypotheses, answer.prepared))
    return with_selection(replace(answer, hypotheses=hypotheses, judged=all_judged), sight)


def with_selection(answer: Interpretation, sight: Sight) -> Interpretation:
    """The interpretation, its hypotheses selected as soon as that is asked for, were they alone."""
    return replace(answer, select=when_asked(answer.judged, answer.prepared, answer.hypotheses, sight))


def without(answer: Interpretation, index: Int[np.ndarray, "left_out"]) -> Interpretation:
    """The interpretation less some hypotheses; `with_more` selects anew."""
    kept = np.setdiff1d(np.arange(len(answer.hypotheses.region)), index)
    return replace(answer, hypotheses=answer.hypotheses.take(kept), judged=answer.judged.take(kept))


def plan_of(answer: Interpretation, sight: Sight) -> Schedule:
    tree = answer.prepared.tree
    return sight.plan(tree.part.diameter, tree.spacing)

