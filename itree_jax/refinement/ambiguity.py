"""Ambiguity: poses that the scene cannot tell apart, because what tells them apart is hidden."""

import numpy as np
from itree_cad.symmetry import Symmetries
from jaxtyping import Bool, Float, Int

from itree_jax.refinement.hypotheses import NEARLY_SAME, pose_distance

# An agreeing pixel counts between 0 and 1, by how closely, with a deviation of about this under the sensor's noise; the
# evidence of two equal poses differs by it times the root of their pixels.
PIXEL_DEVIATION = 0.15
FARTHEST = 6.0  # deviations of evidence beyond which a rival has no share


def same_part_distance(
    R_a: Float[np.ndarray, "*n 3 3"], t_a: Float[np.ndarray, "*n 3"], R_b: Float[np.ndarray, "3 3"],
    t_b: Float[np.ndarray, "3"], symmetries: Symmetries, diameter: float,
) -> Float[np.ndarray, "*n"]:
    """How far apart [mm] poses carry a part's rim, the least over its symmetries.

    About an axis of revolution, how far apart they carry the axis's ends.
    """
    distances = []
    for turn in np.asarray(symmetries.discrete, float):
        R_c, t_c = R_b @ turn[:3, :3], R_b @ turn[:3, 3] + t_b
        if symmetries.continuous:
            axis, point = symmetries.continuous[0]
            ends = [point + 0.5 * diameter * sign * np.asarray(axis) for sign in (1.0, -1.0)]
            apart = [np.linalg.norm(R_a @ e + t_a - (R_c @ e + t_c), axis=-1) for e in ends]
            distances.append(np.maximum(*apart))
        else:
            distances.append(pose_distance(R_a, t_a, R_c, t_c, diameter))
    return np.min(distances, axis=0)


def rivals(
    chosen: int, evidence: Float[np.ndarray, "hypotheses"], agreeing: Float[np.ndarray, "hypotheses"],
    R: Float[np.ndarray, "hypotheses 3 3"], t: Float[np.ndarray, "hypotheses 3"], symmetries: Symmetries,
    diameter: float,
) -> tuple[Int[np.ndarray, "rivals"], float]:
    """Other poses of the same place with nearly the evidence of the chosen one, and the share of belief left to it.

    Beliefs are in the ratio of exp(evidence / deviation): 1 without rivals, a half beside one that is as good.
    """
    deviation = PIXEL_DEVIATION * np.sqrt(max(float(agreeing[chosen]), 1.0))
    here = np.linalg.norm(t - t[chosen], axis=-1) < 0.5 * diameter
    close = np.flatnonzero(here & (evidence > evidence[chosen] - FARTHEST * deviation))
    kept = [chosen]
    for k in close[np.argsort(-evidence[close], kind="stable")]:
        apart = same_part_distance(R[kept], t[kept], R[k], t[k], symmetries, diameter)
        if apart.min() > NEARLY_SAME * diameter:
            kept.append(int(k))
    found = np.array(kept[1:], int)
    weight = np.exp(np.minimum((evidence[found] - evidence[chosen]) / deviation, 0.0))
    return found, float(1.0 / (1.0 + weight.sum()))


def same_place(
    R: Float[np.ndarray, "hypotheses 3 3"], t: Float[np.ndarray, "hypotheses 3"], symmetries: Symmetries,
    diameter: float,
) -> Bool[np.ndarray, "hypotheses hypotheses"]:
    """Which poses are another's rivals: less than half a diameter away, and not the same pose of the part."""
    here = np.linalg.norm(t[:, None] - t[None], axis=-1) < 0.5 * diameter
    for k in range(len(t)):
        mine = np.flatnonzero(here[k])
        apart = same_part_distance(R[mine], t[mine], R[k], t[k], symmetries, diameter)
        here[k, mine] = apart > NEARLY_SAME * diameter
    return here | here.T
