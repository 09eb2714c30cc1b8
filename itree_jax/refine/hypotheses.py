"""From candidate attitudes of regions to poses, and their pixelwise ranking."""

from typing import NamedTuple

import numpy as np
from itree_kernels.camera import Camera
from jaxtyping import Float, Int

from itree_jax.refine.optimise import Hypotheses
from itree_jax.refine.verify import Verdict

NEARLY_SAME = 0.1  # of the diameter: two hypotheses whose rims differ by less are one


class RegionHypotheses(NamedTuple):
    """Poses with the region and appearance row they come from."""

    poses: Hypotheses
    region: Int[np.ndarray, "hypotheses"]
    row: Int[np.ndarray, "hypotheses"]
    log_likelihood: Float[np.ndarray, "hypotheses"]

    def take(self, index: Int[np.ndarray, "kept"]) -> "RegionHypotheses":
        poses = Hypotheses(self.poses.R_cam_obj[index], self.poses.t_cam_obj[index])
        return RegionHypotheses(poses, self.region[index], self.row[index], self.log_likelihood[index])


def place(
    R_ray_obj: Float[np.ndarray, "regions k 3 3"],
    centroid_obj: Float[np.ndarray, "regions k 3"],
    R_ray_cam: Float[np.ndarray, "regions 3 3"],
    X_region: Float[np.ndarray, "regions 3"],
) -> tuple[Float[np.ndarray, "regions k 3 3"], Float[np.ndarray, "regions k 3"]]:
    """Poses that put the appearance's mean surface point on the region's [mm]."""
    R_cam_obj = np.einsum("rca,rkcb->rkab", R_ray_cam, R_ray_obj)
    t_cam_obj = X_region[:, None] - np.einsum("rkab,rkb->rka", R_cam_obj, centroid_obj)
    return R_cam_obj, t_cam_obj


def agreement(verdict: Verdict) -> Float[np.ndarray, "hypotheses"]:
    """Evidence for a pose: pixels that agree less those that contradict, counted against all it should show.

    Hidden pixels say nothing either way; a pose that is mostly hidden can't collect much evidence.
    """
    visible = verdict.agreeing + verdict.contradicting
    support = contour_share(verdict)
    return (verdict.agreeing - verdict.contradicting) / np.maximum(visible + 0.5 * verdict.hidden, 1.0) * support


def contour_share(verdict: Verdict) -> Float[np.ndarray, "hypotheses"]:
    """Share of the visible contour outside of which the observed surface ends (one pseudo count each way)."""
    return (verdict.contour_found + 1.0) / (verdict.contour_found + verdict.contour_missed + 1.0)


def best_of_each_region(
    score: Float[np.ndarray, "hypotheses"], hypotheses: RegionHypotheses, most: int, diameter: float
) -> Int[np.ndarray, "kept"]:
    """Indices of the `most` best hypotheses of every region, leaving out those that repeat a better one."""
    kept: list[int] = []
    R, t = hypotheses.poses
    for region in np.unique(hypotheses.region):
        order = np.flatnonzero(hypotheses.region == region)
        order = order[np.argsort(-score[order], kind="stable")]
        chosen: list[int] = []
        for k in order:
            if len(chosen) == most:
                break
            if not any(pose_distance(R[k], t[k], R[j], t[j], diameter) < NEARLY_SAME * diameter for j in chosen):
                chosen.append(int(k))
        kept += chosen
    return np.array(kept, int)


def pose_distance(
    R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"], S: Float[np.ndarray, "3 3"], s: Float[np.ndarray, "3"],
    diameter: float,
) -> float:
    """How far apart [mm] two poses carry a part's rim, about: shift plus turn times half the diameter."""
    cosine = np.clip((np.sum(R * S) - 1.0) / 2.0, -1.0, 1.0)
    return float(np.linalg.norm(t - s) + np.arccos(cosine) * diameter / 2.0)


def region_point(
    centroid_uv: Float[np.ndarray, "regions 2"], mean_depth: Float[np.ndarray, "regions"], camera: Camera
) -> Float[np.ndarray, "regions 3"]:
    """The mean surface point of each region in the camera frame [mm]."""
    return camera.unproject(centroid_uv, mean_depth)
