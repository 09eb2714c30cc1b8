"""Hypotheses against what was seen: rounds of refining and verifying, and the last judgement pixel by pixel."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool

from itree_jax.prepared import Prepared
from itree_jax.refinement.ambiguity import same_place
from itree_jax.refinement.hypotheses import (
    RegionHypotheses,
    abreast,
    agreement,
    best_of_each_region,
    covered,
    rough_share,
)
from itree_jax.refinement.likelihood import support
from itree_jax.refinement.optimise import RefineModel, refine
from itree_jax.refinement.schedule import Round, Schedule
from itree_jax.refinement.select import Judged
from itree_jax.refinement.verify import Verdict, verify
from itree_jax.sight import Sight


def narrow(
    hypotheses: RegionHypotheses, prepared: Prepared, sight: Sight, rounds: Sequence[Round], plan: Schedule,
    keep: Sequence[int] | None = None,
) -> RegionHypotheses:
    """Rounds of refining, verifying and keeping the best of every region: as many as `keep` says, or the plan.

    Rough rounds take what the sight has for them, and of the part what `rough_model_for` says.
    """
    return _narrowed(hypotheses, prepared, sight, rounds, plan, keep)[0]


def narrow_and_judge(
    hypotheses: RegionHypotheses, prepared: Prepared, sight: Sight, rounds: Sequence[Round], plan: Schedule,
    keep: Sequence[int] | None = None,
) -> tuple[RegionHypotheses, Judged]:
    """The same, and the last judgement of what is kept. The last of the `rounds` is the plan's: it has counted already.
    """
    hypotheses, verdict = _narrowed(hypotheses, prepared, sight, rounds, plan, keep)
    return hypotheses, judge(hypotheses, prepared, sight, plan, verdict)


def _narrowed(
    hypotheses: RegionHypotheses, prepared: Prepared, sight: Sight, rounds: Sequence[Round], plan: Schedule,
    keep: Sequence[int] | None,
) -> tuple[RegionHypotheses, Verdict]:
    """What is left, and what the last round counted of it."""
    symmetries, diameter, camera = prepared.symmetries, prepared.model.diameter, sight.sensor.camera
    verdict = None
    for k, step in enumerate(rounds):
        rough = step.stage.size < plan.rounds[-2].stage.size
        observed = sight.roughly_held_against if rough else sight.held_against
        model = rough_model_for(sight, prepared) if rough else prepared.model
        poses = refine(
            hypotheses.poses, model, observed, camera, plan.deviations, [step.stage], plan.jump, sight.others,
            sight.crease,
        )
        hypotheses = hypotheses._replace(poses=poses)
        edges = plan.jump if step.stage.contour else None
        verdict, _, stride = verify(
            poses, model, observed, camera, step.tolerances, step.stage.size, edges, sight.others
        )
        if step.stage.contour:
            score = agreement(verdict)
        else:
            pixels = stride**2 / (1.0 + len(sight.others))
            score = rough_share(verdict) * covered(verdict, sight.found.area_px[hypotheses.region] / pixels)
        most = keep[k] if keep else step.keep
        kept = best_of_each_region(score, hypotheses, most, symmetries, diameter)
        kept = kept[abreast(score, hypotheses.region, step.behind)[kept]]
        hypotheses, verdict = hypotheses.take(kept), verdict.take(kept)
    if verdict is None:
        raise ValueError("narrow needs at least one round")
    return hypotheses, verdict


def rough_model_for(sight: Sight, prepared: Prepared) -> RefineModel:
    """What rough rounds take for the part: where depth tells, coarse triangles and contours halfway between pixels do;
    without a depth map contours are most of what tells poses apart.
    """
    return prepared.rough if sight.kind == "depth" else prepared.model


def judge(
    hypotheses: RegionHypotheses, prepared: Prepared, sight: Sight, plan: Schedule, verdict: Verdict | None = None
) -> Judged:
    """The last verification of all hypotheses: counts, and the likelihood of every pixel. `verdict`: the counts, if
    they are known already.
    """
    model, camera, sensor = prepared.model, sight.sensor.camera, sight.sensor
    if verdict is None:
        verdict, _, _ = verify(
            hypotheses.poses, model, sight.held_against, camera, plan.rounds[-1].tolerances, plan.verify_size,
            plan.jump, sight.others,
        )
    weighed = support(
        hypotheses.poses, model, sight.held_against, camera, plan.errors, plan.jump, sight.others, crease=sight.crease
    )
    return Judged(verdict, weighed, sensor.smallest_region / sensor.mm_per_px**2, rivalry(hypotheses, prepared))


def rivalry(hypotheses: RegionHypotheses, prepared: Prepared) -> Bool[np.ndarray, "hypotheses hypotheses"]:
    """Which hypotheses are other poses of the same place."""
    R, t = (np.asarray(a, float) for a in hypotheses.poses)
    return same_place(R, t, prepared.symmetries, prepared.model.diameter)
