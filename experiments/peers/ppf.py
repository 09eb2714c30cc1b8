"""OpenCV's point pair features (Drost et al. 2010): poses voted for by pairs of oriented points.

`cv2.ppf_match_3d` samples a cloud by cells that are a share of its extent along each axis, so that a flat scene gets
flat cells: model and scene are sampled here, in cubes of one size, and the detector is told a share small enough to
leave them so. Its clusters of poses are as wide as the relative sampling step in whatever unit the points have, and
Python cannot set them otherwise: points are given in diameters, so that a cluster is as wide as a cell.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import open3d as o3d
from jaxtyping import Float

from peers.cloud import SceneCloud
from peers.model import Model

SAMPLING = 0.05  # of the diameter: the documentation's value
# Of the scene's points that vote for poses: some twenty per part of a full bin. Most of the time is theirs.
REFERENCES = 1 / 10
LEAST_REFERENCES = 150  # so that a single part has its chances too
ANGLES = 30  # steps of 12 degrees, the documentation's default
KEPT = 150  # poses with most votes that go to ICP: some ten per part of a full bin


@dataclass(frozen=True)
class Ppf:
    detector: "cv2.ppf_match_3d.PPF3DDetector"
    step: float  # [mm]
    diameter: float  # [mm]


def prepared(model: Model, sampling: float = SAMPLING) -> Ppf:
    """Trains the detector: the slow part, quadratic in the number of model points."""
    step = sampling * model.diameter
    detector = cv2.ppf_match_3d.PPF3DDetector(sampling, sampling, ANGLES)
    detector.trainModel(oriented(model.sampled(step), model.diameter))
    return Ppf(detector, step, model.diameter)


def candidates(
    ppf: Ppf, cloud: SceneCloud, references: float = REFERENCES, kept: int = KEPT
) -> list[Float[np.ndarray, "4 4"]]:
    """T_cam_obj of the clusters with most votes."""
    points = oriented(cloud.cloud().voxel_down_sample(ppf.step), ppf.diameter)
    if len(points) < 20:
        return []
    references = min(1.0, max(references, LEAST_REFERENCES / len(points)))
    extent = float(np.ptp(points[:, :3], axis=0).max())
    found = ppf.detector.match(points, references, 0.1 * ppf.step / ppf.diameter / extent)
    poses = sorted(found, key=lambda pose: -pose.numVotes)[:kept]
    return [in_mm(np.array(pose.pose, float), ppf.diameter) for pose in poses]


def in_mm(T: Float[np.ndarray, "4 4"], unit: float) -> Float[np.ndarray, "4 4"]:
    """A pose of points in `unit` [mm] as a pose of points in mm."""
    T = T.copy()
    T[:3, 3] *= unit
    return T


def oriented(cloud: o3d.geometry.PointCloud, unit: float) -> Float[np.ndarray, "n 6"]:
    """Points in `unit` [mm] and unit normals in the rows that OpenCV wants, float32."""
    normals = np.asarray(cloud.normals)
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    return np.ascontiguousarray(np.hstack([np.asarray(cloud.points) / unit, normals]).astype(np.float32))
