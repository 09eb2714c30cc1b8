"""Planes and quadratic surfaces fitted to the window around a pixel, and what the third order adds to their slope.

Over a full square window the six terms 1, u, v, uv, u^2, v^2 (u, v from the window's middle, the squares less their
mean) are orthogonal, so that each coefficient is one sum of its own: the quadratic surface has the same slope in the
middle as the plane, and how much better it fits is the sum of three squares (Haralick's facet model).
"""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

import warp as wp

from itree_kernels.threads import launch_in_chunks
from itree_kernels.warp_start import load_kernel

Sums = wp.types.vector(length=8, dtype=wp.float64)  # of the value, times u, v, uv, u^2 and v^2, of its square, and of
# pixels that are known
SUMS_OF_ROW = 5
TOGETHER = wp.constant(32)  # rows: their sums are read and written while they are in the cache
ROUNDS = 2  # the slope that the third order is taken at is itself corrected: once is right within a tenth
ZERO = wp.constant(wp.float64(0.0))
HALF = wp.constant(wp.float64(0.5))
ONE = wp.constant(wp.float64(1.0))
TWO = wp.constant(wp.float64(2.0))
THREE = wp.constant(wp.float64(3.0))


@wp.struct
class Fit:
    """Of the window of (2 radius + 1)^2 pixels around a pixel. Where it is not `full` the rest means nothing."""

    mean: wp.float64
    slope: wp.vec2d  # of the value over u and over v, of the plane and of the quadric
    bend: wp.vec3d  # second derivatives uu, uv, vv of the quadric
    planar: wp.float64  # sum of squared residuals of the plane
    curved: wp.float64  # how much of it the quadric explains: of three terms
    middle: wp.float64  # the quadric's value in the middle
    full: wp.bool  # the window lies within the image and its pixels are known


@wp.func
def mean_square(radius: int) -> wp.float64:
    """Of -radius .. radius."""
    r = wp.float64(radius)
    return r * (r + ONE) / THREE


@wp.func
def mean_fourth(radius: int) -> wp.float64:
    """Mean fourth power of -radius .. radius."""
    r = wp.float64(radius)
    return r * (r + ONE) * (THREE * r * r + THREE * r - ONE) / wp.float64(15.0)


@wp.func
def fit_to(sums: Sums, radius: int) -> Fit:
    """From the sums over a window."""
    m2 = mean_square(radius)
    m4 = mean_fourth(radius)
    side = wp.float64(2 * radius + 1)
    count = side * side
    spread = m4 - m2 * m2
    fit = Fit()
    fit.mean = sums[0] / count
    u = sums[1] / (count * m2)
    v = sums[2] / (count * m2)
    uv = sums[3] / (count * m2 * m2)
    uu = (sums[4] / count - m2 * fit.mean) / spread
    vv = (sums[5] / count - m2 * fit.mean) / spread
    around = sums[6] - count * fit.mean * fit.mean
    fit.slope = wp.vec2d(u, v)
    fit.bend = wp.vec3d(TWO * uu, uv, TWO * vv)
    fit.planar = wp.max(around - count * m2 * (u * u + v * v), ZERO)
    fit.curved = count * (m2 * m2 * uv * uv + spread * (uu * uu + vv * vv))
    fit.middle = fit.mean - m2 * (uu + vv)
    fit.full = sums[7] > count - HALF
    return fit


@wp.func
def along_sight(p: wp.float64, q: wp.float64, x: wp.float64, y: wp.float64) -> wp.vec2d:
    """c = g^-1 (d . t) of a graph with slopes p, q [mm per mm] along its line of sight d = (x, y, 1)."""
    square = x * x + y * y + ONE
    g_uu = ONE + TWO * p * x + p * p * square
    g_vv = ONE + TWO * q * y + q * q * square
    g_uv = q * x + p * y + p * q * square
    d_u = x + p * square
    d_v = y + q * square
    determinant = g_uu * g_vv - g_uv * g_uv
    return wp.vec2d((g_vv * d_u - g_uv * d_v) / determinant, (g_uu * d_v - g_uv * d_u) / determinant)


@wp.func
def added_by_third_order(
    radius: int, slope: wp.vec2d, bend: wp.vec3d, scale: wp.float64, x: wp.float64, y: wp.float64
) -> wp.vec2d:
    """What the slope of a window has from the third order of the surface in it.

    A surface that keeps its curvature over the window (a sphere, a cylinder, a plane) has a third derivative that
    follows from slope and second derivative: the covariant derivative of its second fundamental form is 0. For a graph
    f over axes e_1, e_2 along a line of sight d, with tangents t_i = e_i + f_i d, metric g_ij = t_i . t_j,
    c^l = g^lm (d . t_m), that says f_ijk = f_ij f_kl c^l + f_jk f_il c^l + f_ki f_jl c^l.

    `scale`: sizes of a pixel [mm] that the depth changes by per unit of the value; (x, y, 1) is the line of sight,
    zeros under an orthographic camera.
    """
    m2 = mean_square(radius)
    m4 = mean_fourth(radius)  # a least-squares slope has m4 / m2 of u^3, m2 of u v^2
    uu = bend[0]
    uv = bend[1]
    vv = bend[2]
    over = wp.vec2d()
    for _ in range(ROUNDS):
        c = along_sight((slope[0] - over[0]) * scale, (slope[1] - over[1]) * scale, x, y)
        k_u = uu * c[0] + uv * c[1]
        k_v = uv * c[0] + vv * c[1]
        uuv = uu * k_v + TWO * uv * k_u
        uvv = vv * k_u + TWO * uv * k_v
        over = wp.vec2d(
            scale * (THREE * uu * k_u * m4 / (wp.float64(6.0) * m2) + uvv * m2 * HALF),
            scale * (THREE * vv * k_v * m4 / (wp.float64(6.0) * m2) + uuv * m2 * HALF),
        )
    return over


