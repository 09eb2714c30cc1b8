"""Apparent shapes: what the sensor sees of one part in many views (Ikeuchi 1987, sec. 2.1.1 and 2.1.2).

A point is detectable when its slant is under the sensor's limit and no light is blocked there, by the surface itself
(attached shadow) or by another part of it (cast shadow). On a GPU, and of very fine meshes, one launch casts the rays
of all pixels of all views. On a CPU the same is found triangle by triangle, in the image and along the lights, several
times as fast (experiments/benchmarks/ray_casting.py).
"""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from jaxtyping import Bool, Float, Int16

from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError
from itree_kernels.mesh import RayMesh
from itree_kernels.raster import fills, raster_kernel, room_for_vertices
from itree_kernels.rays import camera_vector, depth_before_sphere, ray_direction, ray_origin
from itree_kernels.shadows import light_grid, shadow_kernel
from itree_kernels.threads import launch_in_chunks
from itree_kernels.warp_start import load_kernel


@dataclass(frozen=True, eq=False)
class ApparentShapes:
    """Pixel maps of each view. A back face (of an open mesh) is hit like any other, but never lit or detectable."""

    face: Int16[np.ndarray, "views height width"]  # component face, -1 where the ray hits nothing
    depth: Float[np.ndarray, "views height width"]  # z in the camera frame [mm], 0 where nothing
    normal: Float[np.ndarray, "views height width 3"]  # outward triangle normal, camera frame; 0 where nothing
    lit: Bool[np.ndarray, "views lights height width"]  # neither attached nor cast shadow
    detectable: Bool[np.ndarray, "views height width"]  # slant under the limit, and lit by every light


@wp.kernel(enable_backward=False)
def apparent_shapes_kernel(
    # In:
    mesh: wp.uint64,
    normals_obj: wp.array(dtype=wp.vec3),
    face_ids: wp.array(dtype=wp.int16),
    centre_obj: wp.vec3,
    radius: float,
    shadow_offset: float,
    R_cam_obj: wp.array(dtype=wp.mat33),
    t_cam_obj: wp.array(dtype=wp.vec3),
    camera: wp.vec4,
    orthographic: int,
    lights: wp.array(dtype=wp.vec3),
    cos_limit: float,
    first_row: int,
    # Out:
    face_out: wp.array3d(dtype=wp.int16),
    depth_out: wp.array3d(dtype=float),
    normal_out: wp.array3d(dtype=wp.vec3),
    lit_out: wp.array4d(dtype=wp.bool),
    detectable_out: wp.array3d(dtype=wp.bool),
):
    k, j = wp.tid()
    height = face_out.shape[1]
    view = (first_row + k) / height
    i = (first_row + k) % height
    R_obj_cam = wp.transpose(R_cam_obj[view])
    t = t_cam_obj[view]
    origin = ray_origin(float(j), float(i), camera, orthographic)
    direction = ray_direction(float(j), float(i), camera, orthographic)
    length = wp.length(direction)
    start = depth_before_sphere(origin, direction, R_cam_obj[view] * centre_obj + t, radius, orthographic)
    start_obj = R_obj_cam * (origin + start * direction - t)
    hit = wp.mesh_query_ray(mesh, start_obj, R_obj_cam * direction / length, 2.1 * radius)
    if not hit.result:
        face_out[view, i, j] = wp.int16(-1)
        depth_out[view, i, j] = 0.0
        normal_out[view, i, j] = wp.vec3(0.0, 0.0, 0.0)
        for n in range(lights.shape[0]):
            lit_out[view, n, i, j] = False
        detectable_out[view, i, j] = False
        return
    normal_obj = normals_obj[hit.face]
    normal = R_cam_obj[view] * normal_obj
    cos_slant = -wp.dot(normal, direction) / length
    # from the barycentric coordinates: the ray's own parameter has lost digits on its way here
    above = wp.mesh_eval_position(mesh, hit.face, hit.u, hit.v) + shadow_offset * normal_obj
    all_lit = wp.bool(True)
    for n in range(lights.shape[0]):
        lit = wp.bool(False)
        if cos_slant > 0.0 and wp.dot(normal, lights[n]) > 0.0:
            lit = not wp.mesh_query_ray_anyhit(mesh, above, R_obj_cam * lights[n], 2.1 * radius)
        lit_out[view, n, i, j] = lit
        all_lit = all_lit and lit
    face_out[view, i, j] = face_ids[hit.face]
    depth_out[view, i, j] = start + hit.t / length
    normal_out[view, i, j] = normal
    detectable_out[view, i, j] = all_lit and cos_slant > cos_limit


