"""Errors of a pose against the truth, least over the object's symmetries (MSSD and MSPD of BOP; ADD-S of Hinterstoisser
et al. 2012).

A pose here is `(R, t)`, model to camera, translation in [mm]; leading axes of both poses broadcast.
"""

from collections.abc import Callable
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from itree_kernels.camera import Camera
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from itree_jax.evaluation.symmetry import SymmetrySet


class Pose(NamedTuple):
    R: Float[np.ndarray, "*n 3 3"]
    t: Float[np.ndarray, "*n 3"]  # [mm]


class PoseErrors(NamedTuple):
    mssd: Float[np.ndarray, "*n"]  # [mm]
    rotation: Float[np.ndarray, "*n"]  # [rad] to the copy nearest in MSSD, leaving out turns about a continuous axis
    translation: Float[np.ndarray, "*n"]  # [mm] to the same copy


def mssd(
    estimate: Pose, truth: Pose, points: Float[np.ndarray, "points 3"], symmetries: SymmetrySet
) -> Float[np.ndarray, "*n"]:
    """Maximum symmetry-aware surface distance [mm]: the largest displacement of a point, least over the symmetries.

    The vertices of the convex hull are enough for `points`: a displacement is convex in the point.
    """
    return pose_errors(estimate, truth, points, symmetries).mssd


def pose_errors(
    estimate: Pose, truth: Pose, points: Float[np.ndarray, "points 3"], symmetries: SymmetrySet
) -> PoseErrors:
    """MSSD with the rotation and translation error under the symmetry that gave it."""
    R_est, t_est, R_gt, t_gt, shape = _flat(estimate, truth)
    gap, best = _least_gap((R_est, t_est), (R_gt, t_gt), points, symmetries, lambda X_cam: X_cam)
    R_best = R_gt @ symmetries.R[best]
    t_best = np.einsum("nij,nj->ni", R_gt, symmetries.t[best]) + t_gt
    rotation = _angle(R_est, R_best, symmetries.continuous_axis)
    translation = np.linalg.norm(t_est - t_best, axis=-1)
    return PoseErrors(gap.reshape(shape), rotation.reshape(shape), translation.reshape(shape))


def mspd(
    estimate: Pose, truth: Pose, points: Float[np.ndarray, "points 3"], symmetries: SymmetrySet, camera: Camera
) -> Float[np.ndarray, "*n"]:
    """Maximum symmetry-aware projection distance [px]: as MSSD, of the points' images in `camera`."""
    R_est, t_est, R_gt, t_gt, shape = _flat(estimate, truth)
    return _least_gap((R_est, t_est), (R_gt, t_gt), points, symmetries, camera.project)[0].reshape(shape)


def _least_gap(
    estimate: tuple[np.ndarray, np.ndarray],
    truth: tuple[np.ndarray, np.ndarray],
    points: Float[np.ndarray, "points 3"],
    symmetries: SymmetrySet,
    view: Callable[[np.ndarray], np.ndarray],
) -> tuple[Float[np.ndarray, "n"], Int[np.ndarray, "n"]]:
    """Over the symmetries, the least of the largest distance of a point in `view`; and which symmetry gave it.

    Exact, and fast with hundreds of symmetries: a few points bound the largest distance from below, and only
    symmetries whose bound is under the best value found are measured with all points.
    """
    few = _extremes(points)
    gap, best = np.empty(len(estimate[0])), np.empty(len(estimate[0]), dtype=np.int64)
    for i, (R_est, t_est, R_gt, t_gt) in enumerate(zip(*estimate, *truth, strict=True)):
        R, t = R_gt @ symmetries.R, symmetries.t @ R_gt.T + t_gt

        def largest(x: np.ndarray, chosen: Any, R=R, t=t, R_est=R_est, t_est=t_est) -> np.ndarray:
            copies = x @ np.swapaxes(R[chosen], -1, -2) + t[chosen, None]
            return np.linalg.norm(view(copies) - view(x @ R_est.T + t_est), axis=-1).max(axis=-1)

        bound = largest(few, slice(None))
        enough = largest(points, [int(bound.argmin())])[0]
        near = np.flatnonzero(bound <= enough)
        gaps = largest(points, near)
        gap[i], best[i] = gaps.min(), near[gaps.argmin()]
    return gap, best


def _extremes(points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "few 3"]:
    """The points farthest along the 26 directions to a cube's faces, edges and corners."""
    directions = np.array([d for d in product((-1, 0, 1), repeat=3) if any(d)], float)
    return points[np.unique((directions @ points.T).argmax(axis=1))]


def add_s(
    estimate: Pose, truth: Pose, points: Float[np.ndarray, "points 3"], surface: KDTree, limit: float = np.inf
) -> Float[np.ndarray, "*n"]:
    """Mean distance [mm] from the estimate's points to the true surface, whatever point of it is nearest.

    `surface` holds samples of the model's surface in its own frame, `points` among them: a true pose has error 0.
    Poses so far off that the error must exceed `limit` [mm] get inf at once.
    """
    R_est, t_est, R_gt, t_gt, shape = _flat(estimate, truth)
    centre = points.mean(axis=0)
    radius = np.linalg.norm(surface.data - centre, axis=1).max()
    moved = np.einsum("nij,j->ni", R_est, centre) + t_est - t_gt
    moved = np.linalg.norm(np.einsum("nji,nj->ni", R_gt, moved) - centre, axis=-1)
    near = moved - radius <= limit  # mean distance >= mean |x - centre| - radius >= |mean x - centre| - radius
    in_model = points @ np.swapaxes(R_est[near], -1, -2) + (t_est - t_gt)[near, None]
    errors = np.full(len(R_est), np.inf)
    errors[near] = np.asarray(surface.query(in_model @ R_gt[near])[0]).mean(axis=-1)
    return errors.reshape(shape)


def _flat(estimate: Pose, truth: Pose) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, tuple[int, ...]]:
    shape = np.broadcast_shapes(estimate.t.shape[:-1], truth.t.shape[:-1])
    rotations = [np.broadcast_to(p.R, (*shape, 3, 3)).reshape(-1, 3, 3) for p in (estimate, truth)]
    translations = [np.broadcast_to(p.t, (*shape, 3)).reshape(-1, 3) for p in (estimate, truth)]
    return rotations[0], translations[0], rotations[1], translations[1], shape


def _angle(
    R_a: Float[np.ndarray, "n 3 3"], R_b: Float[np.ndarray, "n 3 3"], axis: Float[np.ndarray, "3"] | None
) -> Float[np.ndarray, "n"]:
    """Angle of R_b^T R_a [rad], or between the images of `axis`. By atan2: exact at 0 and at pi."""
    if axis is not None:
        a, b = R_a @ axis, R_b @ axis
        return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1))
    D = np.swapaxes(R_b, -1, -2) @ R_a
    skew = np.stack([D[:, 2, 1] - D[:, 1, 2], D[:, 0, 2] - D[:, 2, 0], D[:, 1, 0] - D[:, 0, 1]], axis=-1)
    return np.arctan2(np.linalg.norm(skew, axis=-1) / 2, (np.trace(D, axis1=1, axis2=2) - 1) / 2)
