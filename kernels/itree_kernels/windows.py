"""Windows of a batch of poses: where they lie in the image, and what rays find of the part in them."""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

from dataclasses import dataclass

import numpy as np
import warp as wp
from jaxtyping import Float

from itree_kernels.camera import Camera
from itree_kernels.mesh import RayMesh
from itree_kernels.raster import fills, raster_kernel, room_for_vertices
from itree_kernels.rays import camera_vector, ray_direction, ray_origin, surface_point
from itree_kernels.rim import ENDS, GOES_ON, rim_between
from itree_kernels.threads import launch_in_chunks
from itree_kernels.warp_start import load_kernel

CONTOUR_ERROR = 0.5  # [px] rays find a contour point to about this, or to 1/4 of the stride if that is less
HALFWAY = wp.constant(0)  # bisections: a contour is taken to lie in the middle, off by half a stride at most
BESIDE_RIM = wp.constant(0.1)  # of the way from a rim to the pixel beyond it: where what lies behind is asked for


@dataclass(frozen=True, eq=False)
class Windows:
    """Arrays on the device, a row per pose: the poses that rays were last cast at, and what the rays met.

    Window pixel (i, j) of pose h is image point `origin_uv[h] + stride * (j, i)`.
    """

    R_cam_obj: wp.array  # of mat33
    t_cam_obj: wp.array  # of vec3 [mm]
    origin_uv: wp.array  # of vec2 [px], whole numbers
    stale: wp.array  # of int: 1 where rays are to be cast again
    depth: wp.array  # [h, s, s] z [mm], 0 where the part is missed
    triangle: wp.array  # [h, s, s], -1 where the part is missed
    contour_uv: wp.array  # [h, 2, s, s] of vec2: crossing toward the right / lower neighbour [px]; may be empty
    contour_depth: wp.array  # [h, 2, s, s] z [mm] of the near side there
    contour_column: wp.array  # [h, 2, s, s + 1] of int: columns of each row with a contour, ended by -1: of others
    # nothing is written
    size: int
    stride: int
    device: str

    @property
    def count(self) -> int:
        return self.stale.shape[0]

    @property
    def with_contours(self) -> bool:
        return self.contour_depth.shape[2] > 0


def windows(
    R_cam_obj: Float[np.ndarray, "h 3 3"], t_cam_obj: Float[np.ndarray, "h 3"], origin_uv: Float[np.ndarray, "h 2"],
    size: int, stride: int, device: str, contours: bool = True,
) -> Windows:
    """Windows of `size` x `size` pixels every `stride` pixels, no ray cast yet. Until then their memory is not touched.
    """
    count, side = len(R_cam_obj), size if contours else 0

    def on_device(array: np.ndarray, kind: type) -> wp.array:
        return wp.array(np.ascontiguousarray(array, dtype=np.float32), dtype=kind, device=device)

    return Windows(
        on_device(R_cam_obj, wp.mat33), on_device(t_cam_obj, wp.vec3), on_device(origin_uv, wp.vec2),
        wp.full(count, 1, dtype=int, device=device),
        wp.empty((count, size, size), dtype=float, device=device),
        wp.empty((count, size, size), dtype=int, device=device),
        wp.empty((count, 2, side, side), dtype=wp.vec2, device=device),
        wp.empty((count, 2, side, side), dtype=float, device=device),
        wp.empty((count, 2, side, side + 1), dtype=int, device=device),
        size, stride, device,
    )


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
    stale: wp.array(dtype=int),
    # Out:
    depth_out: wp.array3d(dtype=float),
    triangle_out: wp.array3d(dtype=int),
):
    k, i, j = wp.tid()
    h = first + k
    if stale[h] == 0:
        return
    u = origin_uv[h][0] + stride * float(j)
    v = origin_uv[h][1] + stride * float(i)
    triangle, z = cast(mesh, R_cam_obj[h], t_cam_obj[h], u, v, camera, orthographic, near)
    depth_out[h, i, j] = z
    triangle_out[h, i, j] = triangle


