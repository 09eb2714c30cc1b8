"""Which pixels of a scene agree with a pose, contradict it, or are hidden by something nearer, counted row by row."""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

import numpy as np
import warp as wp
from jaxtyping import Float

from itree_kernels.scene_maps import SceneMaps, SeenBy
from itree_kernels.windows import WindowArrays, Windows

BLIND = wp.constant(0.5)  # what a pixel without depth counts: needles and shading are alike on any parallel face
SAME_SHADING = wp.constant(0.12)  # of full albedo: 4 standard deviations of the 3 % that reflected light adds
LIT_SHADING = wp.constant(0.2)  # of full albedo: what reflected light fills shadows with is less
TOO_BRIGHT = wp.constant(0.25)  # of full albedo: beyond the 99 percentile of reflected light
CONTOUR_STEP = 2.5  # [px] how far outside of its contour a pose is asked whether the surface goes on
STEEPEST = wp.constant(0.2)  # cosine of the slant beyond which nothing is detectable
FAR = wp.constant(1.0e30)

COUNTS = 8
counts8 = wp.types.vector(length=8, dtype=wp.float32)
pixels5 = wp.types.vector(length=5, dtype=wp.float32)  # agreeing, closeness, needles agreeing, contradicting, hidden


@wp.struct
class Limits:
    """What still counts as the same."""

    depth: float  # along the normal [mm]
    needle_cosine: float
    jump: float  # step between two surfaces [mm]
    edge: float  # [px] from an observed edge within which a contour is found; 0: where depth ends, it is found
    step: float  # [px] outside of its contour, where a pose is asked whether the surface goes on


@wp.func
def depth_at(maps: SceneMaps, uv: wp.vec2) -> float:
    """z [mm] at the nearest pixel; 0 outside of the image."""
    column = int(wp.rint(uv[0]))
    row = int(wp.rint(uv[1]))
    if column < 0 or column >= maps.depth.shape[1] or row < 0 or row >= maps.depth.shape[0]:
        return 0.0
    return maps.depth[row, column]


@wp.func
def edge_distance(maps: SceneMaps, uv: wp.vec2) -> float:
    """How far [px] the nearest observed edge point is; `FAR` outside of the image."""
    column = int(wp.rint(2.0 * uv[0]))
    row = int(wp.rint(2.0 * uv[1]))
    if column < 0 or column >= maps.edge_label.shape[1] or row < 0 or row >= maps.edge_label.shape[0]:
        return FAR
    return wp.length(uv - maps.edge_uv[maps.edge_label[row, column]])


@wp.func
def shading_support(maps: SceneMaps, row: int, column: int, normal: wp.vec3):
    """How many lights show what the pose's normal predicts, and whether one shows more than it can.

    A light that shows less may be in shadow there: it says nothing. Outside of the image nothing does.
    """
    shown = wp.int32(0)
    too_bright = wp.bool(False)
    if row >= 0 and row < maps.depth.shape[0] and column >= 0 and column < maps.depth.shape[1]:
        for light in range(maps.lights.shape[0]):
            expected = wp.max(wp.dot(normal, maps.lights[light]), 0.0)
            more = maps.shading[row, column, light] - expected
            if wp.abs(more) < SAME_SHADING and expected > LIT_SHADING:
                shown += 1
            if more > TOO_BRIGHT:
                too_bright = wp.bool(True)
    return shown, too_bright


