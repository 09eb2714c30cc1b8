"""How far apart poses carry a part, up to the part's symmetries."""

import numpy as np
from itree_cad.symmetry import Symmetries
from itree_kernels.apart import kept_apart
from jaxtyping import Bool, Float, Int
from scipy.spatial.distance import cdist

NEARLY_SAME = 0.1  # of the diameter: two hypotheses whose rims differ by less are one
ROUNDING = 1e-4  # of the trace of a rotation in float32


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


def carried_as_near(
    R_a: Float[np.ndarray, "a 3 3"], t_a: Float[np.ndarray, "a 3"], R_b: Float[np.ndarray, "b 3 3"],
    t_b: Float[np.ndarray, "b 3"], symmetries: Symmetries, diameter: float, nearly: float,
) -> Bool[np.ndarray, "a b"]:
    """Which poses carry a part to within `nearly` [mm] of where which others do: `same_part_distance` of all pairs."""
    turns = np.asarray(symmetries.discrete, float)
    R_c = (R_b[:, None] @ turns[:, :3, :3]).reshape(-1, 3, 3)
    t_c = (turns[:, :3, 3] @ R_b.swapaxes(1, 2) + t_b[:, None]).reshape(-1, 3)
    near = np.zeros((len(t_a), len(t_b)), bool)
    if symmetries.continuous:
        axis, point = (np.asarray(a) for a in symmetries.continuous[0])
        ends = (point + 0.5 * diameter * axis, point - 0.5 * diameter * axis)
        apart = np.maximum(*(cdist(R_a @ end + t_a, R_c @ end + t_c) for end in ends))
        return np.any((apart < nearly).reshape(*near.shape, len(turns)), axis=-1, out=near)
    # most pairs are too far apart by their turn alone, which is told without its angle
    least = 1.0 + 2.0 * np.cos(min(2.0 * nearly / diameter, np.pi)) - ROUNDING
    trace = R_a.reshape(-1, 9).astype(np.float32) @ R_c.reshape(-1, 9).astype(np.float32).T
    a, c = np.nonzero(trace > least)
    shift = np.linalg.norm(t_a[a] - t_c[c], axis=-1)
    a, c, shift = a[shift < nearly], c[shift < nearly], shift[shift < nearly]
    cosine = np.clip(((R_a[a] * R_c[c]).sum(axis=(1, 2)) - 1.0) / 2.0, -1.0, 1.0)
    close = shift + np.arccos(cosine) * diameter / 2.0 < nearly
    near[a[close], c[close] // len(turns)] = True
    return near


def first_apart(
    R: Float[np.ndarray, "n 3 3"], t: Float[np.ndarray, "n 3"], symmetries: Symmetries, diameter: float, nearly: float,
    most: int, bounds: Int[np.ndarray, "lists_and_one"] | None = None,
) -> Int[np.ndarray, "kept"]:
    """Indices of the first `most` poses that don't carry the part to within `nearly` [mm] of where an earlier one of
    them does: `same_part_distance`. Of several lists of poses, if `bounds` tell where each begins and the last ends.
    """
    turns, ends = np.asarray(symmetries.discrete, float), None
    if symmetries.continuous:
        axis, point = (np.asarray(a, float) for a in symmetries.continuous[0])
        ends = point + 0.5 * diameter * np.stack([axis, -axis])
    bounds = np.array([0, len(t)]) if bounds is None else bounds
    return np.flatnonzero(kept_apart(R, t, bounds, turns, ends, diameter, nearly, most))