@wp.kernel(enable_backward=False)
def shading_kernel(
    # In:
    normals_obj: wp.array(dtype=wp.vec3),
    face_ids: wp.array(dtype=wp.int16),
    R_cam_obj: wp.array(dtype=wp.mat33),
    camera: wp.vec4,
    orthographic: int,
    lights: wp.array(dtype=wp.vec3),
    triangle: wp.array3d(dtype=int),
    first: int,
    # Out:
    face_out: wp.array3d(dtype=wp.int16),
    normal_out: wp.array3d(dtype=wp.vec3),
    lit_out: wp.array4d(dtype=wp.bool),
):
    """What a row of a filled image shows: whatever faces a light is lit until something stands in between."""
    k, i = wp.tid()
    view = first + k
    R = R_cam_obj[view]
    for j in range(triangle.shape[2]):
        hit = triangle[view, i, j]
        face = wp.int16(-1)
        normal = wp.vec3(0.0, 0.0, 0.0)
        if hit >= 0:
            face = face_ids[hit]
            normal = R * normals_obj[hit]
        seen = wp.dot(normal, ray_direction(float(j), float(i), camera, orthographic)) < 0.0
        face_out[view, i, j] = face
        normal_out[view, i, j] = normal
        for n in range(lights.shape[0]):
            lit_out[view, n, i, j] = seen and wp.dot(normal, lights[n]) > 0.0


@wp.kernel(enable_backward=False)
def detectable_kernel(
    # In:
    camera: wp.vec4,
    orthographic: int,
    cos_limit: float,
    normal: wp.array3d(dtype=wp.vec3),
    lit: wp.array4d(dtype=wp.bool),
    first: int,
    # Out:
    detectable_out: wp.array3d(dtype=wp.bool),
):
    """The same of what is detectable."""
    k, i = wp.tid()
    view = first + k
    for j in range(normal.shape[2]):
        direction = ray_direction(float(j), float(i), camera, orthographic)
        # where nothing is the normal is 0: neither is that seen, nor has it a slant
        toward_viewer = -wp.dot(normal[view, i, j], direction)
        detectable = toward_viewer > 0.0 and toward_viewer > cos_limit * wp.length(direction)
        for n in range(lit.shape[1]):
            detectable = detectable and lit[view, n, i, j]
        detectable_out[view, i, j] = detectable


def cast_apparent_shapes(
    mesh: RayMesh,
    R_cam_obj: Float[np.ndarray, "views 3 3"],
    t_cam_obj: Float[np.ndarray, "views 3"],
    camera: Camera,
    light_directions: Float[np.ndarray, "lights 3"],
    slant_limit: float,
) -> ApparentShapes:
    """What the rays of all pixels of all views of one part meet, and which lights reach it: on all cores of a CPU or on
    the mesh's CUDA device.

    Poses are part -> camera [mm]; lights are unit vectors from the scene toward the light, camera frame; `slant_limit`
    [rad] bounds the angle between the normal and the direction toward the viewer along the pixel's own ray.
    Memory is about (23 + lights) bytes a pixel and view: pass views in chunks. Returns finished NumPy arrays.
    Raises ItreeError when the numbers of rotations and translations differ, or a light is not a unit vector.
    """
    views, lights = len(R_cam_obj), checked_lights(light_directions)
    if len(t_cam_obj) != views:
        raise ItreeError(f"{views} rotations but {len(t_cam_obj)} translations: every view needs one of each")
    device, shape = mesh.device, (views, camera.height, camera.width)
    R, t = (np.ascontiguousarray(a, dtype=np.float32) for a in (R_cam_obj, t_cam_obj))
    maps = _Maps(
        wp.empty(shape, dtype=wp.int16, device=device), wp.empty(shape, dtype=float, device=device),
        wp.empty(shape, dtype=wp.vec3, device=device),
        wp.empty((views, len(lights), camera.height, camera.width), dtype=wp.bool, device=device),
        wp.empty(shape, dtype=wp.bool, device=device),
    )  # fmt: skip
    poses = wp.array(R, dtype=wp.mat33, device=device), wp.array(t, dtype=wp.vec3, device=device)
    toward_lights = wp.array(lights, dtype=wp.vec3, device=device)
    in_front = camera.is_orthographic or bool(((R @ mesh.centre + t)[:, 2] > mesh.radius).all())
    find = _filled if in_front and fills(mesh, camera.height * camera.width) else _cast
    find(mesh, *poses, camera, toward_lights, float(np.cos(slant_limit)), maps)
    return ApparentShapes(*(m.numpy() for m in maps))


