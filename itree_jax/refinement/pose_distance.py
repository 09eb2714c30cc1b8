"""How far apart poses carry a part, up to the part's symmetries."""

import numpy as np
from itree_cad.symmetry import Symmetries
from jaxtyping import Float

NEARLY_SAME = 0.1  # of the diameter: two hypotheses whose rims differ by less are one


def same_part_distance(
    R_a: Float[np.ndarray, "n 3 3"], t_a: Float[np.ndarray, "n 3"], R_b: Float[np.ndarray, "3 3"],
    t_b: Float[np.ndarray, "3"], symmetries: Symmetries, diameter: float,
) -> Float[np.ndarray, "n"]:
    """How far apart [mm] poses carry a part's rim, about, the least over its symmetries: shift plus turn times half
    the diameter. About an axis of revolution, how far apart they carry the axis's ends.
    """
    turns = np.asarray(symmetries.discrete, float)
    R_c, t_c = R_b @ turns[:, :3, :3], turns[:, :3, 3] @ R_b.T + t_b
    if symmetries.continuous:
        axis, point = symmetries.continuous[0]
        ends = np.asarray(point) + 0.5 * diameter * np.stack([np.asarray(axis), -np.asarray(axis)])
        apart = (ends @ R_a.swapaxes(1, 2) + t_a[:, None])[:, None] - (ends @ R_c.swapaxes(1, 2) + t_c[:, None])
        return np.linalg.norm(apart, axis=-1).max(axis=-1).min(axis=1, initial=np.inf)
    cosine = np.clip((R_a.reshape(-1, 9) @ R_c.reshape(-1, 9).T - 1.0) / 2.0, -1.0, 1.0)
    apart = np.linalg.norm(t_a[:, None] - t_c, axis=-1) + np.arccos(cosine) * diameter / 2.0
    return apart.min(axis=1, initial=np.inf)
