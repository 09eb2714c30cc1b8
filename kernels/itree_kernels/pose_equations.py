"""Normal equations of poses: what needles, depth and contour of a scene pull at, summed over each row of a window.

Surface points keep their place on the part while it moves: they are cast once, and then projected into the image, where
each meets the observation of the nearest pixel. A depth is compared along the surface's normal, so that where inside
the pixel a point falls makes no difference on a face. The JAX functions of `itree_jax.refinement.residuals` state the
same sums pixel by pixel.
"""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

from dataclasses import dataclass

import warp as wp

from itree_kernels.rays import camera_vector, image_point
from itree_kernels.scene_maps import SceneMaps, SeenBy
from itree_kernels.windows import WindowArrays, Windows


@wp.struct
class Gates:
    """Beyond them an observation belongs to something else."""

    depth: float  # [mm], of a surface that faces the camera
    needle: float  # length of a difference of unit normals
    contour: float  # [px]
    grazing: float  # of the variance of a depth across its surface, what is left where the surface is seen edge-on


@wp.struct
class RowSums:
    """Sums of robust weights w [views, hypotheses, rows]: of w, of w J^T J and of w J^T r; twist order (omega, v).

    Where the sum of w is 0, the others mean nothing.
    """

    depth_count: wp.array3d(dtype=float)
    depth_hessian: wp.array3d(dtype=wp.spatial_matrix)
    depth_gradient: wp.array3d(dtype=wp.spatial_vector)
    needle_count: wp.array3d(dtype=float)
    needle_outer: wp.array3d(dtype=wp.mat33)  # of w n n^T
    needle_gradient: wp.array3d(dtype=wp.vec3)
    contour_count: wp.array3d(dtype=float)
    contour_hessian: wp.array3d(dtype=wp.spatial_matrix)
    contour_gradient: wp.array3d(dtype=wp.spatial_vector)


@wp.func
def tukey(squared: float) -> float:
    """Tukey's biweight of (residual / gate)^2: 1 at none, 0 from the gate on."""
    inner = wp.max(1.0 - squared, 0.0)
    return inner * inner


@wp.func
def variance_across(normal: wp.vec3, X: wp.vec3, grazing: float, orthographic: int) -> float:
    """Of a depth's error as it shows across a surface, beside that of one which faces the camera."""
    facing = wp.where(orthographic == 1, normal[2], wp.dot(normal, X) / wp.max(X[2], 1.0))
    return grazing + (1.0 - grazing) * facing * facing


@wp.func
def push_of(X: wp.vec3, direction: wp.vec2, camera: wp.vec4, orthographic: int) -> wp.vec3:
    """How far [px] along an image direction a point's image moves per mm of the point, by axis."""
    scale = wp.where(orthographic == 1, 1.0, wp.max(X[2], 1.0))
    a = direction[0] * camera[0] / scale
    b = direction[1] * camera[1] / scale
    slope = wp.where(orthographic == 1, 0.0, -(a * X[0] + b * X[1]) / scale)
    return wp.vec3(a, b, slope)


@wp.func
def point_seen(u: float, v: float, z: float, camera: wp.vec4, per_f: wp.vec2, orthographic: int) -> wp.vec3:
    """`surface_point`, the camera's divisions done beforehand."""
    x = (u - camera[2]) * per_f[0]
    y = (v - camera[3]) * per_f[1]
    scale = wp.where(orthographic == 1, 1.0, z)
    return wp.vec3(x * scale, y * scale, z)


