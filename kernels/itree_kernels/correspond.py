"""Rays for refinement: what each hypothesis predicts at the pixels of its window, and where its occluding contour runs.

One launch serves all hypotheses of all regions. Windows have a fixed size and integer pixel positions, so that arrays
keep their shapes and observed maps are read without interpolation.
"""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

from dataclasses import dataclass

import numpy as np
import warp as wp
from jaxtyping import Float, Int

from itree_kernels.camera import Camera
from itree_kernels.mesh import RayMesh
from itree_kernels.rays import camera_vector, ray_direction, ray_origin
from itree_kernels.threads import launch_in_chunks
from itree_kernels.warp_start import load_kernel

CONTOUR_ERROR = 0.5  # [px] a contour point is found to about this, or to 1/4 of the stride if that is less


@dataclass(frozen=True)
class Correspondences:
    """What hypothesis h predicts at window pixel (i, j), that is at image point `origin_uv[h] + stride * (j, i)`."""

    depth: Float[np.ndarray, "hypotheses s s"]  # z [mm], 0 where the ray misses the part
    triangle: Int[np.ndarray, "hypotheses s s"]  # triangle hit, -1 where none
    contour_uv: Float[np.ndarray, "hypotheses 2 s s 2"]  # contour crossing toward the right / lower neighbour [px]
    contour_depth: Float[np.ndarray, "hypotheses 2 s s"]  # z [mm] of the near side there, 0 where no contour


@wp.func
def cast(mesh: wp.uint64, R: wp.mat33, t: wp.vec3, u: float, v: float, camera: wp.vec4, orthographic: int,
         near: float):
    """(triangle or -1, z [mm]). The direction has z = 1 in the camera frame, so that the ray's parameter is z."""
    origin = ray_origin(u, v, camera, orthographic)
    direction = ray_direction(u, v, camera, orthographic)
    # start just before the part: distances stay small, and an orthographic camera may stand anywhere
    start = t[2] - near
    o = wp.transpose(R) * (origin + start * direction - t)
    d = wp.transpose(R) * direction
    length = wp.length(d)
    query = wp.mesh_query_ray(mesh, o, d / length, 4.0 * near)
    if query.result:
        return query.face, start + query.t / length
    return -1, 0.0


@wp.kernel(enable_backward=False)
def window_kernel(
    # In:
    mesh: wp.uint64,
    R_cam_obj: wp.array(dtype=wp.mat33),
    t_cam_obj: wp.array(dtype=wp.vec3),
    origin_uv: wp.array(dtype=wp.vec2),
    camera: wp.vec4,
    orthographic: int,
    near: float,
    stride: float,
    first: int,
    # Out:
    depth_out: wp.array3d(dtype=float),
    triangle_out: wp.array3d(dtype=int),
):
    k, i, j = wp.tid()
    h = first + k
    u = origin_uv[h][0] + stride * float(j)
    v = origin_uv[h][1] + stride * float(i)
    triangle, z = cast(mesh, R_cam_obj[h], t_cam_obj[h], u, v, camera, orthographic, near)
    depth_out[h, i, j] = z
    triangle_out[h, i, j] = triangle