@wp.func
def crease_between(
    mesh: wp.uint64, R: wp.mat33, t: wp.vec3, camera: wp.vec4, orthographic: int, near: float, jump: float,
    bisections: int, crease: float, normal_obj: wp.array(dtype=wp.vec3), a: int, b: int, za: float, zb: float,
    ua: wp.vec2, ub: wp.vec2,
):
    """(image point [px], z [mm]) of the crease between two pixels of one surface; z = 0 where it only bends."""
    reach = wp.abs(za - zb) + jump
    for _ in range(bisections):
        middle = 0.5 * (ua + ub)
        tri, z = cast(mesh, R, t, middle[0], middle[1], camera, orthographic, near)
        if tri < 0 or wp.abs(z - za) > reach:
            return middle, 0.0
        if wp.dot(normal_obj[tri], normal_obj[a]) > wp.dot(normal_obj[tri], normal_obj[b]):
            a = tri
            ua = middle
            za = z
        else:
            b = tri
            ub = middle
    found = wp.dot(normal_obj[a], normal_obj[b]) < crease
    return 0.5 * (ua + ub), wp.where(found, za, 0.0)


@wp.func
def step_between(
    mesh: wp.uint64, R: wp.mat33, t: wp.vec3, camera: wp.vec4, orthographic: int, near: float, jump: float,
    bisections: int, near_is_a: bool, far_hit: bool, za: float, zb: float, ua: wp.vec2, ub: wp.vec2, a: int, b: int,
    vertices: wp.array(dtype=wp.vec3), corners: wp.array(dtype=int), across_edge: wp.array(dtype=int),
    normal_obj: wp.array(dtype=wp.vec3),
):
    """(image point [px], z [mm] of the near side) of the occluding contour between two pixels; z = 0 where none is.

    Of a closed mesh it is walked to, if it is not taken to lie halfway. Where the walk is lost or the surface hangs
    together, as down a steep wall that a camera sees as a step, and of an open mesh, rays halve the way.
    """
    if bisections == HALFWAY:
        return 0.5 * (ua + ub), wp.where(near_is_a, za, zb)
    if across_edge.shape[0] > 0:
        near_a = near_is_a
        said, uv, z = rim_between(
            vertices, corners, across_edge, normal_obj, R, t, camera, orthographic, wp.where(near_a, a, b),
            wp.where(near_a, ua, ub), wp.where(near_a, za, zb), wp.where(near_a, ub, ua),
        )
        if said == GOES_ON and far_hit:  # behind the other one: it is the other's rim
            near_a = not near_is_a
            said, uv, z = rim_between(
                vertices, corners, across_edge, normal_obj, R, t, camera, orthographic, wp.where(near_a, a, b),
                wp.where(near_a, ua, ub), wp.where(near_a, za, zb), wp.where(near_a, ub, ua),
            )
        if said == ENDS:
            if far_hit:
                beyond = uv + BESIDE_RIM * (wp.where(near_a, ub, ua) - uv)
                tri, z_beyond = cast(mesh, R, t, beyond[0], beyond[1], camera, orthographic, near)
                if tri >= 0 and wp.abs(z_beyond - z) < jump:
                    return uv, 0.0
            return uv, z
    inside = wp.where(near_is_a, ua, ub)
    outside = wp.where(near_is_a, ub, ua)
    z_near = wp.where(near_is_a, za, zb)
    z_far = wp.where(near_is_a, zb, za)
    for _ in range(bisections):
        middle = 0.5 * (inside + outside)
        tri, z = cast(mesh, R, t, middle[0], middle[1], camera, orthographic, near)
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
    flat = far_hit and wp.abs(z_far - z_near) < jump
    return 0.5 * (inside + outside), wp.where(flat, 0.0, z_near)


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
    stale: wp.array(dtype=int),
    depth: wp.array3d(dtype=float),
    triangle: wp.array3d(dtype=int),
    normal_obj: wp.array(dtype=wp.vec3),
    vertices: wp.array(dtype=wp.vec3),
    corners: wp.array(dtype=int),
    across_edge: wp.array(dtype=int),
    # Out:
    contour_uv_out: wp.array(dtype=wp.vec2, ndim=4),
    contour_depth_out: wp.array(dtype=float, ndim=4),
    contour_column_out: wp.array(dtype=int, ndim=4),
):
    """A row of a window: the contours between its pixels and their right and lower neighbours."""
    k, i = wp.tid()
    h = first + k
    if stale[h] == 0:
        return
    s = depth.shape[1]
    R = R_cam_obj[h]
    t = t_cam_obj[h]
    for side in range(2):
        i2 = i + side
        count = wp.int32(0)
        for j in range(s):
            j2 = j + 1 - side
            if i2 < s and j2 < s:
                a = triangle[h, i, j]
                b = triangle[h, i2, j2]
                if a != b:
                    za = depth[h, i, j]
                    zb = depth[h, i2, j2]
                    ua = origin_uv[h] + stride * wp.vec2(float(j), float(i))
                    ub = origin_uv[h] + stride * wp.vec2(float(j2), float(i2))
                    both = a >= 0 and b >= 0
                    near_is_a = a >= 0
                    smooth = wp.bool(False)
                    if both:
                        near_is_a = za <= zb
                        smooth = wp.abs(za - zb) < jump
                        if not smooth:
                            # a contour where the farther point lies behind the tangent plane of the nearer one, not
                            # where depth differs
                            n = R * normal_obj[wp.where(near_is_a, a, b)]
                            pa = surface_point(ua[0], ua[1], za, camera, orthographic)
                            pb = surface_point(ub[0], ub[1], zb, camera, orthographic)
                            gap = wp.dot(n, pb - pa)
                            smooth = wp.where(near_is_a, gap, -gap) > -jump
                    uv = wp.vec2(0.0, 0.0)
                    z = wp.float32(0.0)
                    if not smooth:
                        uv, z = step_between(
                            mesh, R, t, camera, orthographic, near, jump, bisections, near_is_a, both, za, zb, ua, ub,
                            a, b, vertices, corners, across_edge, normal_obj,
                        )
                    elif wp.dot(normal_obj[a], normal_obj[b]) < crease:
                        # one surface that turns: its crease is where the normal changes sides
                        uv, z = crease_between(
                            mesh, R, t, camera, orthographic, near, jump, bisections, crease, normal_obj, a, b, za, zb,
                            ua, ub,
                        )
                    if z > 0.0:
                        contour_uv_out[h, side, i, j] = uv
                        contour_depth_out[h, side, i, j] = z
                        contour_column_out[h, side, i, count] = j
                        count += 1
        contour_column_out[h, side, i, count] = -1


