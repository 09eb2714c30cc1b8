"""The last word on accepted poses: each is challenged, turned about its own axis, and polished."""

from collections.abc import Callable
from dataclasses import replace
from functools import reduce

import numpy as np

from itree_jax.answers import Interpretation
from itree_jax.batches import on_all_cores
from itree_jax.challenge import beside_turned, challenged, plan_of, with_more, without
from itree_jax.competition import compete
from itree_jax.least_told import moved_along_least_told
from itree_jax.narrowing import judge
from itree_jax.own_axis import turned_to_likeliest
from itree_jax.refinement.hypotheses import joined
from itree_jax.refinement.optimise import Hypotheses, refine
from itree_jax.refinement.pose_distance import same_part_distance
from itree_jax.sight import Sight

CHALLENGES = 2  # a winner that its place owes to a challenge may have to stand one more
ARRIVED = 1.0  # [nats]: what gains less by being polished is there; two refinements of one pose differ by more
TURNS = 2  # how far a part is turned about its own axis is told better by a pose that was polished since


def settled(answers: list[Interpretation], sight: Sight) -> list[Interpretation]:
    """Accepted poses that nothing near them beats, at the image's own resolution."""
    for _ in range(CHALLENGES):
        more = each(challenged, answers, sight)
        if all(new is old for new, old in zip(more, answers, strict=True)):
            break
        answers = compete(more, sight)
    for step in (polished, beside_turned, polished):
        answers = compete(each(step, answers, sight), sight)
    if sight.kind != "depth":
        moved = compete(each(moved_along_least_told, answers, sight), sight)
        answers = compete(each(polished, moved, sight), sight)
    for _ in range(TURNS):
        before = sum(len(answer.hypotheses.region) for answer in answers)
        turned = each(turned_to_likeliest, answers, sight)
        if sum(len(answer.hypotheses.region) for answer in turned) == before:
            break
        answers = compete(each(polished, compete(turned, sight), sight), sight)
    return answers


def each(
    step: Callable[[Interpretation, Sight], Interpretation], answers: list[Interpretation], sight: Sight
) -> list[Interpretation]:
    """The step for every reading, side by side: while the host sorts the poses of one, kernels refine another's."""
    return on_all_cores(lambda answer: step(answer, sight), answers)


def polished(answer: Interpretation, sight: Sight) -> Interpretation:
    """The accepted poses and their rivals, refined once more at the image's own resolution.

    How far neighbours' errors hang together no depth map tells. So the last step takes them to be independent, and is
    kept where the pose explains the scene better than before; each pose takes it but once. Without a depth map it takes
    the poses to where they stop, until it gains less than `ARRIVED`: what else two of them differ by would be held for
    evidence (experiments/refinement_nats.py). There it goes another way too, by contours: a highlight turns a face's
    needles and moves its matched depth, but not its edges.
    """
    plan, tried = plan_of(answer, sight), answer.selection.with_rivals
    tried = tried[~answer.hypotheses.polished[tried]]
    if not len(tried):
        return answer
    before = answer.hypotheses.take(tried)
    ways = [(plan.last, plan.independent), *([plan.by_contours] if plan.by_contours else [])]
    after = reduce(joined, [
        before._replace(poses=refine(
            before.poses, answer.prepared.model, sight.held_against, sight.sensor.camera, deviations, stages,
            plan.jump, sight.others, sight.crease,
        )) for stages, deviations in ways
    ])  # fmt: skip
    judged = judge(after, answer.prepared, sight, plan)
    nats = np.concatenate([answer.judged.log_likelihood[tried], judged.log_likelihood]).reshape(-1, len(tried))
    best = nats.argmax(axis=0)  # 0: as it was
    arrived = (nats.max(axis=0) < nats[0] + ARRIVED) | (sight.kind == "depth")
    polished = answer.hypotheses.polished.copy()
    polished[tried] = arrived
    answer = replace(answer, hypotheses=answer.hypotheses._replace(polished=polished))
    moved = np.flatnonzero(best)
    better = (best[moved] - 1) * len(tried) + moved
    polished_after = after.take(better)._replace(polished=arrived[moved])
    return with_more(without(answer, tried[moved]), polished_after, judged.take(better), sight)


def exact(answers: list[Interpretation], sight: Sight) -> list[Interpretation]:
    """The accepted poses where a depth map has them most exactly, once it is settled which are right.

    A depth camera errs along its rays, so that pixels of slanted surfaces count for more (`residuals.variance_across`).
    What tells poses apart reckons with needles too, pixel by pixel, and may hold a pose that follows depth for less
    likely than one a little beside it: this step asks no likelihood, and moves no pose by more than a pixel's depth is
    off by.
    """
    return each(moved_exactly, answers, sight)


def moved_exactly(answer: Interpretation, sight: Sight) -> Interpretation:
    """See `exact`."""
    plan, accepted = plan_of(answer, sight), answer.selection.accepted
    if plan.exact is None or not len(accepted):
        return answer
    stage, deviations = plan.exact
    prepared, model, hypotheses = answer.prepared, answer.prepared.model, answer.hypotheses
    before = hypotheses.take(accepted).poses
    after = refine(
        before, model, sight.held_against, sight.sensor.camera, deviations, [stage], plan.jump, sight.others,
        sight.crease,
    )
    near = np.array([
        same_part_distance(R[None], t[None], R_before, t_before, prepared.symmetries, model.diameter)[0] < sight.noise
        for R, t, R_before, t_before in zip(*after, *before, strict=True)
    ])
    R, t = (np.array(pose) for pose in hypotheses.poses)
    R[accepted[near]], t[accepted[near]] = after.R_cam_obj[near], after.t_cam_obj[near]
    selection = answer.selection
    return replace(answer, hypotheses=hypotheses._replace(poses=Hypotheses(R, t)), select=lambda: selection)
