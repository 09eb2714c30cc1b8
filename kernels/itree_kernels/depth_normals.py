"""Normals of a depth map's pixels from the windows that compete for each (see `itree_jax.sensing.depth_needles`)."""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

import numpy as np
import warp as wp
from jaxtyping import Bool, Float

from itree_kernels.camera import Camera
from itree_kernels.threads import launch_in_chunks
from itree_kernels.warp_start import load_kernel, warp_device
from itree_kernels.window_fits import ONE, TWO, ZERO, Fit, Sums, added_by_third_order, fit_to, sums_at, window_sums

FITS = wp.constant(wp.float64(3.0))  # standard deviations of the sum of squared residuals above what noise gives: one
# window in a thousand
# The squares of the three curvature terms over the noise's variance sum to 3 on a plane, to less than 6.3 in nine of
# ten windows; on a cylinder of 10 px radius (0.3 mm of noise, 0.5 mm per pixel) to 20 and more.
FLAT = wp.constant(wp.float64(6.3))
BENT = wp.constant(wp.float64(60.0))  # of the same sum: a crease of 45 degrees or more. What curves as much is seldom
# flat beside.
MOST_ADDED = wp.constant(wp.float64(0.06))  # [rad] by the third order: the fourth, unknown, is then within a degree
LEAST_NOISE = wp.constant(wp.float64(0.05))  # of a pixel's size: what smooth surfaces depart from quadratic ones
PIXEL_WORK = 8  # rays that a pixel's windows take as long as


@wp.struct
class Lens:
    """The camera, in double precision, and what is fitted under it: inverse depth, or depth."""

    fx: wp.float64
    fy: wp.float64
    cx: wp.float64
    cy: wp.float64
    orthographic: wp.bool
    mean: wp.float64  # that was taken out of what is fitted
    noise: wp.float64  # of the depth [mm]


@wp.struct
class Taken:
    """The window that a pixel takes."""

    slope: wp.vec2d  # of the value over u and v
    level: wp.float64  # the value
    side: int  # of the window [px]; 0: none fits


@wp.func
def size_of_pixel(lens: Lens, z: wp.float64) -> wp.float64:
    """[mm] at a depth."""
    return wp.where(lens.orthographic, ONE, z) / lens.fx


@wp.func
def per_mm(lens: Lens, z: wp.float64) -> wp.float64:
    """How much of the value a millimetre of depth is."""
    return wp.where(lens.orthographic, ONE, -ONE / (z * z))


@wp.func
def variance_at(lens: Lens, z: wp.float64) -> wp.float64:
    """Of the value's noise."""
    std = wp.max(lens.noise, LEAST_NOISE * size_of_pixel(lens, z)) * per_mm(lens, z)
    return std * std


@wp.func
def as_noisy(fit: Fit, squares: wp.float64, variance: wp.float64, radius: int, terms: int) -> bool:
    """Whether residuals about a surface of so many terms are no larger than the noise makes them."""
    free = wp.float64((2 * radius + 1) * (2 * radius + 1) - terms)
    return fit.full and squares <= (free + FITS * wp.sqrt(TWO * free)) * variance


@wp.func
def take_around(
    taken: Taken, sums: Sums, radius: int, lens: Lens, z: wp.float64, i: int, j: int, unless_bent: bool
) -> Taken:
    """A pixel without a window takes the slope of the quadratic surface that fits around, less what the third order
    adds.
    """
    if taken.side == 0:
        fit = fit_to(sums, radius)
        variance = variance_at(lens, z)
        straight = not unless_bent or fit.curved <= BENT * variance
        if straight and as_noisy(fit, fit.planar - fit.curved, variance, radius, 6):
            x = wp.where(lens.orthographic, ZERO, (wp.float64(j) - lens.cx) / lens.fx)
            y = wp.where(lens.orthographic, ZERO, (wp.float64(i) - lens.cy) / lens.fy)
            scale = ONE / (per_mm(lens, z) * size_of_pixel(lens, z))
            added = added_by_third_order(radius, fit.slope, fit.bend, scale, x, y)
            if wp.abs(added[0] * scale) <= MOST_ADDED and wp.abs(added[1] * scale) <= MOST_ADDED:
                taken.slope = fit.slope - added
                taken.level = fit.middle
                taken.side = 2 * radius + 1
    return taken


@wp.func
def take_beside(
    taken: Taken, sums: wp.array2d(dtype=Sums), radius: int, lens: Lens, depth: wp.array2d(dtype=wp.float64),
    i: int, j: int,
) -> Taken:
    """A pixel without a window takes the flattest one that has it on its border, if that is a plane."""
    if taken.side == 0:
        best = wp.float64(wp.inf)
        for down in range(-1, 2):
            for right in range(-1, 2):
                row = i + down * radius
                column = j + right * radius
                inside = row >= 0 and row < depth.shape[0] and column >= 0 and column < depth.shape[1]
                if inside and (down != 0 or right != 0):
                    fit = fit_to(sums[row, column], radius)
                    variance = variance_at(lens, depth[row, column])
                    if as_noisy(fit, fit.planar, variance, radius, 3) and fit.curved <= FLAT * variance:
                        score = fit.planar / variance
                        if score < best:
                            best = score
                            away = wp.vec2d(wp.float64(right * radius), wp.float64(down * radius))
                            taken.slope = fit.slope
                            taken.level = fit.mean - wp.dot(fit.slope, away)
                            taken.side = 2 * radius + 1
    return taken


