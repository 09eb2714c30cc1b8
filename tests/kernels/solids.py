"""Meshes, cameras and lights of the tests."""

import numpy as np
import trimesh
from itree_kernels.camera import Camera
from itree_kernels.mesh import RayMesh, ray_mesh
from scipy.spatial.transform import Rotation

LIGHTS = np.array([(0, -0.5736, -0.8192), (-0.4967, 0.2868, -0.8192), (0.4967, 0.2868, -0.8192)])
LIGHTS /= np.linalg.norm(LIGHTS, axis=1, keepdims=True)
SLANT_LIMIT = np.deg2rad(42.0)

ORTHOGRAPHIC = Camera("orthographic", 1.4, 1.45, 31.63, 31.37, 64, 64)
PINHOLE = Camera("pinhole", 200.0, 205.0, 31.63, 31.37, 64, 64)


def as_ray_mesh(solid: trimesh.Trimesh, faces=None) -> RayMesh:
    """Each triangle its own component face, unless `faces` says otherwise."""
    return ray_mesh(solid.vertices, solid.faces, np.arange(len(solid.faces)) if faces is None else faces, device="cpu")


def small_solids() -> dict[str, RayMesh]:
    """The torus casts shadows on itself; the others are convex."""
    return {
        "box": as_ray_mesh(trimesh.creation.box((30, 22, 14))),
        "cylinder": as_ray_mesh(trimesh.creation.cylinder(radius=12, height=26, sections=24)),
        "sphere": as_ray_mesh(trimesh.creation.icosphere(subdivisions=2, radius=17)),
        "torus": as_ray_mesh(trimesh.creation.torus(14, 6, major_sections=16, minor_sections=8)),
    }


def random_poses(count: int, seed: int, distance=150.0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    R_cam_obj = Rotation.random(count, random_state=np.random.RandomState(seed)).as_matrix()
    t_cam_obj = np.column_stack([rng.uniform(-3, 3, (count, 2)), distance + rng.uniform(-5, 5, count)])
    return R_cam_obj, t_cam_obj


def facing_plane(half: float) -> RayMesh:
    """A square in z = 0 whose outward normal is -z: it faces a camera that looks along +z."""
    corners = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]], float)
    return ray_mesh(corners, np.array([[0, 2, 1], [0, 3, 2]]), np.zeros(2, int), device="cpu")
