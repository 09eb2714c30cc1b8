"""Windows of a batch of poses: where they lie in the image, and what rays find of the part in them."""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp
from jaxtyping import Float

from itree_kernels.camera import Camera
from itree_kernels.mesh import RayMesh
from itree_kernels.raster import fill_window, fills, room_for_vertices
from itree_kernels.rays import camera_vector, ray_direction, ray_origin, surface_point
from itree_kernels.rim import BENDS, ENDS, GOES_ON, bend_between, rim_between
from itree_kernels.threads import launch_in_chunks
from itree_kernels.warp_start import load_kernel

CONTOUR_ERROR = 0.5  # [px] rays find a contour point to about this, or to 1/4 of the stride if that is less
HALFWAY = wp.constant(0)  # bisections: a contour is taken to lie in the middle, off by half a stride at most
BESIDE_RIM = wp.constant(0.1)  # of the way from a rim to the pixel beyond it: where what lies behind is asked for


@wp.struct
class WindowArrays:
    """What `Windows` holds, as kernels take it."""

    R_cam_obj: wp.array(dtype=wp.mat33)
    t_cam_obj: wp.array(dtype=wp.vec3)
    origin_uv: wp.array(dtype=wp.vec2)
    stale: wp.array(dtype=int)
    depth: wp.array3d(dtype=float)
    triangle: wp.array3d(dtype=int)
    contour_uv: wp.array(dtype=wp.vec2, ndim=4)
    contour_depth: wp.array(dtype=float, ndim=4)
    contour_column: wp.array(dtype=int, ndim=4)
    stride: float


@wp.struct
class Casting:
    """The part, the camera, and what counts as a contour, as kernels take them (see `Rays`)."""

    mesh: wp.uint64
    vertices: wp.array(dtype=wp.vec3)
    corners: wp.array(dtype=int)
    normals_obj: wp.array(dtype=wp.vec3)
    across_edge: wp.array(dtype=int)
    closed: int
    camera: wp.vec4
    orthographic: int
    near: float  # [mm] that rays start before the part's origin
    jump: float  # [mm]
    bisections: int
    crease: float  # cosine
    fills: int  # 1: triangle by triangle, 0: by rays
    contours: int  # 1: they are looked for


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

    def clear_contours(self) -> None:
        """Zeros where there will be none, for who reads all of the arrays and not the columns alone. Only before rays
        are cast first: what was found is not taken away.
        """
        self.contour_uv.zero_()
        self.contour_depth.zero_()

    @cached_property
    def arrays(self) -> Any:
        """All of them, as kernels take them."""
        arrays = WindowArrays()
        for name in WindowArrays.vars:
            setattr(arrays, name, float(self.stride) if name == "stride" else getattr(self, name))
        return arrays


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


@wp.func
def cast_pixel(rays: Casting, seen: WindowArrays, h: int, i: int, j: int):
    u = seen.origin_uv[h][0] + seen.stride * float(j)
    v = seen.origin_uv[h][1] + seen.stride * float(i)
    triangle, z = cast(
        rays.mesh, seen.R_cam_obj[h], seen.t_cam_obj[h], u, v, rays.camera, rays.orthographic, rays.near
    )
    seen.depth[h, i, j] = z
    seen.triangle[h, i, j] = triangle


@wp.func
def crease_between(
    mesh: wp.uint64, R: wp.mat33, t: wp.vec3, camera: wp.vec4, orthographic: int, near: float, jump: float,
    bisections: int, crease: float, a: int, b: int, za: float, zb: float, ua: wp.vec2, ub: wp.vec2,
    vertices: wp.array(dtype=wp.vec3), corners: wp.array(dtype=int), across_edge: wp.array(dtype=int),
    normal_obj: wp.array(dtype=wp.vec3),
):
    """(image point [px], z [mm]) of the crease between two pixels of one surface; z = 0 where it only bends.

    Of a closed mesh it is walked to, if it is not taken to lie halfway; where the walk is lost, and of an open mesh,
    rays halve the way.
    """
    if across_edge.shape[0] > 0 and bisections != HALFWAY:
        beside = 0.5 / float(1 << bisections)
        said, uv, z, this_side, that_side = bend_between(
            vertices, corners, across_edge, normal_obj, R, t, camera, orthographic, a, b, ua, ub, beside
        )
        if said == BENDS:
            return uv, wp.where(wp.dot(normal_obj[this_side], normal_obj[that_side]) < crease, z, 0.0)
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


