"""From accepted hypotheses to answers: poses with their deviations, equivalents, counts and decision paths."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from itree_jax.batches import on_all_cores
from itree_jax.decision_path import decision_path, verification_step
from itree_jax.detections import Alternative, Detection
from itree_jax.features.region import RegionFeatures
from itree_jax.prepared import Prepared
from itree_jax.refinement.ambiguity import rivals
from itree_jax.refinement.hypotheses import RegionHypotheses
from itree_jax.refinement.pose_information import equations_at
from itree_jax.refinement.scoring import SCORINGS
from itree_jax.refinement.select import Judged, Selection
from itree_jax.refinement.uncertainty import (
    RimMotions,
    rim_motions,
    rim_uncertainty,
    twist_covariance,
    twist_deviation,
    without_free_turns,
)
from itree_jax.refinement.unobservable import unobservable
from itree_jax.root_answer import RootAnswer, root_steps
from itree_jax.sensing.regions import Regions
from itree_jax.sight import Sight
from itree_jax.tree.classify import Classification
from itree_jax.tree.root import Root
from itree_jax.tree.tree import InterpretationTree


@dataclass(frozen=True)
class Interpretation:
    """What one tree makes of the regions of one image that it is asked for."""

    prepared: Prepared
    part: int  # place of the tree in its forest
    asked: Int[np.ndarray, "asked"]  # regions, rising; rows of `features` and `classification`
    features: RegionFeatures
    classification: Classification
    hypotheses: RegionHypotheses  # refined; those that reached the last verification
    judged: Judged
    select: Callable[[], Selection]  # once it is asked for: what competes anew at once is not
    found: Regions  # that hypotheses count by
    said: RootAnswer  # of these regions

    @property
    def selection(self) -> Selection:
        """Which hypotheses are accepted, and why each of the others is not."""
        return self.select()

    def selected(self, selection: Selection) -> "Interpretation":
        """The same hypotheses, of which others are accepted."""
        return replace(self, select=lambda: selection)

    def row_of(self, region: int) -> int:
        """Of a region that was asked for."""
        return int(np.searchsorted(self.asked, region))


def describe(answers: Sequence[Interpretation], root: Root, sight: Sight) -> tuple[Detection, ...]:
    """Accepted hypotheses of all trees as detections, the highest region offered first."""
    refinement = SCORINGS[sight.kind].refinement
    measured = on_all_cores(lambda answer: measured_by(answer, sight), answers)
    detections = [
        describe_one(answer, int(h), root, information, spread, refinement)
        for answer, of_poses in zip(answers, measured, strict=True)
        for h, information, spread in zip(answer.selection.accepted, *of_poses, strict=True)
    ]
    order = sorted(range(len(detections)), key=lambda k: (-detections[k].height, -detections[k].score))
    rank = {k: position for position, k in enumerate(order)}
    return tuple(replace(d, offer_rank=rank[k]) for k, d in enumerate(detections))


def measured_by(
    answer: Interpretation, sight: Sight
) -> tuple[Float[np.ndarray, "accepted 6 6"], Float[np.ndarray, "accepted 6 6"]]:
    """What the scene measures of the accepted poses: information and spread, as in `information.Measured`."""
    tree, accepted = answer.prepared.tree, answer.selection.accepted
    if not len(accepted):
        return np.zeros((0, 6, 6)), np.zeros((0, 6, 6))
    plan = sight.plan(tree.part.diameter, tree.spacing)
    equations = equations_at(
        answer.hypotheses.take(accepted).poses, answer.prepared.model, sight.measured_against, sight.sensor.camera,
        plan.deviations, plan.rounds[-1].stage, plan.jump, sight.others, sight.crease,
    )
    return np.asarray(equations.information), np.asarray(equations.spread)


def describe_one(
    answer: Interpretation, h: int, root: Root, information: Float[np.ndarray, "6 6"],
    spread: Float[np.ndarray, "6 6"], refinement: float,
) -> Detection:
    """One accepted hypothesis, with the other poses of its place that the scene hardly tells from it."""
    prepared, tree, selection = answer.prepared, answer.prepared.tree, answer.selection
    region = int(answer.hypotheses.region[h])
    R_all, t_all = (np.asarray(a, float) for a in answer.hypotheses.poses)
    weight = answer.judged.log_likelihood
    others, margins = selection.rivals[list(selection.accepted).index(h)]
    other, share = rivals(others, margins, R_all, t_all, prepared.symmetries, tree.part.diameter, refinement)
    margin = margins[np.isin(others, other)].tolist()
    R_all, t_all = prepared.of_object(answer.hypotheses.poses)
    alternatives = tuple(
        Alternative(pose_matrix(nearest_rotation(R_all[k]), t_all[k]), float(s))
        for k, s in zip(other, share, strict=True)
    )
    R, t = nearest_rotation(R_all[h]), t_all[h]
    turns = tree.symmetries.continuous
    rim = rim_motions(tree.part.vertices, tree.part.diameter, R)
    information, spread = (
        without_free_turns(np.asarray(e, float), prepared.symmetries.continuous, R) for e in (information, spread)
    )
    uncertain = rim_uncertainty(information, spread, RimMotions(tree.part.diameter, np.zeros(3)))
    std = twist_deviation(uncertain, rim)
    seen = answer.judged.support
    pixels = seen.stride**2  # image pixels that a window pixel stands for
    path = (
        *root_steps(root, answer.said, region, answer.part),
        *decision_path(tree, answer.classification, answer.row_of(region), int(answer.hypotheses.row[h])),
    )
    return Detection(
        scene_id=0,
        im_id=0,
        obj_id=tree.obj_id,
        score=float(selection.score[h]),
        R_cam_obj=R,
        t_cam_obj=t,
        decision_path=(*path, verification_step(tree, float(weight[h]), weight[other].tolist(), margin, alternatives)),
        agreeing=int((seen.pixels[h] > 0).sum()) * pixels,
        contradicting=int((seen.pixels[h] < 0).sum()) * pixels,
        hidden=int(seen.hidden[h].sum()) * pixels,
        height=float(answer.found.height[region]),
        rotation_std=std[:3],
        translation_std=std[3:],
        equivalents=equivalents(tree, R, t),
        covariance=twist_covariance(uncertain, rim),
        unobservable=unobservable(uncertain, rim, turns, R, t),
        alternatives=alternatives,
    )


def equivalents(
    tree: InterpretationTree, R_cam_obj: Float[np.ndarray, "3 3"], t_cam_obj: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "4 4"], ...]:
    """The other poses that look the same, by the part's discrete symmetries."""
    T_cam_obj = pose_matrix(R_cam_obj, t_cam_obj)
    return tuple(T_cam_obj @ turn for turn in np.asarray(tree.symmetries.discrete)[1:])


def pose_matrix(R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
    """Rotation and translation [mm] as one matrix."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    return T


def nearest_rotation(R: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """Takes the rounding of many float32 products out of a rotation."""
    U, _, Vt = np.linalg.svd(R)
    return U @ Vt


def best_reason(answers: Sequence[Interpretation], region: int) -> str:
    """Why no hypothesis of a region was accepted: that of its best one."""
    reasons = [
        (float(a.selection.score[h]), a.selection.reason[h])
        for a in answers for h in np.flatnonzero(a.hypotheses.region == region)
    ]
    return max(reasons)[1] if reasons else ""