@wp.func
def sum_row(
    R: wp.mat33, t: wp.vec3, seen: WindowArrays, normal_obj: wp.array(dtype=wp.vec3), maps: SceneMaps, camera: wp.vec4,
    orthographic: int, gates: Gates, view: int, h: int, i: int, sums: RowSums,
):
    """Row i of window h as camera `view` sees it, the pose as it is now in that camera's frame."""
    size = seen.depth.shape[2]
    height = maps.depth.shape[0]
    width = maps.depth.shape[1]
    half_height = maps.edge_label.shape[0]
    half_width = maps.edge_label.shape[1]
    t_cast = seen.t_cam_obj[h]
    per_f = wp.vec2(1.0 / camera[0], 1.0 / camera[1])
    per_depth = 1.0 / (gates.depth * gates.depth)
    per_needle = 1.0 / (gates.needle * gates.needle)
    per_contour = 1.0 / (gates.contour * gates.contour)
    turn = R * wp.transpose(seen.R_cam_obj[h])
    u_first = seen.origin_uv[h][0]
    v = seen.origin_uv[h][1] + seen.stride * float(i)
    depth_row = seen.depth[h, i]
    triangle_row = seen.triangle[h, i]

    depth_count = wp.float32(0.0)
    depth_hessian = wp.spatial_matrix()
    depth_gradient = wp.spatial_vector()
    needle_count = wp.float32(0.0)
    needle_outer = wp.mat33()
    needle_gradient = wp.vec3()
    for j in range(size):
        face = triangle_row[j]
        if face >= 0:
            X = point_seen(u_first + seen.stride * float(j), v, depth_row[j], camera, per_f, orthographic)
            arm = turn * (X - t_cast)
            X = arm + t
            uv = image_point(X, camera, orthographic)
            column = int(wp.rint(uv[0]))
            row = int(wp.rint(uv[1]))
            if column >= 0 and column < width and row >= 0 and row < height:
                normal = R * normal_obj[face]
                z = maps.depth[row, column]
                believed = maps.needle_weight[row, column]
                if z > 0.0 and believed >= 0.0:
                    X_seen = point_seen(float(column), float(row), z, camera, per_f, orthographic)
                    residual = wp.dot(normal, X_seen - X)
                    per_variance = 1.0 / variance_across(normal, X, gates.grazing, orthographic)
                    w = tukey(residual * residual * per_depth * per_variance) * per_variance
                    if w > 0.0:
                        J = -wp.spatial_vector(wp.cross(arm, normal), normal)
                        depth_count += w
                        depth_hessian += wp.outer(w * J, J)
                        depth_gradient += (w * residual) * J
                if believed > 0.0 and (z <= 0.0 or wp.abs(z - X[2]) < gates.depth):
                    differ = maps.normals[row, column] - normal
                    w = believed * tukey(wp.length_sq(differ) * per_needle)
                    needle_count += w
                    needle_outer += wp.outer(w * normal, normal)
                    needle_gradient += w * wp.cross(differ, normal)
    sums.depth_count[view, h, i] = depth_count
    if depth_count > 0.0:
        sums.depth_hessian[view, h, i] = depth_hessian
        sums.depth_gradient[view, h, i] = depth_gradient
    sums.needle_count[view, h, i] = needle_count
    if needle_count > 0.0:
        sums.needle_outer[view, h, i] = needle_outer
        sums.needle_gradient[view, h, i] = needle_gradient

    count = wp.float32(0.0)
    hessian = wp.spatial_matrix()
    gradient = wp.spatial_vector()
    if seen.contour_depth.shape[2] > 0:
        for side in range(2):
            columns = seen.contour_column[h, side, i]
            for m in range(size):
                j = columns[m]
                if j < 0:
                    break
                z = seen.contour_depth[h, side, i, j]
                at = seen.contour_uv[h, side, i, j]
                arm = turn * (point_seen(at[0], at[1], z, camera, per_f, orthographic) - t_cast)
                X = arm + t
                uv = image_point(X, camera, orthographic)
                column = int(wp.rint(2.0 * uv[0]))
                row = int(wp.rint(2.0 * uv[1]))
                if column >= 0 and column < half_width and row >= 0 and row < half_height:
                    edge = maps.edge_label[row, column]
                    z_edge = maps.edge_depth[edge]
                    # an edge at another depth belongs to another part
                    if z_edge <= 0.0 or wp.abs(z_edge - X[2]) < 2.0 * gates.depth:
                        gap = uv - maps.edge_uv[edge]
                        w = tukey(wp.length_sq(gap) * per_contour)
                        if w > 0.0:
                            direction = maps.edge_normal[edge]
                            push = push_of(X, direction, camera, orthographic)
                            J = wp.spatial_vector(wp.cross(arm, push), push)
                            count += w
                            hessian += wp.outer(w * J, J)
                            gradient += (w * wp.dot(gap, direction)) * J
    sums.contour_count[view, h, i] = count
    if count > 0.0:
        sums.contour_hessian[view, h, i] = hessian
        sums.contour_gradient[view, h, i] = gradient


@wp.kernel(enable_backward=False)
def equations_kernel(
    # In:
    R_cam_obj: wp.array(dtype=wp.mat33),
    t_cam_obj: wp.array(dtype=wp.vec3),
    moving: wp.array(dtype=int),
    seen: WindowArrays,
    normal_obj: wp.array(dtype=wp.vec3),
    maps: SceneMaps,
    camera: wp.vec4,
    orthographic: int,
    gates: Gates,
    view: int,
    first: int,
    # Out:
    sums: RowSums,
):
    k, i = wp.tid()
    h = first + k
    if moving[h] == 1:
        sum_row(
            R_cam_obj[h], t_cam_obj[h], seen, normal_obj, maps, camera, orthographic, gates, view, h, i, sums,
        )


def row_sums(views: int, count: int, size: int, device: str):
    """Room for the sums of every row of every window."""
    sums = RowSums()
    for name, kind in (
        ("depth_count", float), ("depth_hessian", wp.spatial_matrix), ("depth_gradient", wp.spatial_vector),
        ("needle_count", float), ("needle_outer", wp.mat33), ("needle_gradient", wp.vec3),
        ("contour_count", float), ("contour_hessian", wp.spatial_matrix), ("contour_gradient", wp.spatial_vector),
    ):  # fmt: skip
        setattr(sums, name, wp.empty((views, count, size), dtype=kind, device=device))
    return sums


def gates_of(depth: float, needle: float, contour: float, grazing: float = 1.0):
    """Gates of one step."""
    gates = Gates()
    gates.depth, gates.needle, gates.contour, gates.grazing = depth, needle, contour, grazing
    return gates


@dataclass(frozen=True, eq=False)
class MovedPoses:
    """Poses as they are now in the frame of one camera, on the device."""

    R_cam_obj: wp.array  # of mat33
    t_cam_obj: wp.array  # of vec3 [mm]
    moving: wp.array  # of int: 0 where a pose has come to rest, and is left alone


def sum_rows(
    seen: Windows, now: MovedPoses, by: SeenBy, normal_obj: wp.array, gates, view: int, first: int, last: int, sums
) -> None:
    """Sums the rows of windows first .. last - 1 as camera `view` sees them."""
    wp.launch(
        equations_kernel, dim=(last - first, seen.size),
        inputs=[
            now.R_cam_obj, now.t_cam_obj, now.moving, seen.arrays, normal_obj, by.maps, camera_vector(by.camera),
            int(by.camera.is_orthographic), gates, view, first,
        ],
        outputs=[sums], device=seen.device,
    )  # fmt: skip
