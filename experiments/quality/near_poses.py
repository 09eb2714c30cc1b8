"""Which of many poses are near a true one, without measuring those that are far."""

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

from itree_jax.evaluation.pose_errors import Pose, mssd
from itree_jax.evaluation.truth import Model

BLOCK = 1024  # poses whose turns are held at once


def errors_below(estimate: Pose, truth: Pose, model: Model, limit: float) -> Float[np.ndarray, "poses instances"]:
    """MSSD [mm] of every pose to every instance where it may be under `limit` [mm], infinity elsewhere.

    Args:
        estimate: model to camera, [poses, ...] and [mm].
        truth: likewise, [instances, ...].
    """
    R, t = np.asarray(estimate.R, float), np.asarray(estimate.t, float)
    error = np.full((len(t), len(truth.t)), np.inf)
    for k in range(0, len(t), BLOCK):
        block = slice(k, k + BLOCK)
        near = np.nonzero(least_errors(Pose(R[block], t[block]), truth, model) < limit)
        poses, instances = near[0] + k, near[1]
        error[poses, instances] = mssd(
            Pose(R[poses], t[poses]), Pose(truth.R[instances], truth.t[instances]), model.hull, model.symmetries
        )
    return error


def least_errors(estimate: Pose, truth: Pose, model: Model) -> Float[np.ndarray, "poses instances"]:
    """What the MSSD [mm] is at least, by the way that the hull's middle goes and by the turn.

    Of two opposite points on a ball inside the hull, one moves by no less than the middle and the turn do together:
    the root of the sum of their squares.
    """
    middle = model.hull.mean(axis=0)
    radius = -float((ConvexHull(model.hull).equations @ np.append(middle, 1.0)).max())
    copies = np.einsum("gij,sj->gsi", truth.R, model.symmetries.R @ middle + model.symmetries.t) + truth.t[:, None]
    moved = np.linalg.norm((estimate.R @ middle + estimate.t)[:, None, None] - copies, axis=-1)
    turned = np.einsum("gij,sjk->gsik", truth.R, model.symmetries.R)
    trace = estimate.R.reshape(-1, 9) @ turned.reshape(-1, 9).T  # 1 + 2 cos of the turn's angle
    chord = np.sqrt(np.maximum(3.0 - trace, 0.0)).reshape(moved.shape)  # 2 sin of half the angle
    return np.hypot(moved, radius * chord).min(axis=-1)
