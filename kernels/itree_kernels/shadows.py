"""Cast shadows of distant lights in filled images: rays toward a light only where something may stand in between.

Seen along a light's direction the part lies in a grid of cells. Every triangle that a ray could meet first raises its
cells to its own height, rounded up; a point above its cell's height is lit for sure, and of the others rays decide. So
what comes out is what rays from every point would say. A light of a view is one thread's: nothing is raced for.
"""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

import numpy as np
import warp as wp

from itree_kernels.mesh import RayMesh
from itree_kernels.raster import NO_AREA, ON_EDGE, bounds_beside, of_rise, within
from itree_kernels.rays import surface_point

PIXELS_PER_CELL = 8  # of an image
BESIDE = wp.constant(1.01)  # of the bounding sphere: points start a little above the surface
ROUNDED_UP = wp.constant(1e-5)  # of the radius, by which a cell is taken to be higher
NOTHING = wp.constant(-1.0e30)  # [mm] toward the light, below every point
FEW = wp.constant(16)  # cells that a triangle's box may touch before its rows are looked at one by one
TRIANGLES_PER_PIXEL = 0.5  # of an image: with more of them, to cast all the rays is faster


@wp.struct
class LightGrid:
    """Room for one light and view: on a CPU the threads of one launch run one after the other."""

    vertices: wp.array(dtype=wp.vec3)  # across the light [cells] and toward it [mm]
    highest: wp.array2d(dtype=float)  # [rows, columns] no triangle that may cast a shadow is higher there [mm]


def light_grid(mesh: RayMesh, pixels: int):
    """For images of so many pixels. One cell, below which all lies, where there are too many triangles for a grid."""
    grid = LightGrid()
    coarse = len(mesh.triangles) > TRIANGLES_PER_PIXEL * pixels
    side = 1 if coarse else max(2, int(np.sqrt(pixels / PIXELS_PER_CELL)))
    grid.vertices = wp.empty(len(mesh.vertices), dtype=wp.vec3, device=mesh.device)
    grid.highest = wp.empty((side, side), dtype=float, device=mesh.device)
    return grid


@wp.func
def cell_of(x: float, side: int) -> int:
    return wp.clamp(int(wp.floor(x)), 0, side - 1)


@wp.func
def most_inside(corner: wp.vec3, edge: wp.vec2, below: float) -> float:
    """What `within` takes for a row, of a row of cells: the most that any line through them has inside of an edge."""
    return wp.max(edge[0] * (below - corner[1]), edge[0] * (below + 1.0 - corner[1]))


@wp.func
def raise_cells(
    highest: wp.array2d(dtype=float), row: int, first: int, last: int, a: wp.vec3, slope: wp.vec2, top: float,
    rounded_up: float,
):
    """Cells of a row to the height of a triangle's plane over each of them, or to its highest corner if that is less.
    """
    at_row = a[2] + slope[1] * (float(row) + 0.5 - a[1]) + 0.5 * (wp.abs(slope[0]) + wp.abs(slope[1]))
    for column in range(first, last + 1):
        plane = at_row + slope[0] * (float(column) + 0.5 - a[0])
        highest[row, column] = wp.max(highest[row, column], wp.min(plane, top) + rounded_up)