@wp.func
def pixel_verdict(maps: SceneMaps, row: int, column: int, depth: float, normal: wp.vec3, limits: Limits) -> pixels5:
    """What the scene says at a pixel of a pose that shows this depth [mm] and normal there."""
    z = wp.float32(0.0)
    believed = wp.float32(0.0)
    seen = wp.vec3()
    if row >= 0 and row < maps.depth.shape[0] and column >= 0 and column < maps.depth.shape[1]:
        z = maps.depth[row, column]
        believed = maps.needle_weight[row, column]
        seen = maps.normals[row, column]
    cosine = wp.dot(seen, normal)
    same = cosine > limits.needle_cosine
    turn = wp.clamp((1.0 - cosine) / (1.0 - limits.needle_cosine), 0.0, 1.0)
    pixel = pixels5()
    if z > 0.0:
        across = (z - depth) * wp.max(wp.abs(normal[2]), STEEPEST)
        if across <= -limits.depth:
            pixel[4] = 1.0
        elif across >= limits.depth or believed < 0.0 or (believed > 0.0 and not same):
            pixel[3] = 1.0
        else:
            pixel[0] = 1.0
            off = across / limits.depth
            pixel[1] = 1.0 - 0.5 * off * off - 0.5 * wp.where(believed > 0.0, turn, 0.5)
            if believed > 0.0:
                pixel[2] = 1.0
    elif limits.edge > 0.0:
        shown, too_bright = shading_support(maps, row, column, normal)
        if too_bright or (believed > 0.0 and not same):
            pixel[3] = BLIND
        elif believed > 0.0 or shown >= 2:
            pixel[0] = BLIND
            pixel[1] = BLIND * (1.0 - 0.5 * turn)
            if believed > 0.0:
                pixel[2] = BLIND
    return pixel


@wp.func
def hit_depth(depth: wp.array3d(dtype=float), triangle: wp.array3d(dtype=int), h: int, i: int, j: int) -> float:
    """z [mm] of the pose at a window pixel; `FAR` where it misses, or outside of the window."""
    if i >= depth.shape[1] or j >= depth.shape[2]:
        return FAR
    return wp.where(triangle[h, i, j] >= 0, depth[h, i, j], FAR)


@wp.func
def goes_on_flush(
    R: wp.mat33,
    origin_uv: wp.vec2,
    depth: wp.array3d(dtype=float),
    triangle: wp.array3d(dtype=int),
    normal_obj: wp.array(dtype=wp.vec3),
    maps: SceneMaps,
    stride: float,
    limits: Limits,
    h: int,
    i: int,
    j: int,
    down: int,
    right: int,
    outer_uv: wp.vec2,
) -> bool:
    """Whether the face at window pixel (i, j), which its pose ends here, is seen to go on at `outer_uv` [px]: on the
    face's own plane, with its needle where there is one. (down, right) is the step to the next window pixel inside.
    """
    row = int(wp.rint(outer_uv[1]))
    column = int(wp.rint(outer_uv[0]))
    if row < 0 or row >= maps.depth.shape[0] or column < 0 or column >= maps.depth.shape[1]:
        return False
    i_in = i + down
    j_in = j + right
    if i_in < 0 or i_in >= depth.shape[1] or j_in < 0 or j_in >= depth.shape[2]:
        return False
    if triangle[h, i, j] < 0 or triangle[h, i_in, j_in] < 0:
        return False
    normal = R * normal_obj[triangle[h, i, j]]
    if wp.dot(R * normal_obj[triangle[h, i_in, j_in]], normal) < limits.needle_cosine:
        return False
    if maps.needle_weight[row, column] > 0.0:
        if wp.dot(maps.normals[row, column], normal) < limits.needle_cosine:
            return False
    elif limits.edge > 0.0:  # depth of two cameras is not known there
        return False
    beyond = wp.abs(float(column) - origin_uv[0] - stride * float(j))
    if down != 0:
        beyond = wp.abs(float(row) - origin_uv[1] - stride * float(i))
    z = depth[h, i, j] + (depth[h, i, j] - depth[h, i_in, j_in]) * beyond / stride
    return wp.abs(maps.depth[row, column] - z) * wp.max(wp.abs(normal[2]), STEEPEST) < limits.depth


