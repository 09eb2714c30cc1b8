"""Light that reaches a surface by way of others: two interreflections of a scene, by tracing paths at random."""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

from collections.abc import Sequence

import numpy as np
import warp as wp
from jaxtyping import Float, Int

from itree_kernels.apparent import checked_lights
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError
from itree_kernels.instances import Instances, Material, common_device, scene_instances
from itree_kernels.lit_scene import LitScene, blocked, misses_sphere, render_scene
from itree_kernels.mesh import RayMesh
from itree_kernels.rays import camera_vector, ray_direction, surface_point
from itree_kernels.threads import launch_in_chunks
from itree_kernels.warp_start import load_kernel

FAR = 1.0e30  # [mm], beyond every hit


@wp.func
def nearest_hit(scene: Instances, X_cam: wp.vec3, unit: wp.vec3):
    """(instance or -1, triangle, distance [mm]) of the first surface on a ray."""
    nearest = float(FAR)
    best = wp.int32(-1)
    triangle = wp.int32(0)
    for k in range(scene.mesh.shape[0]):
        if misses_sphere(X_cam, unit, scene.centre_cam[k], 1.01 * scene.radius[k]):
            continue
        R_obj_cam = wp.transpose(scene.R_cam_obj[k])
        reach = wp.min(nearest, wp.dot(scene.centre_cam[k] - X_cam, unit) + 1.01 * scene.radius[k])
        hit = wp.mesh_query_ray(scene.mesh[k], R_obj_cam * (X_cam - scene.t_cam_obj[k]), R_obj_cam * unit, reach)
        if hit.result:
            nearest = hit.t
            best = k
            triangle = hit.face
    return best, triangle, nearest


@wp.func
def scattered(state: wp.uint32, normal: wp.vec3) -> wp.vec3:
    """A direction above a surface, as often as the cosine with its normal is large."""
    return wp.normalize(normal + wp.sample_unit_sphere_surface(state))


@wp.kernel(enable_backward=False)
def reflected_kernel(
    # In:
    scene: Instances,
    normals_obj: wp.array(dtype=wp.vec3),
    camera: wp.vec4,
    orthographic: int,
    lights: wp.array(dtype=wp.vec3),
    intensities: wp.array(dtype=float),
    samples: int,
    seed: int,
    instance: wp.array2d(dtype=wp.int16),
    depth: wp.array2d(dtype=float),
    normals: wp.array2d(dtype=wp.vec3),
    first_row: int,
    # Out:
    images_out: wp.array3d(dtype=float),
):
    row, j = wp.tid()
    i = first_row + row
    first = int(instance[i, j])
    if first < 0:
        return
    normal_first = normals[i, j]
    if wp.dot(normal_first, ray_direction(float(j), float(i), camera, orthographic)) >= 0.0:
        return
    X_first = surface_point(float(j), float(i), depth[i, j], camera, orthographic)
    X_first = X_first + scene.shadow_offset[first] * normal_first
    state = wp.rand_init(seed, i * images_out.shape[2] + j)
    for _ in range(samples):
        X_cam = X_first
        normal = normal_first
        share = scene.albedo[first] / float(samples)
        for _bounce in range(2):
            direction = scattered(state, normal)
            state = state + wp.uint32(747796405)
            best, triangle, distance = nearest_hit(scene, X_cam, direction)
            if best < 0:
                break
            normal = scene.R_cam_obj[best] * normals_obj[scene.first_triangle[best] + triangle]
            if wp.dot(normal, direction) >= 0.0:
                break
            X_cam = X_cam + distance * direction + scene.shadow_offset[best] * normal
            share = share * scene.albedo[best]
            for n in range(lights.shape[0]):
                cosine = wp.dot(normal, lights[n])
                if cosine > 0.0:  # noqa: SIM102 (the kernel language evaluates both sides of an `and`)
                    if not blocked(scene, X_cam, lights[n]):
                        images_out[n, i, j] = images_out[n, i, j] + share * intensities[n] * cosine


def reflected_light(
    meshes: Sequence[RayMesh],
    mesh_of_instance: Sequence[int] | Int[np.ndarray, "instances"],
    R_cam_obj: Float[np.ndarray, "instances 3 3"],
    t_cam_obj: Float[np.ndarray, "instances 3"],
    camera: Camera,
    light_directions: Float[np.ndarray, "lights 3"],
    light_intensities: Float[np.ndarray, "lights"],
    material: Material,
    samples: int,
    seed: int = 0,
    shown: LitScene | None = None,
) -> Float[np.ndarray, "lights height width"]:
    """What one and two interreflections add to the images of `render_scene` (the Lambertian part of the material).

    Each pixel's `samples` paths scatter by the cosine law; the mean has their spread, some 5 % / sqrt(samples) of full
    albedo between parts. `shown`: what `render_scene` made of the same scene, if it did. The same seed gives the same
    images, on any number of threads. Raises ItreeError when the arrays do not match in length or `samples` is not
    positive.
    """
    lights = checked_lights(light_directions)
    intensities = np.ascontiguousarray(light_intensities, dtype=np.float32)
    if intensities.shape != (len(lights),) or samples < 1:
        raise ItreeError(
            f"{len(lights)} light directions need as many intensities, not {intensities.shape}, and at least one "
            f"sample, not {samples}"
        )
    if shown is None:
        shown = render_scene(
            meshes, mesh_of_instance, R_cam_obj, t_cam_obj, camera, light_directions, light_intensities, material
        )
    device = common_device(meshes)
    scene = scene_instances(meshes, mesh_of_instance, R_cam_obj, t_cam_obj, material, device)
    images = wp.zeros((len(lights), camera.height, camera.width), dtype=float, device=device)
    inputs = [
        scene, wp.array(np.concatenate([mesh.triangle_normals for mesh in meshes]), dtype=wp.vec3, device=device),
        camera_vector(camera), int(camera.is_orthographic), wp.array(lights, dtype=wp.vec3, device=device),
        wp.array(intensities, dtype=float, device=device), int(samples), int(seed),
        wp.array(shown.instance, dtype=wp.int16, device=device), wp.array(shown.depth, dtype=float, device=device),
        wp.array(shown.normal, dtype=wp.vec3, device=device),
    ]  # fmt: skip

    def trace_rows(first: int, last: int) -> None:
        dim = (last - first, camera.width)
        wp.launch(reflected_kernel, dim=dim, inputs=[*inputs, first], outputs=[images], device=device)

    load_kernel(reflected_kernel, device)
    launch_in_chunks(trace_rows, camera.height, rays_each=camera.width * samples * 2, device=device)
    return images.numpy()
