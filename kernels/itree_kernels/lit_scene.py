"""Images of many parts in a bin, one for each distant light, with the shadows that they cast on one another."""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp
from jaxtyping import Bool, Float, Int, Int16

from itree_kernels.apparent import checked_lights
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError
from itree_kernels.instances import Instances, Material, common_device, scene_instances
from itree_kernels.mesh import RayMesh
from itree_kernels.rays import camera_vector, depth_before_sphere, ray_direction, ray_origin
from itree_kernels.threads import launch_in_chunks
from itree_kernels.warp_start import load_kernel

FAR = 1.0e30  # [mm], beyond every hit


@dataclass(frozen=True, eq=False)
class LitScene:
    """Pixel maps of one camera image."""

    images: Float[np.ndarray, "lights height width"]  # linear intensity, 1.0 = full scale; not clipped
    depth: Float[np.ndarray, "height width"]  # z in the camera frame [mm], 0 where nothing
    instance: Int16[np.ndarray, "height width"]  # -1 where nothing
    face: Int16[np.ndarray, "height width"]  # component face of that instance's mesh, -1 where nothing
    normal: Float[np.ndarray, "height width 3"]  # outward triangle normal, camera frame; 0 where nothing
    lit: Bool[np.ndarray, "lights height width"]  # neither attached nor cast shadow


@wp.func
def misses_sphere(X: wp.vec3, unit: wp.vec3, centre: wp.vec3, radius: float) -> bool:
    """Whether the ray from X misses a sphere, or leaves it behind."""
    along = wp.dot(centre - X, unit)
    aside = wp.length_sq(centre - X) - along * along
    return aside > radius * radius or along < -radius


@wp.func
def blocked(scene: Instances, X_cam: wp.vec3, light: wp.vec3) -> bool:
    """Whether any instance stands between a point and a distant light."""
    for k in range(scene.mesh.shape[0]):
        if misses_sphere(X_cam, light, scene.centre_cam[k], 1.01 * scene.radius[k]):
            continue
        R_obj_cam = wp.transpose(scene.R_cam_obj[k])
        reach = wp.dot(scene.centre_cam[k] - X_cam, light) + 1.01 * scene.radius[k]
        X_obj = R_obj_cam * (X_cam - scene.t_cam_obj[k])
        if wp.mesh_query_ray_anyhit(scene.mesh[k], X_obj, R_obj_cam * light, reach):
            return True
    return False


@wp.kernel(enable_backward=False)
def lit_scene_kernel(
    # In:
    scene: Instances,
    normals_obj: wp.array(dtype=wp.vec3),
    face_ids: wp.array(dtype=wp.int16),
    camera: wp.vec4,
    orthographic: int,
    lights: wp.array(dtype=wp.vec3),
    intensities: wp.array(dtype=float),
    ambient: float,
    first_row: int,
    # Out:
    images_out: wp.array3d(dtype=float),
    depth_out: wp.array2d(dtype=float),
    instance_out: wp.array2d(dtype=wp.int16),
    face_out: wp.array2d(dtype=wp.int16),
    normal_out: wp.array2d(dtype=wp.vec3),
    lit_out: wp.array3d(dtype=wp.bool),
):
    row, j = wp.tid()
    i = first_row + row
    origin = ray_origin(float(j), float(i), camera, orthographic)
    direction = ray_direction(float(j), float(i), camera, orthographic)
    length = wp.length(direction)
    nearest = float(FAR)
    best = wp.int32(-1)
    triangle = wp.int32(0)
    X_cam = wp.vec3(0.0, 0.0, 0.0)
    for k in range(scene.mesh.shape[0]):
        start = depth_before_sphere(origin, direction, scene.centre_cam[k], scene.radius[k], orthographic)
        X_start = origin + start * direction
        if start > nearest or misses_sphere(X_start, direction / length, scene.centre_cam[k], 1.01 * scene.radius[k]):
            continue
        R_obj_cam = wp.transpose(scene.R_cam_obj[k])
        unit_obj = R_obj_cam * direction / length
        max_t = wp.min(2.1 * scene.radius[k], (nearest - start) * length)
        hit = wp.mesh_query_ray(scene.mesh[k], R_obj_cam * (X_start - scene.t_cam_obj[k]), unit_obj, max_t)
        if hit.result:
            nearest = start + hit.t / length
            best = k
            triangle = hit.face
            X_obj = wp.mesh_eval_position(scene.mesh[k], hit.face, hit.u, hit.v)
            X_cam = scene.R_cam_obj[k] * X_obj + scene.t_cam_obj[k]
    instance_out[i, j] = wp.int16(best)
    if best < 0:
        face_out[i, j] = wp.int16(-1)
        depth_out[i, j] = 0.0
        normal_out[i, j] = wp.vec3(0.0, 0.0, 0.0)
        for n in range(lights.shape[0]):
            images_out[n, i, j] = 0.0
            lit_out[n, i, j] = False
        return
    normal = scene.R_cam_obj[best] * normals_obj[scene.first_triangle[best] + triangle]
    above = X_cam + scene.shadow_offset[best] * normal
    to_viewer = -direction / length
    front = wp.dot(normal, to_viewer) > 0.0
    for n in range(lights.shape[0]):
        cosine = wp.dot(normal, lights[n])
        lit = wp.bool(False)
        if front and cosine > 0.0:
            lit = not blocked(scene, above, lights[n])
        reflected = scene.albedo[best] * ambient
        if lit:
            halfway = wp.normalize(lights[n] + to_viewer)
            lobe = wp.pow(wp.max(wp.dot(normal, halfway), 0.0), scene.exponent[best])
            reflected += scene.albedo[best] * cosine + scene.specular[best] * lobe
        images_out[n, i, j] = intensities[n] * reflected
        lit_out[n, i, j] = lit
    depth_out[i, j] = nearest
    face_out[i, j] = face_ids[scene.first_triangle[best] + triangle]
    normal_out[i, j] = normal


