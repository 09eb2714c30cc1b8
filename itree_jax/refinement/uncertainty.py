"""How far a pose may be off: its covariance, from what the last normal equations say that the image measured.

Twists are (omega [rad], v [mm]) in the camera frame about the part's origin. They are compared as motions of the part's
rim [mm], about its middle: a turn counts by half the diameter, so that nothing depends on where the origin lies.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

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


def twist_covariance(information: Float[np.ndarray, "6 6"], rim: RimMotions) -> Float[np.ndarray, "6 6"]:
    """Covariance of the twist. What nothing measures has a deviation of `FREE` diameters at the rim."""
    values, vectors = rim_information(information, rim)
    vectors = rim.to_twist @ vectors
    return (vectors / np.maximum(values, (FREE * rim.diameter) ** -2)) @ vectors.T


def rim_information(
    information: Float[np.ndarray, "6 6"], rim: RimMotions
) -> tuple[Float[np.ndarray, "6"], Float[np.ndarray, "6 6"]]:
    """Eigenvalues [1 / mm^2], rising, and eigenvectors (columns) of the information on motions of the rim."""
    B = rim.to_twist
    return np.linalg.eigh(B.T @ np.asarray(information, float) @ B)


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


def twist_deviation(information: Float[np.ndarray, "6 6"]) -> Float[np.ndarray, "6"]:
    """Standard deviations of (omega [rad], v [mm]); infinite along directions nothing constrains."""
    values, vectors = np.linalg.eigh(np.asarray(information, float))
    free = values < 1e-9 * max(float(values.max()), 1e-12)
    variance = np.where(free, np.inf, 1.0 / np.maximum(values, 1e-300))
    with np.errstate(invalid="ignore"):
        return np.sqrt(np.nansum(np.where(vectors**2 > 1e-12, vectors**2 * variance, 0.0), axis=1))
