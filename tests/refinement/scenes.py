"""Parts, cameras and noise-free scenes of the refinement tests."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from itree_cad.part import Part
from itree_kernels.camera import Camera
from itree_kernels.instances import Material
from itree_kernels.lit_scene import LitScene, render_scene
from itree_kernels.mesh import RayMesh, ray_mesh

from itree_jax.refinement.observed import ObservedMaps, observe
from itree_jax.refinement.optimise import RefineModel
from itree_jax.refinement.residuals import Deviations
from itree_jax.refinement.verify import Tolerances

PINHOLE = Camera("pinhole", 600.0, 605.0, 100.3, 90.6, 200, 180)
DISTANCE = 400.0  # [mm]; a pixel is 0.66 mm there
JUMP = 3.0  # [mm], a slant of 77 degrees
DEVIATIONS = Deviations(*(jnp.float32(v) for v in (0.1, 0.02, 4.0, 0.05, 0.03, 0.6, 0.5, 0.15, 8.0)))
TOLERANCES = Tolerances(jnp.float32(1.0), jnp.float32(np.radians(20.0)), jnp.float32(JUMP))


def model_of(part: Part, reach: float | None = None) -> RefineModel:
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle, device="cpu")
    least = float(np.linalg.norm(mesh.vertices, axis=1).max())
    return RefineModel(mesh, jnp.asarray(mesh.triangle_normals), reach or least, part.diameter)


def plane(z: float, low=(-500.0, -500.0), high=(500.0, 500.0)) -> RayMesh:
    """A rectangle [mm] in the camera frame that faces the camera."""
    (x0, y0), (x1, y1) = low, high
    corners = np.array([[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]], float)
    return ray_mesh(corners, np.array([[0, 2, 1], [0, 3, 2]]), np.zeros(2, int), device="cpu")


def centred(model: RefineModel, R_cam_obj, uv=(103.0, 87.0), distance=DISTANCE, camera=PINHOLE) -> np.ndarray:
    """t that puts the middle of the part on the ray of an image point."""
    X = camera.unproject(np.array(uv), np.array(distance))
    return X - R_cam_obj @ model.mesh.centre


class Seen(NamedTuple):
    lit: LitScene  # instance 0 is the part
    maps: ObservedMaps


def seen(model: RefineModel, R, t, others=(), camera=PINHOLE, jump=JUMP, needles=True) -> Seen:
    """A part and planes of the camera frame, without noise; the part's needles only. `jump`: inf for no edges."""
    meshes = [model.mesh, *others]
    count = len(others)
    R_all = np.concatenate([np.asarray(R)[None], np.tile(np.eye(3), (count, 1, 1))])
    t_all = np.concatenate([np.asarray(t)[None], np.zeros((count, 3))])
    light = np.array([[0.0, 0.0, -1.0]])
    lit = render_scene(meshes, list(range(count + 1)), R_all, t_all, camera, light, np.ones(1), Material())
    weight = (lit.instance == 0).astype(np.float32) * needles
    return Seen(lit, observe(lit.normal, weight, lit.depth, jump))


def floor_below(model: RefineModel, t) -> RayMesh:
    return plane(float(t[2]) + 1.2 * model.reach)
