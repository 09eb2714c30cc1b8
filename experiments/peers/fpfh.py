"""Open3D's FPFH (Rusu et al. 2009) with RANSAC: piece after piece of the scene is registered to the model.

RANSAC gives one pose for one pair of clouds. For all parts of a bin it is asked for balls of the part's size around
seeds spread over the scene; a ball is the source, the model the target, so that its fitness is the share explained. The
model's features are those of views of it, since a scan never sees the back whose points the feature would count.
"""

from dataclasses import dataclass

import numpy as np
import open3d as o3d
from jaxtyping import Float, Int

from peers.cloud import SceneCloud, point_cloud
from peers.model import Model

VOXEL = 0.03  # of the diameter. Radii below in voxels and the checks of RANSAC are those of Open3D's tutorial
NORMAL, FEATURE, DISTANCE = 2.0, 5.0, 1.5  # voxels
SEED_SPACING = 0.35  # diameters between seeds: a part that shows half of itself has several
BALL = 0.5  # diameters
LEAST = 40  # points of a ball: less is no shape
RUNS = 1  # of RANSAC on each ball
LEAST_RUNS = 20  # in all, so that a single part has its chances too

reg = o3d.pipelines.registration


@dataclass(frozen=True)
class Fpfh:
    points: o3d.geometry.PointCloud  # of all views, model frame
    features: reg.Feature
    voxel: float  # [mm]
    diameter: float  # [mm]


def prepared(model: Model, voxel: float = VOXEL) -> Fpfh:
    """Features of the model in twenty views, the corners of a dodecahedron."""
    step = voxel * model.diameter
    clouds = [view_of(model, direction, step) for direction in dodecahedron()]
    features = reg.Feature()
    features.data = np.hstack([feature_of(cloud, step).data for cloud in clouds])
    points = o3d.geometry.PointCloud()
    for cloud in clouds:
        points += cloud
    return Fpfh(points, features, step, model.diameter)


def candidates(fpfh: Fpfh, cloud: SceneCloud, seed: int = 0, runs: int = RUNS) -> list[Float[np.ndarray, "4 4"]]:
    """T_cam_obj of every ball and run."""
    scene = cloud.cloud().voxel_down_sample(fpfh.voxel)
    if len(scene.points) < LEAST:
        return []
    feature, X = feature_of(scene, fpfh.voxel), np.asarray(scene.points)
    o3d.utility.random.seed(seed)
    poses, seeds = [], spread(X, SEED_SPACING * fpfh.diameter)
    runs = max(runs, -(-LEAST_RUNS // len(seeds)))
    for centre in seeds:
        ball = np.flatnonzero(np.linalg.norm(X - X[centre], axis=1) < BALL * fpfh.diameter)
        if len(ball) < LEAST:
            continue
        part = reg.Feature()
        part.data = feature.data[:, ball]
        piece = scene.select_by_index(ball)
        poses += [np.linalg.inv(registered(piece, part, fpfh)) for _ in range(runs)]
    return poses


def registered(source: o3d.geometry.PointCloud, feature: reg.Feature, fpfh: Fpfh) -> Float[np.ndarray, "4 4"]:
    """T_obj_cam by RANSAC on matched features."""
    distance = DISTANCE * fpfh.voxel
    checks = [reg.CorrespondenceCheckerBasedOnEdgeLength(0.9), reg.CorrespondenceCheckerBasedOnDistance(distance)]
    estimate, stop = reg.TransformationEstimationPointToPoint(False), reg.RANSACConvergenceCriteria(100000, 0.999)
    return reg.registration_ransac_based_on_feature_matching(
        source, fpfh.points, feature, fpfh.features, False, distance, estimate, 3, checks, stop
    ).transformation


def feature_of(cloud: o3d.geometry.PointCloud, voxel: float) -> reg.Feature:
    return reg.compute_fpfh_feature(cloud, o3d.geometry.KDTreeSearchParamHybrid(FEATURE * voxel, 100))


def view_of(model: Model, direction: Float[np.ndarray, "3"], voxel: float) -> o3d.geometry.PointCloud:
    """What an orthographic camera in `direction` sees of the model, its points with their own normals."""
    X, N = (np.asarray(x) for x in (model.dense.points, model.dense.normals))
    start = X + 1e-3 * model.diameter * N
    rays = np.hstack([start, np.broadcast_to(direction, X.shape)]).astype(np.float32)
    hidden = model.caster.test_occlusions(o3d.core.Tensor(rays), nthreads=1).numpy()
    seen = (N @ direction > 0.2) & ~hidden
    return point_cloud(X[seen], N[seen]).voxel_down_sample(voxel)


def dodecahedron() -> Float[np.ndarray, "20 3"]:
    """Unit vectors to its corners."""
    g = (1 + 5**0.5) / 2
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    corners += [t for a in (-g, g) for b in (-1 / g, 1 / g) for t in ((0, b, a), (b, a, 0), (a, 0, b))]
    return np.array(corners) / 3**0.5


def spread(X: Float[np.ndarray, "n 3"], spacing: float) -> Int[np.ndarray, "seeds"]:
    """Points chosen one after the other, the farthest from those before, until all are nearer than `spacing`."""
    chosen = [int(X[:, 2].argmin())]  # the one nearest to the camera
    distance = np.linalg.norm(X - X[chosen[0]], axis=1)
    while distance.max() > spacing:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(X - X[chosen[-1]], axis=1))
    return np.array(chosen)
