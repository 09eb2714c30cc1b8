"""A scene for matching: points with normals toward the camera, what of them is foreground. Open3D."""

from dataclasses import dataclass

import numpy as np
import open3d as o3d
from jaxtyping import Bool, Float

from peers.foreground import foreground
from peers.scenes import DepthScene

NORMAL_RADIUS = 3.0  # [mm]: a hundred pixels of 0.5 mm, so that 0.3 mm of noise tilt a normal by one degree


@dataclass(frozen=True)
class SceneCloud:
    """All pixels as points; `mask` are those left for parts."""

    scene: DepthScene
    points: Float[np.ndarray, "h w 3"]  # X_cam [mm]
    normals: Float[np.ndarray, "h w 3"]  # toward the camera, 0 = none
    mask: Bool[np.ndarray, "h w"]

    def without(self, pixels: np.ndarray) -> "SceneCloud":
        """The cloud less some pixels (flat indices)."""
        mask = self.mask.copy()
        mask.ravel()[pixels] = False
        return SceneCloud(self.scene, self.points, self.normals, mask)

    def cloud(self, mask: Bool[np.ndarray, "h w"] | None = None) -> o3d.geometry.PointCloud:
        return point_cloud(*(x[self.mask if mask is None else mask] for x in (self.points, self.normals)))


def scene_cloud(scene: DepthScene, diameter: float) -> SceneCloud:
    """Normals are fitted to the points above the floor, within `NORMAL_RADIUS`."""
    points = scene.points
    seen = scene.depth > 0
    if scene.R_w2c is not None and scene.t_w2c is not None:
        seen &= (points - scene.t_w2c) @ scene.R_w2c[:, 2] > 0.0
    cloud = point_cloud(points[seen])
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamRadius(NORMAL_RADIUS))
    cloud.orient_normals_towards_camera_location(np.zeros(3))
    normals = np.zeros_like(points)
    normals[seen] = np.nan_to_num(np.asarray(cloud.normals))
    return SceneCloud(scene, points, normals, foreground(scene, points, normals, diameter))


def point_cloud(
    points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"] | None = None
) -> o3d.geometry.PointCloud:
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    if normals is not None:
        cloud.normals = o3d.utility.Vector3dVector(normals)
    return cloud