@wp.func
def normal_of(taken: Taken, lens: Lens, i: int, j: int) -> wp.vec3d:
    """Toward the camera, of the plane with this value and slope of the value at a pixel."""
    a = taken.slope[0]
    b = taken.slope[1]
    at_axis = ONE
    if not lens.orthographic:
        level = taken.level + lens.mean
        at_axis = level + a * (lens.cx - wp.float64(j)) + b * (lens.cy - wp.float64(i))
    toward = wp.vec3d(a * lens.fx, b * lens.fy, at_axis)
    # under an orthographic camera z = a u + b v + c with u = fx x + cx
    toward = wp.where(lens.orthographic, wp.vec3d(toward[0], toward[1], -ONE), -toward)
    return toward / wp.max(wp.length(toward), wp.float64(1e-12))


@wp.func
def turned_by_noise(normal: wp.vec3d, pitch: wp.float64, noise: wp.float64, side: int) -> wp.float64:
    """Angle [rad] from the regression's slope error: noise over the root of the window's squared distances, in two
    directions; a slanted surface's pixels lie farther apart, which its cosine takes into account.
    """
    square = wp.float64(side * side)
    slope = noise / (pitch * wp.sqrt(wp.max(square * (square - ONE) / wp.float64(12.0), ONE)))
    cosine = wp.abs(normal[2])
    return slope * cosine * wp.sqrt(ONE + cosine * cosine)  # across the tilt cos, along it cos^2


@wp.kernel(enable_backward=False)
def depth_normals_kernel(
    # In:
    there: wp.array2d(dtype=wp.bool),
    depth: wp.array2d(dtype=wp.float64),
    value: wp.array2d(dtype=wp.float64),
    full: wp.array2d(dtype=wp.bool),
    lens: Lens,
    radius: int,
    least: int,
    sums: wp.array2d(dtype=Sums),
    first: int,
    # Out:
    normals: wp.array2d(dtype=wp.vec3),
    known: wp.array2d(dtype=wp.bool),
    std: wp.array2d(dtype=float),
):
    k, j = wp.tid()
    i = first + k
    z = depth[i, j]
    taken = Taken()
    normal = wp.vec3d()
    found = wp.bool(False)
    if there[i, j]:
        taken = take_around(taken, sums[i, j], radius, lens, z, i, j, True)
        taken = take_beside(taken, sums, radius, lens, depth, i, j)
        if full[i, j]:
            taken = take_around(taken, sums[i, j], radius, lens, z, i, j, False)
            for smaller in range(1, radius - least + 1):
                if taken.side == 0:
                    alone = sums_at(value, full, i, j, radius - smaller)
                    taken = take_around(taken, alone, radius - smaller, lens, z, i, j, False)
        if taken.side > 0:
            normal = normal_of(taken, lens, i, j)
            found = normal[2] < ZERO
    known[i, j] = found
    normals[i, j] = wp.vec3()
    std[i, j] = 0.0
    if found:
        normals[i, j] = wp.vec3(float(normal[0]), float(normal[1]), float(normal[2]))
        std[i, j] = float(turned_by_noise(normal, size_of_pixel(lens, z), lens.noise, taken.side))


def depth_normals(
    depth: Float[np.ndarray, "height width"], there: Bool[np.ndarray, "height width"],
    value: Float[np.ndarray, "height width"], full: Bool[np.ndarray, "height width"], mean: float, camera: Camera,
    noise: float, radius: int, least: int,
) -> tuple[Float[np.ndarray, "height width 3"], Bool[np.ndarray, "height width"], Float[np.ndarray, "height width"]]:
    """Unit normals toward the camera, where they are known, and their standard deviations [rad].

    `depth` [mm] is positive everywhere, and measured where it is `there`; `value`, what is fitted, less its `mean`, has
    to be known where it is `full`. Windows have this `radius`, and where none fits smaller ones down to the `least`.
    Runs on the host.
    """
    device, height = warp_device("cpu"), len(depth)
    lens = Lens()
    lens.fx, lens.fy, lens.cx, lens.cy = camera.fx, camera.fy, camera.cx, camera.cy
    lens.orthographic, lens.mean, lens.noise = camera.is_orthographic, mean, noise

    def on_device(array: np.ndarray, kind: type) -> wp.array:
        return wp.array(np.ascontiguousarray(array), dtype=kind, device=device, copy=False)

    fields = [
        on_device(there, wp.bool), on_device(depth, wp.float64), on_device(value, wp.float64), on_device(full, wp.bool),
    ]  # fmt: skip
    sums = window_sums(*fields[2:], radius)
    found = [
        wp.empty(depth.shape, dtype=wp.vec3, device=device), wp.empty(depth.shape, dtype=wp.bool, device=device),
        wp.empty(depth.shape, dtype=float, device=device),
    ]  # fmt: skip

    def choose_in_rows(first: int, last: int) -> None:
        wp.launch(
            depth_normals_kernel, dim=(last - first, depth.shape[1]),
            inputs=[*fields, lens, radius, least, sums, first], outputs=found, device=device,
        )  # fmt: skip

    load_kernel(depth_normals_kernel, device)
    launch_in_chunks(choose_in_rows, height, rays_each=PIXEL_WORK * depth.shape[1], device=device)
    normals, known, std = (array.numpy() for array in found)
    return normals, known, std
