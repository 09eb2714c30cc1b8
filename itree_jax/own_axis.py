"""How far a part that is nearly of revolution is turned about its own axis: the likeliest of all turns.

Its flat or keyway is all that tells, in a few pixels that half hide, and refinement feels them only from a few degrees
away. So the image is asked at its own resolution, all around, once a pose is accepted.
"""

from dataclasses import replace
from functools import reduce

import numpy as np
from jaxtyping import Bool, Float

from itree_jax.answers import Interpretation
from itree_jax.challenge import plan_of, with_more
from itree_jax.narrowing import judge, narrow
from itree_jax.prepared import Prepared
from itree_jax.refinement.hypotheses import (
    RegionHypotheses,
    best_of_each_region,
    joined,
    turned_about_axes,
)
from itree_jax.refinement.likelihood import SIZE, support
from itree_jax.refinement.nearly_revolved import Axis, turns_about
from itree_jax.refinement.schedule import Schedule
from itree_jax.refinement.select import NO_RIVAL, likelihood_ratio
from itree_jax.sight import Sight

STEP = np.radians(5.0)  # of the search all around
FINER = STEP / 4.0 * np.arange(-2, 3)  # beside the likeliest turn: only a depth map lets refinement feel so little
# Turns that are held against the scene at the image's own resolution, of the 72 at half of it: of 45 of 46 poses the
# likeliest turn of all was among them, of one another turn by 1.4 nats less likely (experiments/turn_ranks.py).
LIKELY = 24
SAME_AXIS = float(np.cos(np.radians(15.0)))  # a turn that is refined roughly tilts by some degrees


def turned_to_likeliest(answer: Interpretation, sight: Sight) -> Interpretation:
    """The interpretation with each accepted pose that is in doubt also turned about the part's own axis: to where the
    scene is likeliest, and to the likeliest place that is another pose than that. They compete as they are, too: rough
    steps may take more from an exact pose than they give.

    Parts that are of revolution, or not nearly so, are left alone, and so are poses that are not in doubt.
    """
    prepared, accepted = answer.prepared, answer.selection.accepted
    if prepared.own_axis is None or not len(accepted):
        return answer
    accepted = accepted[in_doubt(answer, prepared.own_axis) & ~answer.hypotheses.turned[accepted]]
    if not len(accepted):
        return answer
    plan = plan_of(answer, sight)
    poses = answer.hypotheses.take(accepted).unmet._replace(region=np.arange(len(accepted)))
    found = reduce(joined, [
        likeliest_turns(poses.take(np.array([k])), prepared, sight, plan) for k in range(len(accepted))
    ])
    turned = answer.hypotheses.turned.copy()
    turned[accepted] = True
    answer = replace(answer, hypotheses=answer.hypotheses._replace(turned=turned))
    if not len(found.region):
        return answer
    found = joined(found, narrow(found, prepared, sight, plan.turned[-1:], plan))
    found = found._replace(region=answer.hypotheses.region[accepted][found.region])
    return with_more(answer, found, judge(found, prepared, sight, plan), sight)


def in_doubt(answer: Interpretation, axis: Axis) -> Bool[np.ndarray, "accepted"]:
    """Which accepted poses have a rival that has the part's own axis where they have it.

    Where the flat is seen clearly, the pose that has it right has none; one that has it wrong has others, as wrong as
    it is itself.
    """
    along = np.asarray(answer.hypotheses.poses.R_cam_obj, float) @ axis[0]
    selection = answer.selection
    return np.array([
        (along[others] @ along[h] > SAME_AXIS).any()
        for h, (others, _) in zip(selection.accepted, selection.rivals, strict=True)
    ], bool)  # fmt: skip


def likeliest_turns(pose: RegionHypotheses, prepared: Prepared, sight: Sight, plan: Schedule) -> RegionHypotheses:
    """What of all turns of a single pose competes with it: the one under which the scene is likeliest, turned on a
    little where that makes it likelier still, if that is not the pose as it is; and the likeliest of those that are
    another pose than that, if it is a rival.

    All turns are held against the scene at half the image's resolution, which costs a quarter; the likeliest of them,
    and the pose as it is, at its own.
    """
    every = turned(pose, STEP * np.arange(round(2.0 * np.pi / STEP)), prepared)
    roughly = likelier_than_first(every, prepared, sight, plan, SIZE // 2)
    by_likelihood = 1 + np.argsort(-roughly[1:], kind="stable")
    every = every.take(np.sort(np.append(by_likelihood[: LIKELY - 1], 0)))
    nats = likelier_than_first(every, prepared, sight, plan)
    first, *second = best_of_each_region(nats, every, 2, prepared.symmetries, prepared.model.diameter)
    close = turned(every.take(np.array([first])), FINER, prepared)
    closest = int(np.argmax(likelier_than_first(close, prepared, sight, plan)))
    close = close.take(np.array([closest]))._replace(turned=np.array([first == 0]))  # all around was asked then
    stays = first == 0 and FINER[closest] == 0.0
    rivals = [k for k in second if nats[k] > nats[first] - NO_RIVAL]
    return joined(close.take(np.arange(0 if stays else 1)), every.take(np.array(rivals, int)))


def turned(pose: RegionHypotheses, angles: Float[np.ndarray, "turns"], prepared: Prepared) -> RegionHypotheses:
    """A single pose turned about the part's own axis."""
    assert prepared.own_axis is not None
    return turned_about_axes(pose, turns_about(prepared.own_axis, angles))


def likelier_than_first(
    poses: RegionHypotheses, prepared: Prepared, sight: Sight, plan: Schedule, size: int = SIZE
) -> Float[np.ndarray, "poses"]:
    """How much likelier each pose makes the scene than the first one [nats], in windows of this size."""
    weighed = support(
        poses.poses, prepared.model, sight.held_against, sight.sensor.camera, plan.errors, plan.jump, sight.others,
        size, sight.crease,
    )
    return np.array([likelihood_ratio(weighed, k, 0) for k in range(len(poses.region))])