class _Maps(NamedTuple):
    """Arrays on the device, as in `ApparentShapes`."""

    face: wp.array
    depth: wp.array
    normal: wp.array
    lit: wp.array
    detectable: wp.array


def _cast(
    mesh: RayMesh, R_cam_obj: wp.array, t_cam_obj: wp.array, camera: Camera, lights: wp.array, cos_limit: float,
    maps: _Maps,
) -> None:
    """By rays."""
    views, height, width = maps.depth.shape
    inputs = [
        mesh.warp_mesh.id, mesh.normals_obj, mesh.face_ids, wp.vec3(*mesh.centre.tolist()), mesh.radius,
        mesh.shadow_offset, R_cam_obj, t_cam_obj, camera_vector(camera), int(camera.is_orthographic), lights, cos_limit,
    ]  # fmt: skip

    def cast_rows(first: int, last: int) -> None:
        wp.launch(apparent_shapes_kernel, dim=(last - first, width), inputs=[*inputs, first], outputs=list(maps),
                  device=mesh.device)

    load_kernel(apparent_shapes_kernel, mesh.device)
    launch_in_chunks(cast_rows, views * height, rays_each=width * (1 + lights.shape[0]), device=mesh.device)


def _filled(
    mesh: RayMesh, R_cam_obj: wp.array, t_cam_obj: wp.array, camera: Camera, lights: wp.array, cos_limit: float,
    maps: _Maps,
) -> None:
    """Triangle by triangle, on a CPU."""
    views, height, width = maps.depth.shape
    count, device = lights.shape[0], mesh.device
    triangle = wp.empty(maps.depth.shape, dtype=int, device=device)
    origin = wp.zeros(views, dtype=wp.vec2, device=device)
    lens = camera_vector(camera), int(camera.is_orthographic)
    surface = [mesh.warp_mesh.points, mesh.warp_mesh.indices, mesh.normals_obj, int(mesh.is_closed)]
    sphere = [wp.vec3(*mesh.centre.tolist()), mesh.radius, mesh.shadow_offset]

    def fill_views(first: int, last: int) -> None:
        some = last - first
        wp.launch(
            raster_kernel, dim=some, device=device, outputs=[maps.depth, triangle],
            inputs=[*surface, R_cam_obj, t_cam_obj, origin, *lens, 1.0, first, room_for_vertices(mesh)],
        )
        wp.launch(
            shading_kernel, dim=(some, height), device=device, outputs=[maps.face, maps.normal, maps.lit],
            inputs=[mesh.normals_obj, mesh.face_ids, R_cam_obj, *lens, lights, triangle, first],
        )
        if count:
            wp.launch(
                shadow_kernel, dim=(some, count), device=device, outputs=[maps.lit],
                inputs=[
                    mesh.warp_mesh.id, *surface, *sphere, R_cam_obj, t_cam_obj, *lens, lights, maps.depth,
                    maps.normal, first, light_grid(mesh, height * width),
                ],
            )
        wp.launch(
            detectable_kernel, dim=(some, height), device=device, outputs=[maps.detectable],
            inputs=[*lens, cos_limit, maps.normal, maps.lit, first],
        )

    kernels: tuple[Any, ...] = (raster_kernel, shading_kernel, shadow_kernel, detectable_kernel)
    for kernel in kernels:
        load_kernel(kernel, device)
    launch_in_chunks(fill_views, views, rays_each=height * width * (1 + count), device=device)


def checked_lights(light_directions: Float[np.ndarray, "lights 3"]) -> Float[np.ndarray, "lights 3"]:
    """Light directions as float32. Raises ItreeError when one is not a unit vector (to 1e-3)."""
    lights = np.ascontiguousarray(light_directions, dtype=np.float32)
    if lights.ndim != 2 or lights.shape[1] != 3:
        raise ItreeError(f"light directions must have shape (lights, 3), not {lights.shape}")
    lengths = np.linalg.norm(lights, axis=1)
    if not np.all(np.abs(lengths - 1) < 1e-3):
        worst = int(np.argmax(np.abs(lengths - 1)))
        raise ItreeError(f"light {worst} has length {lengths[worst]:.4g}: give unit vectors toward the light")
    return lights