@dataclass(frozen=True, eq=False)
class Rays:
    """How rays are cast into windows."""

    mesh: RayMesh
    camera: Camera
    reach: float  # [mm] no point of the part is farther than this from its origin
    jump: float | None  # [mm] least step between two surfaces that is an occluding contour; None: no contours
    crease: float | None  # [rad] creases that turn by more are contours too; None: none are
    halfway: bool = False  # contours are taken to lie halfway between pixels; else they are looked for

    def load(self) -> None:
        """Compiles the kernels, so that threads may launch them together."""
        load_kernel(window_kernel, self.mesh.device)
        load_kernel(raster_kernel, self.mesh.device)

    def cast(self, seen: Windows, first: int, last: int) -> None:
        """Casts the stale ones of the windows first .. last - 1."""
        size, many = seen.size, last - first
        common = [
            self.mesh.warp_mesh.id, seen.R_cam_obj, seen.t_cam_obj, seen.origin_uv, camera_vector(self.camera),
            int(self.camera.is_orthographic), 2.0 * self.reach, float(seen.stride),
        ]
        if fills(self.mesh, size**2):
            wp.launch(
                raster_kernel, dim=many,
                inputs=[
                    self.mesh.warp_mesh.points, self.mesh.warp_mesh.indices, self.mesh.normals_obj,
                    int(self.mesh.is_closed), *common[1:6], float(seen.stride), first, seen.stale,
                    room_for_vertices(self.mesh),
                ],
                outputs=[seen.depth, seen.triangle], device=seen.device,
            )  # fmt: skip
        else:
            wp.launch(window_kernel, dim=(many, size, size), inputs=[*common, first, seen.stale],
                      outputs=[seen.depth, seen.triangle], device=seen.device)
        if self.jump is None or not seen.with_contours:
            return
        # half of the last interval is the error: the middle is taken
        bisections = HALFWAY if self.halfway else max(2, int(np.ceil(np.log2(seen.stride / (2.0 * CONTOUR_ERROR)))))
        sharpest = -2.0 if self.crease is None else float(np.cos(self.crease))
        wp.launch(
            contour_kernel, dim=(many, size),
            inputs=[*common, float(self.jump), bisections, sharpest, first, seen.stale, seen.depth, seen.triangle,
                    self.mesh.normals_obj, self.mesh.warp_mesh.points, self.mesh.warp_mesh.indices,
                    self.mesh.across_edge],
            outputs=[seen.contour_uv, seen.contour_depth, seen.contour_column], device=seen.device,
        )

    def cast_all(self, seen: Windows) -> None:
        """Casts every stale window, on all cores."""
        self.load()
        rays = (3 if self.jump is not None else 1) * seen.size**2
        launch_in_chunks(lambda a, b: self.cast(seen, a, b), seen.count, rays_each=rays, device=seen.device)