@wp.kernel(enable_backward=False)
def shadow_kernel(
    # In:
    mesh: wp.uint64,
    vertices: wp.array(dtype=wp.vec3),
    corners: wp.array(dtype=int),
    normals_obj: wp.array(dtype=wp.vec3),
    closed: int,
    centre_obj: wp.vec3,
    radius: float,
    shadow_offset: float,
    R_cam_obj: wp.array(dtype=wp.mat33),
    t_cam_obj: wp.array(dtype=wp.vec3),
    camera: wp.vec4,
    orthographic: int,
    lights: wp.array(dtype=wp.vec3),
    depth: wp.array3d(dtype=float),
    normal: wp.array3d(dtype=wp.vec3),
    first: int,
    # Between:
    grid: LightGrid,
    # In and out:
    lit: wp.array4d(dtype=wp.bool),
):
    """Takes the light from points that are lit unless something stands in between."""
    k, n = wp.tid()
    view = first + k
    side = grid.highest.shape[0]
    R_obj_cam = wp.transpose(R_cam_obj[view])
    toward = R_obj_cam * lights[n]
    aside = wp.where(wp.abs(toward[0]) < 0.6, wp.vec3(1.0, 0.0, 0.0), wp.vec3(0.0, 1.0, 0.0))
    x_axis = wp.normalize(wp.cross(aside, toward))
    y_axis = wp.cross(toward, x_axis)
    middle = 0.5 * float(side)
    per_mm = middle / (BESIDE * radius)
    rounded_up = ROUNDED_UP * radius

    for row in range(side):
        for column in range(side):
            grid.highest[row, column] = wp.where(side == 1, -NOTHING, NOTHING)
    if side > 1:
        for m in range(vertices.shape[0]):
            X = vertices[m] - centre_obj
            grid.vertices[m] = wp.vec3(
                middle + per_mm * wp.dot(X, x_axis), middle + per_mm * wp.dot(X, y_axis), wp.dot(X, toward)
            )
        for face in range(normals_obj.shape[0]):
            # a ray comes into a closed mesh by what faces away from the light, before it meets anything else
            if closed == 0 or wp.dot(normals_obj[face], toward) < 0.0:
                a = grid.vertices[corners[3 * face]]
                b = grid.vertices[corners[3 * face + 1]]
                c = grid.vertices[corners[3 * face + 2]]
                left = wp.min(wp.min(a[0], b[0]), c[0]) - ON_EDGE
                right = wp.max(wp.max(a[0], b[0]), c[0]) + ON_EDGE
                top = cell_of(wp.min(wp.min(a[1], b[1]), c[1]) - ON_EDGE, side)
                bottom = cell_of(wp.max(wp.max(a[1], b[1]), c[1]) + ON_EDGE, side)
                begin = cell_of(left, side)
                end = cell_of(right, side)
                ab = wp.vec2(b[0] - a[0], b[1] - a[1])
                ca = wp.vec2(a[0] - c[0], a[1] - c[1])
                area = ca[0] * ab[1] - ca[1] * ab[0]
                crest = wp.max(wp.max(a[2], b[2]), c[2])
                slope = wp.vec2(0.0, 0.0)
                flat = wp.abs(area) < NO_AREA  # seen on edge: its box's cells, to its highest corner
                if flat:
                    a = wp.vec3(a[0], a[1], crest)
                else:
                    upright = wp.cross(b - a, c - a)
                    slope = wp.vec2(-upright[0] / upright[2], -upright[1] / upright[2])
                if flat or (bottom - top + 1) * (end - begin + 1) <= FEW:
                    for row in range(top, bottom + 1):
                        raise_cells(grid.highest, row, begin, end, a, slope, crest, rounded_up)
                else:
                    turned = wp.sign(area)
                    ab = turned * ab
                    bc = turned * wp.vec2(c[0] - b[0], c[1] - b[1])
                    ca = turned * ca
                    per_ab = of_rise(ab)
                    per_bc = of_rise(bc)
                    per_ca = of_rise(ca)
                    beside_ab = bounds_beside(per_ab)
                    beside_bc = bounds_beside(per_bc)
                    beside_ca = bounds_beside(per_ca)
                    for row in range(top, bottom + 1):
                        # of the row of cells, what may lie inside of all three edges
                        below = float(row)
                        near = wp.vec2(left, right)
                        near = within(near, a, most_inside(a, ab, below), per_ab, beside_ab)
                        near = within(near, b, most_inside(b, bc, below), per_bc, beside_bc)
                        near = within(near, c, most_inside(c, ca, below), per_ca, beside_ca)
                        if near[0] <= near[1]:
                            raise_cells(grid.highest, row, cell_of(near[0], side), cell_of(near[1], side), a, slope,
                                        crest, rounded_up)

    # the same axes in the camera frame
    t_centre = R_cam_obj[view] * centre_obj + t_cam_obj[view]
    x_cam = per_mm * (R_cam_obj[view] * x_axis)
    y_cam = per_mm * (R_cam_obj[view] * y_axis)
    for i in range(depth.shape[1]):
        for j in range(depth.shape[2]):
            if lit[view, n, i, j]:
                X_cam = surface_point(float(j), float(i), depth[view, i, j], camera, orthographic)
                X_cam += shadow_offset * normal[view, i, j]
                P = X_cam - t_centre
                row = cell_of(middle + wp.dot(P, y_cam), side)
                column = cell_of(middle + wp.dot(P, x_cam), side)
                if wp.dot(P, lights[n]) < grid.highest[row, column]:  # noqa: SIM102 (a kernel's `and` asks both)
                    if wp.mesh_query_ray_anyhit(mesh, R_obj_cam * (X_cam - t_cam_obj[view]), toward, 2.1 * radius):
                        lit[view, n, i, j] = False