@wp.kernel(enable_backward=False)
def agreement_kernel(
    # In:
    seen: WindowArrays,
    normal_obj: wp.array(dtype=wp.vec3),
    maps: SceneMaps,
    limits: Limits,
    first: int,
    # Out:
    counts: wp.array(dtype=counts8, ndim=2),
):
    k, i = wp.tid()
    h = first + k
    size = seen.depth.shape[2]
    R = seen.R_cam_obj[h]
    origin = seen.origin_uv[h]
    depth_row = seen.depth[h, i]
    triangle_row = seen.triangle[h, i]
    row = int(origin[1] + seen.stride * float(i))
    pixels = pixels5()
    for j in range(size):
        column = int(origin[0] + seen.stride * float(j))
        face = triangle_row[j]
        if face >= 0:
            pixels += pixel_verdict(maps, row, column, depth_row[j], R * normal_obj[face], limits)

    found = wp.float32(0.0)
    missed = wp.float32(0.0)
    flush = wp.float32(0.0)
    if seen.contour_depth.shape[2] > 0:
        for side in range(2):
            for m in range(size):
                j = seen.contour_column[h, side, i, m]
                if j < 0:
                    break
                z = seen.contour_depth[h, side, i, j]
                uv = seen.contour_uv[h, side, i, j]
                beyond = hit_depth(seen.depth, seen.triangle, h, i + side, j + 1 - side)
                toward = wp.where(hit_depth(seen.depth, seen.triangle, h, i, j) <= beyond, limits.step, -limits.step)
                shift = wp.where(side == 0, wp.vec2(toward, 0.0), wp.vec2(0.0, toward))
                inner = depth_at(maps, uv - shift)
                outer = depth_at(maps, uv + shift)
                steps = outer > 0.0 and wp.abs(outer - inner) > 0.5 * limits.jump
                at_edge = wp.bool(False)
                if limits.edge > 0.0:
                    at_edge = edge_distance(maps, uv) < limits.edge
                # only where the contour itself is seen: inside of it the scene is at the pose's depth
                if inner > 0.0:
                    if wp.abs(inner - z) < limits.jump:
                        # depth sensors lose the far side of a step: where nothing was measured outside, the surface
                        # has ended. Depth from two cameras isn't known where no needle is: there an edge has to
                        # tell
                        if steps or wp.where(limits.edge > 0.0, at_edge, outer <= 0.0):
                            found += 1.0
                        else:
                            missed += 1.0
                            inward = wp.where(toward > 0.0, -1, 1)
                            i_rim = wp.where(toward > 0.0, i, i + side)
                            j_rim = wp.where(toward > 0.0, j, j + 1 - side)
                            if goes_on_flush(
                                R, origin, seen.depth, seen.triangle, normal_obj, maps, seen.stride, limits, h,
                                i_rim, j_rim, inward * side, inward * (1 - side), uv + shift,
                            ):
                                flush += 1.0
                elif limits.edge > 0.0:
                    found += wp.where(at_edge, BLIND, 0.0)
                    missed += wp.where(at_edge, 0.0, BLIND)
    counts[h, i] = counts8(pixels[0], pixels[1], pixels[2], pixels[3], pixels[4], found, missed, flush)


def limits_of(depth: float, needle: float, jump: float, edge: float, off: float = 0.0):
    """Depth and jump [mm], needle [rad], edge [px]; `off` [px]: how far off contours may lie themselves."""
    limits = Limits()
    limits.depth, limits.needle_cosine, limits.jump = depth, float(np.cos(needle)), jump
    limits.edge, limits.step = edge + off if edge > 0.0 else 0.0, CONTOUR_STEP + off
    return limits


def row_counts(count: int, size: int, device: str) -> wp.array:
    """Room for the counts of every row of every window."""
    return wp.empty((count, size), dtype=counts8, device=device)


def count_rows(
    seen: Windows, by: SeenBy, normal_obj: wp.array, limits, first: int, last: int, counts: wp.array
) -> None:
    """Counts in the rows of windows first .. last - 1, whose rays are cast."""
    wp.launch(
        agreement_kernel, dim=(last - first, seen.size),
        inputs=[
            seen.arrays, normal_obj, by.maps, limits, first,
        ],
        outputs=[counts], device=seen.device,
    )  # fmt: skip


def summed(counts: wp.array) -> Float[np.ndarray, "h 8"]:
    """Counts of whole windows."""
    return counts.numpy().sum(axis=1)
