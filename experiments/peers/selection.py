"""From many verified poses to one per part: each pixel belongs to one pose, the best explained pose chooses first."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

ACCEPT = 0.5  # share of its visible pixels that an answer must explain alone: more than any rival can
RIVALS, ALIKE = 4, 20.0  # attitudes of one place that get the last ICP, and the angle [deg] under which two are one
CONTRADICTED = 0.15  # share of them behind which the scene is seen: pixels at the outline of a small part make a tenth


@dataclass(frozen=True)
class Verified:
    """A pose and what the depth map says to the pixels that the model would cover in it."""

    T_cam_obj: Float[np.ndarray, "4 4"]
    explained: Int[np.ndarray, "pixels"]  # indices of those where depth and normal agree
    weight: Float[np.ndarray, "pixels"]  # how well each does, 0 to 1
    predicted: int  # pixels of the model, seen alone
    contradicted: int  # of them, where the scene is behind

    @property
    def score(self) -> float:
        """Share of the model's visible pixels that the depth map explains, by weight."""
        return self.share(np.zeros(0, dtype=np.int64))

    def share(self, taken: Int[np.ndarray, "others"]) -> float:
        """The same without pixels that are taken by others."""
        return float(self.weight[~np.isin(self.explained, taken)].sum()) / max(self.predicted, 1)


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
        shares = [pose.share(taken) for pose in left]
        best = int(np.argmax(shares))
        if shares[best] < accept:
            break
        chosen.append((left[best], shares[best]))
        taken = np.union1d(taken, left[best].explained)
        left = [pose for k, pose in enumerate(left) if k != best and shares[k] >= accept]
    return chosen


def contenders(poses: list[Verified], chosen: list[Verified], most: int = RIVALS) -> list[Verified]:
    """The chosen poses and for each the best others that claim its pixels in another attitude, `most` in all.

    A part that looks nearly the same turned by a quarter is told by its last ICP, not by its first.
    """
    kept: list[Verified] = []
    for best in chosen:
        rivals = [pose for pose in poses if np.isin(best.explained, pose.explained).mean() > 0.5]
        own = [best]
        for pose in sorted(rivals, key=lambda pose: -pose.score):
            if len(own) < most and all(angle_between(pose.T_cam_obj, other.T_cam_obj) > ALIKE for other in own):
                own.append(pose)
        kept += own
    return kept


def angle_between(A: Float[np.ndarray, "4 4"], B: Float[np.ndarray, "4 4"]) -> float:
    """Angle [deg] between two poses' rotations."""
    return float(np.degrees(np.arccos(np.clip((np.trace(A[:3, :3].T @ B[:3, :3]) - 1) / 2, -1, 1))))


def agreement(
    predicted_z: Float[np.ndarray, "n"],
    predicted_normal: Float[np.ndarray, "n 3"],
    z: Float[np.ndarray, "n"],
    normal: Float[np.ndarray, "n 3"],
    tolerance: float,
    angle: float = 30.0,
) -> tuple[Float[np.ndarray, "n"], Bool[np.ndarray, "n"]]:
    """Per pixel of the model how well the depth map explains it, and whether it contradicts it (the scene is behind).

    The weight falls from 1 with the square of the distance to 0 at `tolerance`, as in MSAC (Torr and Zisserman 2000).

    Distances [mm] are taken along the model's normal, `angle` [deg] is between the normals; z = 0 says nothing. Neither
    is so where something else is in front.
    """
    slant = np.clip(np.abs(predicted_normal[:, 2]), 0.2, 1.0)
    gap = (z - predicted_z) * slant
    known = z > 0
    parallel = (normal * predicted_normal).sum(axis=1) > np.cos(np.radians(angle))
    weight = np.clip(1 - (gap / tolerance) ** 2, 0.0, 1.0)
    return np.where(known & parallel, weight, 0.0), known & (gap > 2 * tolerance)
