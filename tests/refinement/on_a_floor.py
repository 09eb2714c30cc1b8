"""The paper's part on a floor, seen by two cameras."""

import numpy as np
import trimesh
from itree_cad.bundled import bundled_part
from itree_kernels.instances import Material
from itree_kernels.mesh import ray_mesh
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from itree_jax.refinement.optimise import Hypotheses, RefineModel, padded_normals
from itree_jax.sight import Sight, look
from itree_jax.tree.appearances import mesh_reach

from ..stereo.two_views import CAMERA, as_mesh, converging, two_views

PART = bundled_part("ikeuchi-1987")
MESH = ray_mesh(PART.vertices, PART.triangles, PART.face_of_triangle, device="cpu")
MODEL = RefineModel(MESH, padded_normals(MESH.triangle_normals), mesh_reach(MESH), PART.diameter)
R = Rotation.from_euler("xyz", [28, 12, 20], degrees=True).as_matrix()
T = np.array([-4.0, 3.0, 872.0])
SPACING = np.radians(20.0)  # of a dome


def seen_by_two_cameras() -> tuple[Sight, Bool[np.ndarray, "height width"]]:
    """What was seen, and which pixels of the first camera show the part."""
    floor = as_mesh(trimesh.creation.box((900, 900, 10)))
    material = Material(np.array([0.4, 0.05]), np.zeros(2), 10.0)
    poses = np.stack([R, np.eye(3)]), np.stack([T, [0.0, 0.0, 905.0]])
    views = two_views([MESH, floor], *poses, material, CAMERA, *converging(), seed=3)
    return look(views.images, views.sensor, None, second=views.second), views.lit.instance == 0


def rim_errors(poses: Hypotheses) -> Float[np.ndarray, "hypotheses"]:
    """How far [mm] a point of the part is off at most."""
    true = PART.vertices @ R.T + T
    there = [PART.vertices @ np.asarray(R_one, float).T + t_one for R_one, t_one in zip(*poses, strict=True)]
    return np.linalg.norm(np.stack(there) - true, axis=-1).max(axis=1)
