"""From many verified poses to one per part: each pixel belongs to one pose, the best explained pose chooses first."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

ACCEPT = 0.5  # share of its visible pixels that an answer must explain alone: more than any rival can
CONTRADICTED = 0.15  # share of them behind which the scene is seen: pixels at the outline of a small part make a tenth


@dataclass(frozen=True)
class Verified:
    """A pose and what the depth map says to the pixels that the model would cover in it."""

    T_cam_obj: Float[np.ndarray, "4 4"]
    explained: Int[np.ndarray, "pixels"]  # indices of those where depth and normal agree
    predicted: int  # pixels of the model, seen alone
    contradicted: int  # of them, where the scene is behind

    @property
    def score(self) -> float:
        """Share of the model's visible pixels that the depth map explains."""
        return len(self.explained) / max(self.predicted, 1)


def selected(
    poses: list[Verified], accept: float = ACCEPT, contradicted: float = CONTRADICTED
) -> list[tuple[Verified, float]]:
    """The poses that hold against each other, with their scores, best first.

    Again and again the pose that explains most of itself by pixels that no better pose has taken is accepted, until
    that share is under `accept`: suppression of duplicates and of poses that share space with a better one.
    """
    left = [pose for pose in poses if pose.contradicted <= contradicted * pose.predicted]
    chosen: list[tuple[Verified, float]] = []
    taken = np.zeros(0, dtype=np.int64)
    while left:
        shares = [len(np.setdiff1d(p.explained, taken, assume_unique=True)) / max(p.predicted, 1) for p in left]
        best = int(np.argmax(shares))
        if shares[best] < accept:
            break
        chosen.append((left[best], shares[best]))
        taken = np.union1d(taken, left[best].explained)
        left = [pose for k, pose in enumerate(left) if k != best and shares[k] >= accept]
    return chosen


def agreement(
    predicted_z: Float[np.ndarray, "n"],
    predicted_normal: Float[np.ndarray, "n 3"],
    z: Float[np.ndarray, "n"],
    normal: Float[np.ndarray, "n 3"],
    tolerance: float,
    angle: float = 30.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Per pixel of the model whether the depth map explains it, and whether it contradicts it (the scene is behind).

    Distances [mm] are taken along the model's normal, `angle` [deg] is between the normals; z = 0 says nothing. Neither
    is true where something else is in front.
    """
    slant = np.clip(np.abs(predicted_normal[:, 2]), 0.2, 1.0)
    gap = (z - predicted_z) * slant
    known = z > 0
    parallel = (normal * predicted_normal).sum(axis=1) > np.cos(np.radians(angle))
    return known & (np.abs(gap) < tolerance) & parallel, known & (gap > 2 * tolerance)
