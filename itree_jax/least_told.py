"""Accepted poses are challenged by themselves, moved the ways of which the scene tells least.

A block slides along its own length until an end meets another part's edge; a rocker rolls in its own curvature. Needles
and depth stay much the same, the contour that would pull it back is out of reach, and no turn about a main axis leads
there. So each accepted pose is moved both ways along the motions of its rim that its normal equations know least,
refined and judged.
"""

import numpy as np
from itree_cad.symmetry import Symmetries
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from itree_jax.answers import Interpretation, measured_by
from itree_jax.challenge import came_back, plan_of, with_more
from itree_jax.narrowing import narrow_and_judge
from itree_jax.refinement.optimise import Hypotheses
from itree_jax.refinement.uncertainty import RimMotions, without_free_turns
from itree_jax.sight import Sight

MOTIONS = 2  # of the six: a face leaves two slides, and a cylinder a slide and a turn
FAR = (0.03, 0.06, 0.12)  # of the diameter, at the rim: refinement comes back from less, and reaches on beyond the last
KEEP = (4, 2)  # of an answer's moved poses after each round


def moved_along_least_told(answer: Interpretation, sight: Sight) -> Interpretation:
    """The interpretation with each accepted pose also moved along what is told least of it.

    What comes back to nearly the accepted pose is kept where it is likelier: refinement stops at more than one place.
    """
    prepared, accepted = answer.prepared, answer.selection.accepted
    if not len(accepted):
        return answer
    plan, diameter = plan_of(answer, sight), prepared.tree.part.diameter
    own = answer.hypotheses.take(accepted)._replace(region=np.arange(len(accepted)))
    moved = [
        moved_poses(R, t, least_told(information, R, prepared.symmetries, diameter), diameter)
        for R, t, information in zip(*(np.asarray(a, float) for a in own.poses), measured_by(answer, sight)[0],
                                     strict=True)
    ]  # fmt: skip
    found = own.take(np.repeat(own.region, len(moved[0].t_cam_obj)))
    poses = Hypotheses(*(np.concatenate(values).astype(np.float32) for values in zip(*moved, strict=True)))
    found = found.unmet._replace(poses=poses)
    found, judged = narrow_and_judge(found, prepared, sight, plan.turned[-2:], plan, KEEP)
    likelier = judged.log_likelihood > answer.judged.log_likelihood[accepted][found.region]
    new = np.flatnonzero(likelier | ~came_back(own, found, prepared))
    if not len(new):
        return answer
    found = found._replace(region=answer.hypotheses.region[accepted][found.region])
    return with_more(answer, found.take(new), judged.take(new), sight)


def least_told(
    information: Float[np.ndarray, "6 6"], R_cam_obj: Float[np.ndarray, "3 3"], symmetries: Symmetries, diameter: float
) -> Float[np.ndarray, "motions 6"]:
    """The `MOTIONS` twists, each of a rim that moves by 1 mm, that the information knows least; turns about the part's
    axes of revolution, which change nothing, left out.
    """
    rim = RimMotions(diameter, np.zeros(3))
    measured = without_free_turns(np.asarray(information, float), symmetries.continuous, R_cam_obj)
    _, vectors = np.linalg.eigh(rim.to_twist.T @ measured @ rim.to_twist)
    free = len(symmetries.continuous)
    return (rim.to_twist @ vectors[:, free : free + MOTIONS]).T


def moved_poses(
    R_cam_obj: Float[np.ndarray, "3 3"], t_cam_obj: Float[np.ndarray, "3"], twists: Float[np.ndarray, "motions 6"],
    diameter: float,
) -> Hypotheses:
    """The pose moved both ways along every twist, by each of `FAR`."""
    far = diameter * np.outer([1.0, -1.0], FAR).ravel()
    motion = (twists[:, None] * far[:, None]).reshape(-1, 6)
    turns = Rotation.from_rotvec(motion[:, :3]).as_matrix()
    return Hypotheses(turns @ R_cam_obj, t_cam_obj + motion[:, 3:])