def render_scene(
    meshes: Sequence[RayMesh],
    mesh_of_instance: Sequence[int] | Int[np.ndarray, "instances"],
    R_cam_obj: Float[np.ndarray, "instances 3 3"],
    t_cam_obj: Float[np.ndarray, "instances 3"],
    camera: Camera,
    light_directions: Float[np.ndarray, "lights 3"],
    light_intensities: Float[np.ndarray, "lights"],
    material: Material,
    ambient: float = 0.0,
) -> LitScene:
    """Renders one image for each light: one ray a pixel, shadows between all instances.

    Instance k is `meshes[mesh_of_instance[k]]` at the pose (R, t) [mm] part -> camera; a bin is just an instance.
    Lights are unit vectors toward the light in the camera frame. `ambient` is the fraction of a light's intensity that
    reaches every point whatever its normal and shadows. Images carry no noise: see `noise.sensor_noise`.
    Returns finished NumPy arrays. Raises ItreeError when the arrays do not match in length.
    """
    lights = checked_lights(light_directions)
    intensities = np.ascontiguousarray(light_intensities, dtype=np.float32)
    if intensities.shape != (len(lights),):
        raise ItreeError(f"{len(lights)} light directions but intensities of shape {intensities.shape}")
    device = common_device(meshes)
    scene = scene_instances(meshes, mesh_of_instance, R_cam_obj, t_cam_obj, material, device)
    shape = (camera.height, camera.width)
    images = wp.empty((len(lights), *shape), dtype=float, device=device)
    depth = wp.empty(shape, dtype=float, device=device)
    instance = wp.empty(shape, dtype=wp.int16, device=device)
    face = wp.empty(shape, dtype=wp.int16, device=device)
    normal = wp.empty(shape, dtype=wp.vec3, device=device)
    lit = wp.empty((len(lights), *shape), dtype=wp.bool, device=device)
    inputs = [
        scene,
        wp.array(np.concatenate([mesh.triangle_normals for mesh in meshes]), dtype=wp.vec3, device=device),
        wp.array(np.concatenate([mesh.face_of_triangle for mesh in meshes]).astype(np.int16), device=device),
        camera_vector(camera),
        int(camera.is_orthographic),
        wp.array(lights, dtype=wp.vec3, device=device),
        wp.array(intensities, dtype=float, device=device),
        float(ambient),
    ]
    outputs = [images, depth, instance, face, normal, lit]

    def render_rows(first: int, last: int) -> None:
        dim = (last - first, camera.width)
        wp.launch(lit_scene_kernel, dim=dim, inputs=[*inputs, first], outputs=outputs, device=device)

    load_kernel(lit_scene_kernel, device)
    launch_in_chunks(render_rows, camera.height, rays_each=camera.width * (1 + len(lights)), device=device)
    return LitScene(images.numpy(), depth.numpy(), instance.numpy(), face.numpy(), normal.numpy(), lit.numpy())
