"""Ambiguity: poses that the scene cannot tell apart, because what tells them apart is hidden."""

import numpy as np
from itree_cad.symmetry import Symmetries
from jaxtyping import Bool, Float, Int

from itree_jax.refinement.pose_distance import NEARLY_SAME, carried_as_near, same_part_distance

FARTHEST = 6.0  # times as much: beyond it a rival has no share


def rivals(
    others: Int[np.ndarray, "others"], margins: Float[np.ndarray, "others"], R: Float[np.ndarray, "hypotheses 3 3"],
    t: Float[np.ndarray, "hypotheses 3"], symmetries: Symmetries, diameter: float, refinement: float,
) -> tuple[Int[np.ndarray, "rivals"], Float[np.ndarray, "rivals"]]:
    """Of the other poses of an answer's place, those that it hardly beats, the likeliest first and each once, and the
    share of belief that each takes from it.

    `margins` [nats]: by how much the answer beats each, where the two differ. Beliefs are in the ratio of exp(-margin /
    refinement), the latter as in `Scoring`: a half for one that is as good.
    """
    kept: list[int] = []
    for k in np.argsort(margins, kind="stable"):
        if margins[k] > FARTHEST * refinement:
            break
        pose = R[others[k]], t[others[k]]
        found = others[kept]
        apart = same_part_distance(R[found], t[found], *pose, symmetries, diameter)
        if apart.min(initial=np.inf) > NEARLY_SAME * diameter:
            kept.append(int(k))
    weight = np.exp(-np.maximum(margins[kept], 0.0) / refinement)
    return others[kept], weight / (1.0 + weight.sum())


def same_place(
    R: Float[np.ndarray, "hypotheses 3 3"], t: Float[np.ndarray, "hypotheses 3"], symmetries: Symmetries,
    diameter: float,
) -> Bool[np.ndarray, "hypotheses hypotheses"]:
    """Which poses are another's rivals: less than half a diameter away, and not the same pose of the part."""
    here = np.linalg.norm(t[:, None] - t[None], axis=-1) < 0.5 * diameter
    here &= ~carried_as_near(R, t, R, t, symmetries, diameter, NEARLY_SAME * diameter)
    return here | here.T