@wp.func
def look_for_contours(rays: Casting, seen: WindowArrays, h: int, i: int):
    """In a row of a window: between its pixels and their right and lower neighbours."""
    s = seen.depth.shape[1]
    R = seen.R_cam_obj[h]
    t = seen.t_cam_obj[h]
    origin = seen.origin_uv[h]
    triangle_row = seen.triangle[h, i]
    depth_row = seen.depth[h, i]
    for side in range(2):
        i2 = i + side
        count = wp.int32(0)
        uv_out = seen.contour_uv[h, side, i]
        depth_out = seen.contour_depth[h, side, i]
        column_out = seen.contour_column[h, side, i]
        if i2 < s:
            other_triangle_row = seen.triangle[h, i2]
            other_depth_row = seen.depth[h, i2]
            j = wp.int32(0)
            while j + 1 - side < s:
                j2 = j + 1 - side
                a = triangle_row[j]
                b = other_triangle_row[j2]
                if a != b:
                    za = depth_row[j]
                    zb = other_depth_row[j2]
                    ua = origin + seen.stride * wp.vec2(float(j), float(i))
                    ub = origin + seen.stride * wp.vec2(float(j2), float(i2))
                    both = a >= 0 and b >= 0
                    near_is_a = a >= 0
                    smooth = wp.bool(False)
                    if both:
                        near_is_a = za <= zb
                        smooth = wp.abs(za - zb) < rays.jump
                        if not smooth:
                            # a contour where the farther point lies behind the tangent plane of the nearer one, not
                            # where depth differs
                            n = R * rays.normals_obj[wp.where(near_is_a, a, b)]
                            pa = surface_point(ua[0], ua[1], za, rays.camera, rays.orthographic)
                            pb = surface_point(ub[0], ub[1], zb, rays.camera, rays.orthographic)
                            gap = wp.dot(n, pb - pa)
                            smooth = wp.where(near_is_a, gap, -gap) > -rays.jump
                    uv = wp.vec2(0.0, 0.0)
                    z = wp.float32(0.0)
                    if not smooth:
                        uv, z = step_between(
                            rays.mesh, R, t, rays.camera, rays.orthographic, rays.near, rays.jump, rays.bisections,
                            near_is_a, both, za, zb, ua, ub, a, b, rays.vertices, rays.corners, rays.across_edge,
                            rays.normals_obj,
                        )
                    elif wp.dot(rays.normals_obj[a], rays.normals_obj[b]) < rays.crease:
                        # one surface that turns: its crease is where the normal changes sides
                        uv, z = crease_between(
                            rays.mesh, R, t, rays.camera, rays.orthographic, rays.near, rays.jump, rays.bisections,
                            rays.crease, a, b, za, zb, ua, ub, rays.vertices, rays.corners, rays.across_edge,
                            rays.normals_obj,
                        )
                    if z > 0.0:
                        uv_out[j] = uv
                        depth_out[j] = z
                        column_out[count] = j
                        count += 1
                j += 1
        column_out[count] = -1


