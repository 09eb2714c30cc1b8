"""How good a free grasp is: sure of its pose, clear of everything else, well held, high."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.special import erf

from itree_jax.detections import Detection
from itree_jax.grasp.candidate import Candidate
from itree_jax.grasp.candidates import quality
from itree_jax.grasp.gripper import Gripper, Jaw

HALF_CLEAR = 2.0  # [mm] of clearance that counts half: a robot's own error is some tenths of that
LOWEST = 0.5  # factor of a grasp at the floor against the highest one: the paper takes the highest first
RIM_SHARE = 0.1  # of the cup's diameter, by which its place may be off: `cup_candidates.EDGE` of a small cup

Axis = tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]  # of revolution: unit direction, point [mm], part's frame


def score(
    detection: Detection, candidate: Candidate, gripper: Gripper, clearance: float, height: float, highest: float,
    diameter: float, axes: Sequence[Axis] = (),
) -> float:
    """0 to 1, a product: the answer's own score, which its alternative poses have taken their share of; the
    probability that the open jaw (or the cup) comes down where the part is, by the pose's covariance; the clearance
    [mm], half at 2 mm; how much of the pads touches and how far from the centre of mass; and the height [mm] of the
    grasp above the floor, half at the floor.
    """
    sure = fits(detection, candidate, gripper, axes)
    room = clearance / (clearance + HALF_CLEAR)
    high = LOWEST + (1.0 - LOWEST) * float(np.clip(height / highest, 0.0, 1.0)) if highest > 0 else 1.0
    return float(detection.score * sure * room * quality(candidate, diameter) * high)


def fits(detection: Detection, candidate: Candidate, gripper: Gripper, axes: Sequence[Axis] = ()) -> float:
    """Probability that the part is within the open jaw, by how far each finger opens beyond it; of a cup, that it comes
    down within a tenth of its diameter. 1 when the pose's covariance isn't known.
    """
    if detection.covariance is None:
        return 1.0
    R_cam_grasp = detection.R_cam_obj @ candidate.T_obj_grasp[:3, :3]
    spread = R_cam_grasp.T @ place_covariance(detection, candidate, axes) @ R_cam_grasp
    if isinstance(gripper.tool, Jaw):
        variance, margin = spread[0, 0], gripper.tool.open_by
    else:
        variance, margin = np.linalg.eigvalsh(spread[:2, :2])[-1], RIM_SHARE * gripper.tool.diameter
    return float(erf(margin / np.sqrt(2.0 * max(float(variance), 1e-12))))


def place_covariance(
    detection: Detection, candidate: Candidate, axes: Sequence[Axis] = ()
) -> Float[np.ndarray, "3 3"]:
    """Covariance [mm^2] of where the part's point at the grasp is, camera frame: v + omega x p with p from the part's
    origin. Turns about the part's axes of revolution are left out: they change nothing.
    """
    assert detection.covariance is not None
    R = detection.R_cam_obj
    C = detection.covariance
    for axis, point in axes:
        turn = np.concatenate([R @ axis, -np.cross(R @ axis, R @ point)])
        turn = turn / np.linalg.norm(turn)
        keep = np.eye(6) - np.outer(turn, turn)
        C = keep @ C @ keep
    x, y, z = R @ candidate.T_obj_grasp[:3, 3]
    J = np.concatenate([np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]), np.eye(3)], axis=1)  # omega x p, and v
    return J @ C @ J.T