@wp.func
def moved_on(moments: wp.vec3d, entering: wp.float64, leaving: wp.float64, radius: int) -> wp.vec3d:
    """Sums of the values in a row of pixels, of these times u and times u^2 (u from its middle), one pixel farther on.
    """
    after = wp.float64(radius)
    before = after + ONE
    return wp.vec3d(
        moments[0] + entering - leaving,
        moments[1] - moments[0] + after * entering + before * leaving,
        moments[2] - TWO * moments[1] + moments[0] + after * after * entering - before * before * leaving,
    )


@wp.func
def is_known(known: wp.array2d(dtype=wp.bool), i: int, j: int) -> wp.bool:
    """No pixel beyond the map is."""
    found = wp.bool(False)
    if i >= 0 and i < known.shape[0] and j >= 0 and j < known.shape[1]:
        found = known[i, j]
    return found


@wp.kernel(enable_backward=False)
def sums_along_rows_kernel(
    # In:
    value: wp.array2d(dtype=wp.float64),
    known: wp.array2d(dtype=wp.bool),
    radius: int,
    first: int,
    # Out:
    rows: wp.array3d(dtype=wp.float64),
):
    """Of the pixels beside every pixel: sums of the value, of it times u and u^2, of its square, and their number."""
    i = first + wp.tid()
    width = value.shape[1]
    moments = wp.vec3d()
    square = wp.float64(0.0)
    count = wp.float64(0.0)
    for j in range(-radius, width):
        entering = wp.float64(0.0)
        leaving = wp.float64(0.0)
        enters = j + radius
        leaves = enters - 2 * radius - 1
        if is_known(known, i, enters):
            entering = value[i, enters]
            count += ONE
        if is_known(known, i, leaves):
            leaving = value[i, leaves]
            count -= ONE
        moments = moved_on(moments, entering, leaving, radius)
        square += entering * entering - leaving * leaving
        if j >= 0:
            rows[0, i, j] = moments[0]
            rows[1, i, j] = moments[1]
            rows[2, i, j] = moments[2]
            rows[3, i, j] = square
            rows[4, i, j] = count


@wp.kernel(enable_backward=False)
def sums_of_windows_kernel(
    # In:
    rows: wp.array3d(dtype=wp.float64),
    radius: int,
    first: int,
    # Out:
    sums: wp.array2d(dtype=Sums),
):
    """What `fit_to` takes, of `TOGETHER` pixels of a column."""
    k, j = wp.tid()
    height = rows.shape[1]
    top = (first + k) * TOGETHER
    plain = wp.vec3d()
    along_u = wp.vec3d()
    others = wp.vec3d()  # of the value times u^2, of its square, of pixels that are known
    for i in range(top - 2 * radius, wp.min(top + TOGETHER, height)):
        entering = wp.vec2d()
        leaving = wp.vec2d()
        enters = i + radius
        leaves = enters - 2 * radius - 1
        if enters >= 0 and enters < height:
            entering = wp.vec2d(rows[0, enters, j], rows[1, enters, j])
            others += wp.vec3d(rows[2, enters, j], rows[3, enters, j], rows[4, enters, j])
        if leaves >= 0 and leaves >= top - radius:
            leaving = wp.vec2d(rows[0, leaves, j], rows[1, leaves, j])
            others -= wp.vec3d(rows[2, leaves, j], rows[3, leaves, j], rows[4, leaves, j])
        plain = moved_on(plain, entering[0], leaving[0], radius)
        along_u = moved_on(along_u, entering[1], leaving[1], radius)
        if i >= top:
            sums[i, j] = Sums(
                plain[0], along_u[0], plain[1], along_u[1], others[0], plain[2], others[1], others[2]
            )


@wp.func
def sums_at(
    value: wp.array2d(dtype=wp.float64), known: wp.array2d(dtype=wp.bool), i: int, j: int, radius: int
) -> Sums:
    """The same of one window alone."""
    sums = Sums()
    for down in range(-radius, radius + 1):
        for right in range(-radius, radius + 1):
            row = i + down
            column = j + right
            if is_known(known, row, column):
                f = value[row, column]
                u = wp.float64(right)
                v = wp.float64(down)
                sums += Sums(f, f * u, f * v, f * u * v, f * u * u, f * v * v, f * f, ONE)
    return sums


def window_sums(value: wp.array, known: wp.array, radius: int) -> wp.array:
    """The sums over the window around every pixel of a map in double precision; those at the rim lack pixels. Best with
    the map's mean taken out: digits. Runs on the host.

    A window's sums come from its neighbour's, by what enters and what leaves: along rows, then down columns.
    """
    device, (height, width) = value.device, value.shape
    rows = wp.empty((SUMS_OF_ROW, height, width), dtype=wp.float64, device=device)
    sums = wp.empty((height, width), dtype=Sums, device=device)

    def along_rows(first: int, last: int) -> None:
        wp.launch(
            sums_along_rows_kernel, dim=last - first, inputs=[value, known, radius, first], outputs=[rows],
            device=device,
        )  # fmt: skip

    def down_columns(first: int, last: int) -> None:
        wp.launch(
            sums_of_windows_kernel, dim=(last - first, width), inputs=[rows, radius, first], outputs=[sums],
            device=device,
        )  # fmt: skip

    for kernel in (sums_along_rows_kernel, sums_of_windows_kernel):
        load_kernel(kernel, device)
    launch_in_chunks(along_rows, height, width, device)
    launch_in_chunks(down_columns, -(-height // TOGETHER), TOGETHER * width, device)
    return sums
