"""The instances of a scene, as arrays that a kernel can loop over."""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp
from jaxtyping import Float, Int

from itree_kernels.errors import ItreeError
from itree_kernels.mesh import RayMesh

CAMERA_ROUNDING = 2e-6  # of the distance to the camera: float32 points there are known to about this


@dataclass(frozen=True)
class Material:
    """Reflectance of each instance (or one number for all): Lambertian plus a Blinn-Phong lobe.

    Under a light of intensity E from l, seen from v, with h halfway between:
    `E (albedo max(n.l, 0) + specular max(n.h, 0)^exponent)`, the lobe only where n.l > 0.
    """

    albedo: Float[np.ndarray, "instances"] | float = 0.7
    specular: Float[np.ndarray, "instances"] | float = 0.0  # height of the lobe at its peak
    exponent: Float[np.ndarray, "instances"] | float = 20.0


@wp.struct
class Instances:
    """Arrays over the instances of a scene."""

    mesh: wp.array(dtype=wp.uint64)
    R_cam_obj: wp.array(dtype=wp.mat33)
    t_cam_obj: wp.array(dtype=wp.vec3)
    centre_cam: wp.array(dtype=wp.vec3)
    radius: wp.array(dtype=float)
    shadow_offset: wp.array(dtype=float)
    first_triangle: wp.array(dtype=int)
    albedo: wp.array(dtype=float)
    specular: wp.array(dtype=float)
    exponent: wp.array(dtype=float)


def common_device(meshes: Sequence[RayMesh]) -> str:
    """The one device that all meshes are on. Raises ItreeError when there is none, or more than one."""
    devices = sorted({mesh.device for mesh in meshes})
    if len(devices) != 1:
        raise ItreeError(f"a scene needs one or more meshes on one device, not {len(meshes)} meshes on {devices}")
    return devices[0]


def scene_instances(
    meshes: Sequence[RayMesh],
    mesh_of_instance: Sequence[int] | Int[np.ndarray, "instances"],
    R_cam_obj: Float[np.ndarray, "instances 3 3"],
    t_cam_obj: Float[np.ndarray, "instances 3"],
    material: Material,
    device: str,
) -> Instances:
    """Instance k is `meshes[mesh_of_instance[k]]` at pose (R, t) [mm] part -> camera.

    Raises ItreeError when the arrays do not match in length or name a mesh that is not there.
    """
    which = np.asarray(mesh_of_instance, dtype=np.int64)
    count = len(which)
    R, t = np.asarray(R_cam_obj, dtype=np.float64), np.asarray(t_cam_obj, dtype=np.float64)
    if R.shape != (count, 3, 3) or t.shape != (count, 3):
        raise ItreeError(
            f"{count} instances need rotations ({count}, 3, 3) and translations ({count}, 3), "
            f"not {R.shape} and {t.shape}"
        )
    if count > np.iinfo(np.int16).max or np.any((which < 0) | (which >= len(meshes))):
        raise ItreeError(f"mesh_of_instance must name one of the {len(meshes)} meshes, for at most 32767 instances")
    used = [meshes[k] for k in which]
    first_triangle = np.concatenate([[0], np.cumsum([len(mesh.triangles) for mesh in meshes])])[which]
    centres = np.array([R[k] @ mesh.centre + t[k] for k, mesh in enumerate(used)]).reshape(count, 3)
    offsets = np.array([mesh.shadow_offset for mesh in used]) + CAMERA_ROUNDING * np.linalg.norm(centres, axis=1)
    scene = Instances()
    scene.mesh = wp.array(np.array([mesh.warp_mesh.id for mesh in used], np.uint64), dtype=wp.uint64, device=device)
    scene.R_cam_obj = wp.array(R.astype(np.float32), dtype=wp.mat33, device=device)
    scene.t_cam_obj = wp.array(t.astype(np.float32), dtype=wp.vec3, device=device)
    scene.centre_cam = wp.array(centres.astype(np.float32), dtype=wp.vec3, device=device)
    scene.radius = _per_instance("radius", [mesh.radius for mesh in used], count, device)
    scene.shadow_offset = _per_instance("shadow offset", offsets, count, device)
    scene.first_triangle = wp.array(first_triangle.astype(np.int32), dtype=wp.int32, device=device)
    scene.albedo = _per_instance("albedo", material.albedo, count, device)
    scene.specular = _per_instance("specular", material.specular, count, device)
    scene.exponent = _per_instance("exponent", material.exponent, count, device)
    return scene


def _per_instance(name: str, value: object, count: int, device: str) -> wp.array:
    values = np.asarray(value, dtype=np.float32)
    if values.shape not in ((), (count,)):
        raise ItreeError(f"{name} has shape {values.shape}: give one number, or one for each of the {count} instances")
    return wp.array(np.broadcast_to(values, (count,)).copy(), dtype=wp.float32, device=device)
