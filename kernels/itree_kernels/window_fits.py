"""Planes and quadratic surfaces fitted to the window around a pixel, and what the third order adds to their slope.

Over a full square window the six terms 1, u, v, uv, u^2, v^2 (u, v from the window's middle, the squares less their
mean) are orthogonal, so that each coefficient is one sum of its own: the quadratic surface has the same slope in the
middle as the plane, and how much better it fits is the sum of three squares (Haralick's facet model).
"""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

import cv2
import numpy as np
import warp as wp
from jaxtyping import Bool, Float

SUMS = 8  # of the value, times u, v, uv, u^2 and v^2, of its square, and of pixels that are known
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
def fit_around(sums: wp.array3d(dtype=wp.float64), i: int, j: int, radius: int) -> Fit:
    """From the sums of the window in the middle of which pixel (i, j) is."""
    m2 = mean_square(radius)
    m4 = mean_fourth(radius)
    side = wp.float64(2 * radius + 1)
    count = side * side
    spread = m4 - m2 * m2
    fit = Fit()
    fit.mean = sums[0, i, j] / count
    u = sums[1, i, j] / (count * m2)
    v = sums[2, i, j] / (count * m2)
    uv = sums[3, i, j] / (count * m2 * m2)
    uu = (sums[4, i, j] / count - m2 * fit.mean) / spread
    vv = (sums[5, i, j] / count - m2 * fit.mean) / spread
    around = sums[6, i, j] - count * fit.mean * fit.mean
    fit.slope = wp.vec2d(u, v)
    fit.bend = wp.vec3d(TWO * uu, uv, TWO * vv)
    fit.planar = wp.max(around - count * m2 * (u * u + v * v), ZERO)
    fit.curved = count * (m2 * m2 * uv * uv + spread * (uu * uu + vv * vv))
    fit.middle = fit.mean - m2 * (uu + vv)
    fit.full = sums[7, i, j] > count - HALF
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


def window_sums(
    value: Float[np.ndarray, "height width"], known: Bool[np.ndarray, "height width"], radius: int
) -> Float[np.ndarray, "sums height width"]:
    """The sums over the window around every pixel that fits are made of; those at the rim lack pixels. Best with the
    map's mean taken out: digits.
    """
    steps = np.arange(-radius, radius + 1.0)
    ones, squares = np.ones_like(steps), steps**2
    value = np.where(known, value, 0.0)
    sums = np.empty((SUMS, *value.shape))
    terms = ((ones, ones), (ones, steps), (steps, ones), (steps, steps), (ones, squares), (squares, ones))
    fields = (*((value, *term) for term in terms), (value**2, ones, ones), (known.astype(np.float64), ones, ones))
    for total, (field, over_v, over_u) in zip(sums, fields, strict=True):
        cv2.sepFilter2D(field, cv2.CV_64F, over_u, over_v, dst=total, borderType=cv2.BORDER_CONSTANT)
    return sums
