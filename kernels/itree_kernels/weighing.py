"""The log-likelihood ratio of every pixel of a pose's window: how much better the pose explains it than anything else.

See `itree_jax.refinement.likelihood` for what it says.
"""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false, reportReturnType=false

from dataclasses import dataclass

import warp as wp

from itree_kernels.agreement import edge_distance
from itree_kernels.scene_maps import SceneMaps, SeenBy
from itree_kernels.windows import WindowArrays, Windows

SEEN_THROUGH = wp.constant(0.005)  # share of pixels at which a sensor sees farther than a surface that is there
OUTLIERS = wp.constant(0.15)  # share of needles and brightnesses that reflected light or a highlight makes anything
IN_SHADOW = wp.constant(0.4)  # share of a surface's pixels that a light doesn't reach: half is lit by all of three
SHADING_STD = wp.constant(0.06)  # of full albedo: what reflected light and needles' noise add
BRIGHTEST = wp.constant(1.3)  # of full albedo: something else shades anywhere between 0 and this
LIT_SHADING = wp.constant(0.2)  # of full albedo: what reflected light fills shadows with is less
EDGE_FOUND = wp.constant(0.65)  # share of a true contour's points whose edge is found in the image
EDGE_DENSITY = wp.constant(0.25)  # [1 / px] of distances to the nearest edge, beside points that are no contour's
BLIND = wp.constant(0.3)  # weight of a pixel without depth: the shading of neighbours errs together
BORDER = wp.constant(0.2)  # [px] by which a pose's own error moves a slanted surface
STEEPEST = wp.constant(0.15)
OTHER_SIDE = wp.constant(0.2)  # share of pixels beside a step that see its other side: by the pose's own error
NEAR = wp.constant(4.0)  # deviations of depth within which a pixel is the pose's own
ROOT_2_PI = wp.constant(2.5066283)


@wp.struct
class Errors:
    """Standard deviations, and how far apart things may lie."""

    depth: float  # [mm] of one pixel
    needle: float  # [rad]
    reach: float  # [mm] of depth over which something else may lie
    pitch: float  # [mm] of a pixel at the working distance
    edge: float  # [px] of an image's edge beside its contour; 0: contours are steps of depth, which the pixels tell


@wp.func
def depth_ratio(gap: float, std: float, reach: float) -> float:
    off = gap / std
    fits = reach / (std * ROOT_2_PI) * wp.exp(-0.5 * off * off)
    other = wp.where(gap < 0.0, 1.0, SEEN_THROUGH)
    return wp.log((1.0 - SEEN_THROUGH) * fits + other)


@wp.func
def needle_ratio(cosine: float, std: float) -> float:
    squared = 2.0 * (1.0 - cosine)  # angle^2, where it matters
    variance = std * std
    return wp.log((1.0 - OUTLIERS) / variance * wp.exp(-0.5 * squared / variance) + OUTLIERS)


@wp.func
def shading_ratio(maps: SceneMaps, row: int, column: int, normal: wp.vec3) -> float:
    total = wp.float32(0.0)
    for light in range(maps.lights.shape[0]):
        seen = maps.shading[row, column, light]
        expected = wp.max(wp.dot(normal, maps.lights[light]), 0.0)
        off = (seen - expected) / SHADING_STD
        lit = wp.exp(-0.5 * off * off) / (SHADING_STD * ROOT_2_PI)
        less = 1.0 / (1.0 + wp.exp(2.0 * off)) / wp.max(expected, SHADING_STD)
        ratio = BRIGHTEST * ((1.0 - IN_SHADOW) * lit + IN_SHADOW * less)
        total += wp.log((1.0 - OUTLIERS) * ratio + OUTLIERS)
    return total


@wp.func
def edge_ratio(distance: float, std: float) -> float:
    """Of a contour point and its distance to the nearest edge [px]."""
    off = distance / std
    beside = 2.0 / (std * ROOT_2_PI) * wp.exp(-0.5 * off * off)
    return wp.log(EDGE_FOUND * beside / EDGE_DENSITY + 1.0 - EDGE_FOUND)


@wp.func
def brightest(maps: SceneMaps, row: int, column: int) -> float:
    most = wp.float32(0.0)
    for light in range(maps.lights.shape[0]):
        most = wp.max(most, maps.shading[row, column, light])
    return most


@wp.func
def step_beside(depth: wp.array3d(dtype=float), h: int, i: int, j: int, jump: float) -> bool:
    """Whether the predicted depth steps by more than `jump` [mm] or ends beside a pixel."""
    z = depth[h, i, j]
    for side in range(4):
        row = i + wp.where(side == 0, 1, wp.where(side == 1, -1, 0))
        column = j + wp.where(side == 2, 1, wp.where(side == 3, -1, 0))
        other = wp.float32(0.0)
        if row >= 0 and row < depth.shape[1] and column >= 0 and column < depth.shape[2]:
            other = depth[h, row, column]
        if wp.abs(other - z) > jump:
            return True
    return False


@wp.func
def beside_step(
    depth: wp.array3d(dtype=float), h: int, i: int, j: int, jump: float, seen: float, std: float, reach: float
) -> float:
    """Log-likelihood ratio of a pixel beside a step: a pose's own error shows it one side or the other."""
    z = depth[h, i, j]
    side = wp.float32(0.0)
    for k in range(4):
        row = i + wp.where(k == 0, 1, wp.where(k == 1, -1, 0))
        column = j + wp.where(k == 2, 1, wp.where(k == 3, -1, 0))
        other = wp.float32(0.0)
        if row >= 0 and row < depth.shape[1] and column >= 0 and column < depth.shape[2]:
            other = depth[h, row, column]
        if other == 0.0:
            side = wp.max(side, 1.0)  # past the part may be anything
        elif wp.abs(other - z) > jump:
            side = wp.max(side, wp.exp(depth_ratio(seen - other, std, reach)))
    return wp.log((1.0 - OTHER_SIDE) * wp.exp(depth_ratio(seen - z, std, reach)) + OTHER_SIDE * side)


