"""A model for matching: points with outward normals, and what of it a camera sees. Open3D."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import open3d as o3d
from jaxtyping import Float

from peers.scenes import model_diameter, model_path

DENSE = 40000  # points that ICP compares with: one per 0.5 mm or so on a part of 100 cm^2


@dataclass(frozen=True)
class Model:
    obj_id: int
    diameter: float  # [mm]
    radius: float  # [mm] of the ball around `centre` that holds it
    centre: Float[np.ndarray, "3"]
    dense: o3d.geometry.PointCloud
    caster: o3d.t.geometry.RaycastingScene

    def sampled(self, step: float) -> o3d.geometry.PointCloud:
        """One point with normal per cell of `step` [mm]."""
        return self.dense.voxel_down_sample(step)


def load_model(dataset: Path, obj_id: int) -> Model:
    mesh = o3d.io.read_triangle_mesh(str(model_path(dataset, obj_id)))
    mesh.compute_triangle_normals()
    o3d.utility.random.seed(obj_id)
    dense = mesh.sample_points_uniformly(DENSE, use_triangle_normal=True)
    caster = o3d.t.geometry.RaycastingScene(nthreads=1)
    caster.add_triangles(o3d.t.geometry.TriangleMesh.from_legacy(mesh))
    low, high = mesh.get_min_bound(), mesh.get_max_bound()
    centre = (low + high) / 2
    radius = float(np.linalg.norm(np.asarray(mesh.vertices) - centre, axis=1).max())
    return Model(obj_id, model_diameter(dataset, obj_id), radius, centre, dense, caster)


def cast(
    model: Model, T_cam_obj: Float[np.ndarray, "4 4"], directions: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 3"]]:
    """Depth z [mm] (inf where the ray misses) and normal in the camera frame, along rays (x, y, 1) from the camera."""
    R, t = T_cam_obj[:3, :3], T_cam_obj[:3, 3]
    rays = np.empty((len(directions), 6), np.float32)
    rays[:, :3], rays[:, 3:] = -R.T @ t, directions @ R
    hit = model.caster.cast_rays(o3d.core.Tensor(rays), nthreads=1)
    normal = hit["primitive_normals"].numpy().astype(float) @ R.T
    return hit["t_hit"].numpy().astype(float), np.where((normal[:, 2:] > 0), -normal, normal)