@wp.kernel(enable_backward=False)
def contour_kernel(
    # In:
    mesh: wp.uint64,
    R_cam_obj: wp.array(dtype=wp.mat33),
    t_cam_obj: wp.array(dtype=wp.vec3),
    origin_uv: wp.array(dtype=wp.vec2),
    camera: wp.vec4,
    orthographic: int,
    near: float,
    stride: float,
    jump: float,
    bisections: int,
    crease: float,
    first: int,
    depth: wp.array3d(dtype=float),
    triangle: wp.array3d(dtype=int),
    normal_obj: wp.array(dtype=wp.vec3),
    # Out:
    contour_uv_out: wp.array(dtype=wp.vec2, ndim=4),
    contour_depth_out: wp.array(dtype=float, ndim=4),
):
    k, side, i, j = wp.tid()
    h = first + k
    s = depth.shape[1]
    i2 = i + side
    j2 = j + 1 - side
    contour_depth_out[h, side, i, j] = 0.0
    if i2 >= s or j2 >= s:
        return
    a = triangle[h, i, j]
    b = triangle[h, i2, j2]
    za = depth[h, i, j]
    zb = depth[h, i2, j2]
    if a < 0 and b < 0:
        return
    ua = origin_uv[h] + stride * wp.vec2(float(j), float(i))
    ub = origin_uv[h] + stride * wp.vec2(float(j2), float(i2))
    near_is_a = a >= 0
    if a >= 0 and b >= 0:
        # a contour where the farther point lies behind the tangent plane of the nearer one, not where depth differs
        near_is_a = za <= zb
        tri_near = wp.where(near_is_a, a, b)
        n = R_cam_obj[h] * normal_obj[tri_near]
        pa = ray_origin(ua[0], ua[1], camera, orthographic)
        pa = pa + za * ray_direction(ua[0], ua[1], camera, orthographic)
        pb = ray_origin(ub[0], ub[1], camera, orthographic)
        pb = pb + zb * ray_direction(ub[0], ub[1], camera, orthographic)
        gap = wp.dot(n, pb - pa)
        if not near_is_a:
            gap = -gap
        if gap > -jump or wp.abs(za - zb) < jump:
            if wp.dot(normal_obj[a], normal_obj[b]) >= crease:
                return
            # one surface that turns: its crease is where the normal changes sides
            for _ in range(bisections):
                middle = 0.5 * (ua + ub)
                tri, z = cast(mesh, R_cam_obj[h], t_cam_obj[h], middle[0], middle[1], camera, orthographic, near)
                if tri < 0 or wp.abs(z - za) > wp.abs(za - zb) + jump:
                    return
                if wp.dot(normal_obj[tri], normal_obj[a]) > wp.dot(normal_obj[tri], normal_obj[b]):
                    a = tri
                    ua = middle
                    za = z
                else:
                    b = tri
                    ub = middle
            if wp.dot(normal_obj[a], normal_obj[b]) < crease:
                contour_uv_out[h, side, i, j] = 0.5 * (ua + ub)
                contour_depth_out[h, side, i, j] = za
            return
    inside = wp.where(near_is_a, ua, ub)
    outside = wp.where(near_is_a, ub, ua)
    z_near = wp.where(near_is_a, za, zb)
    z_far = wp.where(near_is_a, zb, za)
    far_hit = a >= 0 and b >= 0
    for _ in range(bisections):
        middle = 0.5 * (inside + outside)
        tri, z = cast(mesh, R_cam_obj[h], t_cam_obj[h], middle[0], middle[1], camera, orthographic, near)
        is_near = tri >= 0
        if is_near and far_hit:
            is_near = wp.abs(z - z_near) < wp.abs(z - z_far)
        if is_near:
            inside = middle
            z_near = z
        else:
            outside = middle
            z_far = z
            far_hit = tri >= 0
    # a step stays, however near its two sides are; on a steep face beyond a crease it has shrunk with their distance
    if far_hit and wp.abs(z_far - z_near) < jump:
        return
    contour_uv_out[h, side, i, j] = 0.5 * (inside + outside)
    contour_depth_out[h, side, i, j] = z_near


def correspondences(
    mesh: RayMesh,
    R_cam_obj: Float[np.ndarray, "hypotheses 3 3"],
    t_cam_obj: Float[np.ndarray, "hypotheses 3"],
    camera: Camera,
    origin_uv: Float[np.ndarray, "hypotheses 2"],
    size: int,
    stride: int,
    reach: float,
    jump: float | None = None,
    crease: float | None = None,
) -> Correspondences:
    """Casts the rays of every hypothesis's window.

    `reach` [mm]: no point of the part is farther than this from its origin. `jump` [mm]: the least step between two
    surfaces that counts as an occluding contour; None leaves contours out. `crease` [rad]: where the surface turns by
    more from one triangle to the next, its crease is a contour point too; None: occluding contours alone.
    """
    count = len(R_cam_obj)
    device = mesh.device
    R = wp.array(np.ascontiguousarray(R_cam_obj, dtype=np.float32), dtype=wp.mat33, device=device)
    t = wp.array(np.ascontiguousarray(t_cam_obj, dtype=np.float32), dtype=wp.vec3, device=device)
    origin = wp.array(np.ascontiguousarray(origin_uv, dtype=np.float32), dtype=wp.vec2, device=device)
    depth = wp.empty((count, size, size), dtype=float, device=device)
    triangle = wp.empty((count, size, size), dtype=int, device=device)
    flag = int(camera.is_orthographic)
    common = [mesh.warp_mesh.id, R, t, origin, camera_vector(camera), flag, float(2.0 * reach), float(stride)]

    def cast_windows(first: int, last: int) -> None:
        wp.launch(window_kernel, dim=(last - first, size, size), inputs=[*common, first], outputs=[depth, triangle],
                  device=device)

    load_kernel(window_kernel, device)
    launch_in_chunks(cast_windows, count, rays_each=size * size, device=device)
    if jump is None:
        uv, z = np.zeros((count, 2, 0, 0, 2), np.float32), np.zeros((count, 2, 0, 0), np.float32)
        return Correspondences(depth.numpy(), triangle.numpy(), uv, z)
    uv = wp.zeros((count, 2, size, size), dtype=wp.vec2, device=device)
    z = wp.zeros((count, 2, size, size), dtype=float, device=device)

    # half of the last interval is the error: the middle is taken
    sharpest = -2.0 if crease is None else float(np.cos(crease))
    bisections = max(2, int(np.ceil(np.log2(stride / (2.0 * CONTOUR_ERROR)))))

    def find_contours(first: int, last: int) -> None:
        wp.launch(contour_kernel, dim=(last - first, 2, size, size),
                  inputs=[*common, float(jump), bisections, sharpest, first, depth, triangle, mesh.normals_obj],
                  outputs=[uv, z], device=device)

    load_kernel(contour_kernel, device)
    launch_in_chunks(find_contours, count, rays_each=2 * size * size, device=device)
    return Correspondences(depth.numpy(), triangle.numpy(), uv.numpy(), z.numpy())
