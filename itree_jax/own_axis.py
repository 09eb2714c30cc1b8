"""How far a part that is nearly of revolution is turned about its own axis: the likeliest of all turns.

Its flat or keyway is all that tells, in a few pixels that half hide, and refinement feels them only from a few degrees
away. So the image is asked at its own resolution, all around, once a pose is accepted.
"""

from dataclasses import replace
from functools import reduce

import numpy as np
from jaxtyping import Float

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
from itree_jax.refinement.nearly_revolved import turns_about
from itree_jax.refinement.schedule import Schedule
from itree_jax.refinement.select import likelihood_ratio
from itree_jax.sight import Sight

STEP = np.radians(5.0)  # of the search all around
FINER = STEP / 4.0 * np.arange(-2, 3)  # beside the likeliest turn: only a depth map lets refinement feel so little
# Turns that are held against the scene at the image's own resolution, of the 72 at half of it: the likeliest of all was
# among them for all of 128 poses, the likeliest rival of 29 too; of two dozen a few were not (experiments/turn_ranks.py).
LIKELY = 36


def turned_to_likeliest(answer: Interpretation, sight: Sight) -> Interpretation:
    """The interpretation with each accepted pose that is in doubt also turned about the part's own axis: to where the
    scene is likeliest, and to the likeliest place that is another pose than that. They compete as they are, too: rough
    steps may take more from an exact pose than they give.

    In doubt is a pose with a rival. Where the flat is seen clearly, the pose that has it right has none; one that has it
    wrong has others, as wrong as it is itself. Parts that are of revolution, or not nearly so, are left alone.
    """
    prepared, selection = answer.prepared, answer.selection
    doubted = np.array([len(others) > 0 for others, _ in selection.rivals], bool)
    accepted = selection.accepted[doubted & ~answer.hypotheses.turned[selection.accepted]]
    if prepared.own_axis is None or not len(accepted):
        return answer
    plan = plan_of(answer, sight)
    poses = answer.hypotheses.take(accepted).unmet._replace(region=np.arange(len(accepted)))
    found = reduce(joined, [
        likeliest_turns(poses.take(np.array([k])), prepared, sight, plan) for k in range(len(accepted))
    ])
    found = joined(found, narrow(found, prepared, sight, plan.turned[-1:], plan))
    found = found._replace(region=answer.hypotheses.region[accepted][found.region])
    turned = answer.hypotheses.turned.copy()
    turned[accepted] = True
    answer = replace(answer, hypotheses=answer.hypotheses._replace(turned=turned))
    return with_more(answer, found, judge(found, prepared, sight, plan), sight)


def likeliest_turns(pose: RegionHypotheses, prepared: Prepared, sight: Sight, plan: Schedule) -> RegionHypotheses:
    """Of a single pose as it is and of all its turns: the one under which the scene is likeliest, turned on a little
    where that makes it likelier still, and the likeliest of those that are another pose.

    All turns are held against the scene at half the image's resolution, which costs a quarter; the likeliest of them,
    and the pose as it is, at its own. A pose that is likeliest as it is needs not be asked again.
    """
    every = turned(pose, STEP * np.arange(round(2.0 * np.pi / STEP)), prepared)
    roughly = likelier_than_first(every, prepared, sight, plan, SIZE // 2)
    by_likelihood = 1 + np.argsort(-roughly[1:], kind="stable")
    every = every.take(np.sort(np.append(by_likelihood[: LIKELY - 1], 0)))
    nats = likelier_than_first(every, prepared, sight, plan)
    first, *second = best_of_each_region(nats, every, 2, prepared.symmetries, prepared.model.diameter)
    close = turned(every.take(np.array([first])), FINER, prepared)
    closest = int(np.argmax(likelier_than_first(close, prepared, sight, plan)))
    stays = np.array([first == 0 and FINER[closest] == 0.0])
    return joined(close.take(np.array([closest]))._replace(turned=stays), every.take(np.array(second, int)))


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