@wp.func
def cast_window(rays: Casting, seen: WindowArrays, projected: wp.array(dtype=wp.vec3), h: int):
    """All of a window by one thread. `projected`: room for the vertices that are filled between."""
    s = seen.depth.shape[1]
    if rays.fills == 1:
        fill_window(
            rays.vertices, rays.corners, rays.normals_obj, rays.closed, seen.R_cam_obj[h], seen.t_cam_obj[h],
            seen.origin_uv[h], rays.camera, rays.orthographic, seen.stride, projected, seen.depth[h],
            seen.triangle[h],
        )
    else:
        for i in range(s):
            for j in range(s):
                cast_pixel(rays, seen, h, i, j)
    if rays.contours == 1:
        for i in range(s):
            look_for_contours(rays, seen, h, i)


@wp.kernel(enable_backward=False)
def window_kernel(
    # In:
    rays: Casting,
    first: int,
    # Out:
    seen: WindowArrays,
):
    """Pixel by pixel, for a GPU."""
    k, i, j = wp.tid()
    h = first + k
    if seen.stale[h] == 1:
        cast_pixel(rays, seen, h, i, j)


@wp.kernel(enable_backward=False)
def contour_kernel(
    # In:
    rays: Casting,
    first: int,
    # Out:
    seen: WindowArrays,
):
    """Row by row, for a GPU."""
    k, i = wp.tid()
    h = first + k
    if seen.stale[h] == 1:
        look_for_contours(rays, seen, h, i)


@wp.kernel(enable_backward=False)
def cast_kernel(
    # In:
    rays: Casting,
    first: int,
    # Between:
    projected: wp.array(dtype=wp.vec3),
    # Out:
    seen: WindowArrays,
):
    """Window by window, for a CPU."""
    h = first + wp.tid()
    if seen.stale[h] == 1:
        cast_window(rays, seen, projected, h)


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
        load_kernel(cast_kernel, self.mesh.device)

    def into(self, seen: Windows) -> Any:
        """As kernels take them, for these windows."""
        mesh, rays = self.mesh, Casting()
        rays.mesh, rays.vertices, rays.corners = mesh.warp_mesh.id, mesh.warp_mesh.points, mesh.warp_mesh.indices
        rays.normals_obj, rays.across_edge, rays.closed = mesh.normals_obj, mesh.across_edge, int(mesh.is_closed)
        rays.camera, rays.orthographic = camera_vector(self.camera), int(self.camera.is_orthographic)
        rays.near, rays.fills = 2.0 * self.reach, int(fills(mesh, seen.size**2))
        rays.contours = int(self.jump is not None and seen.with_contours)
        rays.jump = 0.0 if self.jump is None else float(self.jump)
        # half of the last interval is the error: the middle is taken
        halvings = max(2, int(np.ceil(np.log2(seen.stride / (2.0 * CONTOUR_ERROR)))))
        rays.bisections = HALFWAY if self.halfway else halvings
        rays.crease = -2.0 if self.crease is None else float(np.cos(self.crease))
        return rays

    def cast(self, seen: Windows, first: int, last: int, rays: Any = None) -> None:
        """Casts the stale ones of the windows first .. last - 1. `rays`: what `into` says of them, if it is known."""
        rays = self.into(seen) if rays is None else rays
        some, device = last - first, seen.device
        if device == "cpu":
            room = room_for_vertices(self.mesh)
            wp.launch(cast_kernel, dim=some, inputs=[rays, first, room], outputs=[seen.arrays], device=device)
            return
        size = (seen.size, seen.size)
        wp.launch(window_kernel, dim=(some, *size), inputs=[rays, first], outputs=[seen.arrays], device=device)
        if rays.contours:
            wp.launch(contour_kernel, dim=(some, seen.size), inputs=[rays, first], outputs=[seen.arrays], device=device)

    def cast_all(self, seen: Windows) -> None:
        """Casts every stale window, on all cores."""
        self.load()
        work, rays = (3 if self.jump is not None else 1) * seen.size**2, self.into(seen)
        launch_in_chunks(lambda a, b: self.cast(seen, a, b, rays), seen.count, rays_each=work, device=seen.device)