@wp.kernel(enable_backward=False)
def weighing_kernel(
    # In:
    seen: WindowArrays,
    normal_obj: wp.array(dtype=wp.vec3),
    maps: SceneMaps,
    errors: Errors,
    first: int,
    # Out:
    pixels: wp.array3d(dtype=float),
    at_steps: wp.array3d(dtype=float),
    hidden: wp.array3d(dtype=wp.bool),
    lit: wp.array2d(dtype=float),
    contour: wp.array2d(dtype=float),
):
    k, i = wp.tid()
    h = first + k
    size = seen.depth.shape[2]
    height = maps.depth.shape[0]
    width = maps.depth.shape[1]
    R = seen.R_cam_obj[h]
    origin = seen.origin_uv[h]
    depth_row = seen.depth[h, i]
    triangle_row = seen.triangle[h, i]
    pixels_row = pixels[h, i]
    at_steps_row = at_steps[h, i]
    hidden_row = hidden[h, i]
    row = int(origin[1] + seen.stride * float(i))
    shown = wp.float32(0.0)
    jump = 4.0 * errors.pitch * seen.stride
    for j in range(size):
        ratio = wp.float32(0.0)
        ratio_at_step = wp.float32(0.0)
        behind = wp.bool(False)
        column = int(origin[0] + seen.stride * float(j))
        inside = row >= 0 and row < height and column >= 0 and column < width
        shows = inside and triangle_row[j] >= 0
        at_step = shows and step_beside(seen.depth, h, i, j, jump)
        if shows:
            normal = R * normal_obj[triangle_row[j]]
            z = maps.depth[row, column]
            with_needle = maps.needle_weight[row, column] > 0.0
            by_sight = wp.float32(0.0)
            if with_needle:
                by_sight = needle_ratio(wp.dot(maps.normals[row, column], normal), errors.needle)
            elif z == 0.0:
                by_sight = shading_ratio(maps, row, column, normal)
            if at_step and z > 0.0:
                ratio_at_step = beside_step(seen.depth, h, i, j, jump, z, errors.depth, errors.reach)
            elif at_step:
                ratio_at_step = BLIND * wp.log((1.0 - OTHER_SIDE) * wp.exp(by_sight) + OTHER_SIDE)
            elif z > 0.0:
                moved = BORDER * errors.pitch / wp.clamp(wp.abs(normal[2]), STEEPEST, 1.0)
                std = wp.sqrt(errors.depth * errors.depth + moved * moved)
                gap = z - depth_row[j]
                ratio = depth_ratio(gap, std, errors.reach)
                if wp.abs(gap) < NEAR * std:
                    ratio += by_sight
                behind = gap < -NEAR * std
            else:
                ratio = BLIND * by_sight
            if ratio > 0.0 and brightest(maps, row, column) > LIT_SHADING:
                shown += 1.0
        pixels_row[j] = ratio
        at_steps_row[j] = ratio_at_step
        hidden_row[j] = behind
    lit[h, i] = shown

    total = wp.float32(0.0)
    if seen.contour_depth.shape[2] > 0 and errors.edge > 0.0:
        for side in range(2):
            for m in range(size):
                j = seen.contour_column[h, side, i, m]
                if j < 0:
                    break
                total += edge_ratio(edge_distance(maps, seen.contour_uv[h, side, i, j]), errors.edge)
    contour[h, i] = 0.5 * total  # contour points are counted along rows and along columns


@dataclass(frozen=True, eq=False)
class Weighed:
    """Log-likelihood ratios [nats] of windows, on the device."""

    pixels: wp.array  # [h, s, s]: above 0 the pose explains the pixel, below it contradicts it
    at_steps: wp.array  # [h, s, s]: of pixels beside the pose's own steps of depth, which `pixels` leaves out
    hidden: wp.array  # [h, s, s] of bool: pixels of the pose behind something nearer
    lit: wp.array  # [h, s] per row: pixels that speak for the pose and that a light shows
    contour: wp.array  # [h, s] per row


def room(count: int, size: int, device: str) -> Weighed:
    """Room for what every window says."""
    square, rows = (count, size, size), (count, size)
    return Weighed(
        wp.empty(square, dtype=float, device=device), wp.empty(square, dtype=float, device=device),
        wp.empty(square, dtype=wp.bool, device=device),
        wp.empty(rows, dtype=float, device=device), wp.empty(rows, dtype=float, device=device),
    )  # fmt: skip


def errors_of(depth: float, needle: float, reach: float, pitch: float, edge: float):
    """See `Errors`."""
    errors = Errors()
    errors.depth, errors.needle, errors.reach, errors.pitch, errors.edge = depth, needle, reach, pitch, edge
    return errors


def weigh_rows(
    seen: Windows, by: SeenBy, normal_obj: wp.array, errors, first: int, last: int, weighed: Weighed
) -> None:
    """Weighs the pixels of windows first .. last - 1, whose rays are cast."""
    wp.launch(
        weighing_kernel, dim=(last - first, seen.size),
        inputs=[
            seen.arrays, normal_obj, by.maps, errors, first,
        ],
        outputs=[weighed.pixels, weighed.at_steps, weighed.hidden, weighed.lit, weighed.contour], device=seen.device,
    )  # fmt: skip
