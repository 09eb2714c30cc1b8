"""ICP of a pose and its verification, the same for both peers. Open3D's point-to-plane ICP, from scene to model."""

from typing import NamedTuple

import numpy as np
import open3d as o3d
from jaxtyping import Float, Int

from peers.cloud import SceneCloud, point_cloud
from peers.model import Model, cast
from peers.selection import Verified, agreement

TOLERANCE = 1.5  # [mm] between model and depth map: five deviations of the depth
ROBUST = 0.6  # [mm], two deviations: Tukey's weight falls to 0 there times 4.7
STRIDE = 2  # pixels between two that verification looks at
COARSE = (0.06, 0.03)  # diameters: how far a point may lie from the model in the two passes of the first ICP

reg = o3d.pipelines.registration


class Pixels(NamedTuple):
    index: Int[np.ndarray, "n"]  # flat
    z: Float[np.ndarray, "n"]  # of the model [mm]
    normal: Float[np.ndarray, "n 3"]  # of the model


def coarse_icp(
    model: Model, target: o3d.geometry.PointCloud, source: Float[np.ndarray, "n 3"], T_cam_obj: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "4 4"]:
    """The pose after ICP of the sampled scene points in the ball around the model."""
    centre = T_cam_obj[:3, :3] @ model.centre + T_cam_obj[:3, 3]
    near = source[np.linalg.norm(source - centre, axis=1) < 1.1 * model.radius]
    if len(near) < 20:
        return T_cam_obj
    T = np.linalg.inv(T_cam_obj)
    for share in COARSE:
        T = _icp(point_cloud(near), target, share * model.diameter, T, 20, None)
    return np.linalg.inv(T)


def fine_icp(model: Model, cloud: SceneCloud, T_cam_obj: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
    """The pose after robust ICP of all pixels that it explains, chosen twice."""
    for _ in range(2):
        explained = verified(model, cloud, T_cam_obj, stride=1).explained
        if len(explained) < 50:
            return T_cam_obj
        source = point_cloud(cloud.points.reshape(-1, 3)[explained])
        T = _icp(source, model.dense, TOLERANCE, np.linalg.inv(T_cam_obj), 30, ROBUST)
        T_cam_obj = np.linalg.inv(T)
    return T_cam_obj


def _icp(source, target, distance: float, T, iterations: int, robust: float | None):
    kernel = reg.L2Loss() if robust is None else reg.TukeyLoss(4.685 * robust)
    plane = reg.TransformationEstimationPointToPlane(kernel)
    stop = reg.ICPConvergenceCriteria(1e-7, 1e-7, iterations)
    return reg.registration_icp(source, target, distance, T, plane, stop).transformation


def verified(model: Model, cloud: SceneCloud, T_cam_obj: Float[np.ndarray, "4 4"], stride: int = STRIDE) -> Verified:
    """What the depth map says to the model in this pose."""
    seen = covered(model, cloud, T_cam_obj, stride)
    z, normals = cloud.scene.depth.ravel()[seen.index], cloud.normals.reshape(-1, 3)[seen.index]
    weight, contradicted = agreement(seen.z, seen.normal, z, normals, TOLERANCE)
    explained = (weight > 0) & cloud.mask.ravel()[seen.index]
    return Verified(T_cam_obj, seen.index[explained], weight[explained], len(seen.index), int(contradicted.sum()))


def covered(model: Model, cloud: SceneCloud, T_cam_obj: Float[np.ndarray, "4 4"], stride: int) -> Pixels:
    """The pixels that the model would cover alone, every `stride`-th."""
    K, (height, width) = cloud.scene.K, cloud.scene.depth.shape
    x, y, z = T_cam_obj[:3, :3] @ model.centre + T_cam_obj[:3, 3]
    none = Pixels(np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 3)))
    if z <= model.radius:
        return none
    half = K[0, 0] * model.radius / (z - model.radius)
    low = np.maximum(np.floor([K[0, 0] * x / z + K[0, 2] - half, K[1, 1] * y / z + K[1, 2] - half]), 0).astype(int)
    high = np.minimum([K[0, 0] * x / z + K[0, 2] + half, K[1, 1] * y / z + K[1, 2] + half], [width - 1, height - 1])
    low = -(-low // stride) * stride  # the same pixels for every pose
    if (high < low).any():
        return none
    v, u = np.mgrid[low[1] : int(high[1]) + 1 : stride, low[0] : int(high[0]) + 1 : stride].reshape(2, -1)
    directions = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(len(u))], axis=1)
    depth, normal = cast(model, T_cam_obj, directions)
    hit = np.isfinite(depth)
    return Pixels((v * width + u)[hit], depth[hit], normal[hit])
