"""How far a pose may be off: its covariance, from what the last normal equations say that the image measured.

Twists are (omega [rad], v [mm]) in the camera frame about the part's origin. They are compared as motions of the part's
rim [mm], about its middle: a turn counts by half the diameter, so that nothing depends on where the origin lies.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

LOST = 0.05  # of the diameter at the rim: a pose that is off by more is a wrong one (MSSD), so this deviation is none
FREE = 100.0  # diameters: the deviation stated for what nothing measures; the rest stays exact beside it in float64

Axis = tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]  # unit direction, point on it [mm], model frame


@dataclass(frozen=True)
class RimMotions:
    """Motions of the rim [mm] <-> twists of a part."""

    diameter: float  # [mm]
    middle_cam: Float[np.ndarray, "3"]  # from the part's origin to its middle, camera frame [mm]

    @property
    def to_twist(self) -> Float[np.ndarray, "6 6"]:
        """Twist of each unit motion: about the camera's axes through the middle, and along them."""
        B = np.diag(np.repeat([2.0 / self.diameter, 1.0], 3))
        x, y, z = self.middle_cam
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        B[3:, :3] = cross * 2.0 / self.diameter  # v of the origin = v of the middle + middle x omega
        return B

    @property
    def from_twist(self) -> Float[np.ndarray, "6 6"]:
        return np.linalg.inv(self.to_twist)


def rim_motions(vertices: Float[np.ndarray, "n 3"], diameter: float, R_cam_obj: Float[np.ndarray, "3 3"]) -> RimMotions:
    """Of a part at its pose; its middle is that of its bounding box."""
    X = np.asarray(vertices, float)
    return RimMotions(diameter, R_cam_obj @ (0.5 * (X.min(axis=0) + X.max(axis=0))))


@dataclass(frozen=True)
class RimUncertainty:
    """What is known of the motions of the rim. `vectors` are orthonormal columns."""

    vectors: Float[np.ndarray, "6 6"]
    lost: Bool[np.ndarray, "6"]  # directions that nothing measures
    covariance: Float[np.ndarray, "6 6"]  # [mm^2]


def rim_uncertainty(
    information: Float[np.ndarray, "6 6"], spread: Float[np.ndarray, "6 6"], rim: RimMotions, least: float = LOST
) -> RimUncertainty:
    """Covariance of the motions of the rim, and which of them nothing measures.

    Each pixel's weight allows for what it shares with all others, so that the information alone knows every direction
    too badly by a factor of some 5: what it can't tell to `least` diameters nothing tells. (What little it has there
    stems from facets and pixels, so that the deviation stays as large as it says.) In the other directions errors count
    as they act: information^-1 spread information^-1.
    """
    B = rim.to_twist
    values, vectors = np.linalg.eigh(B.T @ np.asarray(information, float) @ B)
    lost = values < (least * rim.diameter) ** -2
    pull = np.where(lost, 0.0, 1.0 / np.where(lost, 1.0, values))
    blind = np.where(lost, 1.0 / np.maximum(values, (FREE * rim.diameter) ** -2), 0.0)
    inside = vectors.T @ B.T @ np.asarray(spread, float) @ B @ vectors * np.outer(pull, pull)
    return RimUncertainty(vectors, lost, vectors @ (inside + np.diag(blind)) @ vectors.T)


def twist_covariance(uncertain: RimUncertainty, rim: RimMotions) -> Float[np.ndarray, "6 6"]:
    """Covariance of the twist. What nothing at all measures has a deviation of `FREE` diameters at the rim."""
    return rim.to_twist @ uncertain.covariance @ rim.to_twist.T


def twist_deviation(uncertain: RimUncertainty, rim: RimMotions) -> Float[np.ndarray, "6"]:
    """Standard deviations of (omega [rad], v [mm]); infinite along directions nothing at all constrains."""
    covariance = twist_covariance(uncertain, rim)
    free = np.sqrt(np.diag(uncertain.vectors.T @ uncertain.covariance @ uncertain.vectors)) > 0.5 * FREE * rim.diameter
    share = np.square(rim.to_twist @ uncertain.vectors[:, free]).sum(axis=1) / np.square(rim.to_twist).sum(axis=1)
    return np.where(share > 1e-12, np.inf, np.sqrt(np.diag(covariance)))


def without_free_turns(
    information: Float[np.ndarray, "6 6"], axes: Sequence[Axis], R_cam_obj: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "6 6"]:
    """Takes turns about the part's axes of revolution out: nothing measures them, whatever facets and noise say."""
    for axis, point in axes:
        twist = turn_about(R_cam_obj @ axis, R_cam_obj @ point)
        twist = twist / np.linalg.norm(twist)
        keep = np.eye(6) - np.outer(twist, twist)
        information = keep @ information @ keep
    return information


def turn_about(direction: Float[np.ndarray, "3"], point: Float[np.ndarray, "3"]) -> Float[np.ndarray, "6"]:
    """The twist of a turn by 1 rad about a line through `point` [mm], which is seen from the part's origin."""
    return np.concatenate([direction, -np.cross(direction, point)])
