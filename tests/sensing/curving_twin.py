"""What the third order of a curved surface adds to the slope in the middle of a window.

A surface that keeps its curvature over the window (a sphere, a cylinder, a plane) has a third derivative that follows
from slope and second derivative: the covariant derivative of its second fundamental form is 0. For a graph f over axes
e_1, e_2 along a line of sight d, with tangents t_i = e_i + f_i d, metric g_ij = t_i . t_j, c^l = g^lm (d . t_m), that
says f_ijk = f_ij f_kl c^l + f_jk f_il c^l + f_ki f_jl c^l.
"""

import numpy as np
from jaxtyping import Float

ROUNDS = 2  # the slope that the third order is taken at is itself corrected: once is right within a tenth


def added_by_third_order(
    radius: int,
    slope: Float[np.ndarray, "n 2"],
    bend: Float[np.ndarray, "n 3"],
    scale: Float[np.ndarray, "n"],
    sight: Float[np.ndarray, "n 2"],
) -> Float[np.ndarray, "n 2"]:
    """What the slopes of windows have from the third order of the surfaces in them.

    Args:
        radius: of the windows [px].
        slope: of the fitted value over u and v [per px].
        bend: its second derivatives uu, uv, vv.
        scale: sizes of a pixel [mm] that the depth changes by per unit of the value.
        sight: x and y of the line of sight (x, y, 1); zeros under an orthographic camera.
    """
    steps = np.arange(-radius, radius + 1.0)
    m2, m4 = (steps**2).mean(), (steps**4).mean()  # a least-squares slope has m4/m2 of u^3, m2 of u v^2
    (p, q), (uu, uv, vv), (x, y) = (np.ascontiguousarray(a.T) for a in (slope, bend, sight))
    over_u, over_v = np.zeros_like(p), np.zeros_like(p)
    for _ in range(ROUNDS):
        c_u, c_v = _along_sight((p - over_u) * scale, (q - over_v) * scale, x, y)
        k_u, k_v = uu * c_u + uv * c_v, uv * c_u + vv * c_v
        uuu, vvv = 3.0 * uu * k_u, 3.0 * vv * k_v
        uuv, uvv = uu * k_v + 2.0 * uv * k_u, vv * k_u + 2.0 * uv * k_v
        over_u = scale * (uuu * m4 / (6.0 * m2) + uvv * m2 / 2.0)
        over_v = scale * (vvv * m4 / (6.0 * m2) + uuv * m2 / 2.0)
    return np.stack([over_u, over_v], axis=-1)


def _along_sight(
    p: Float[np.ndarray, "n"], q: Float[np.ndarray, "n"], x: Float[np.ndarray, "n"], y: Float[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """c = g^-1 (d . t) of graphs with slopes p, q [mm per mm] along their lines of sight d = (x, y, 1)."""
    square = x**2 + y**2 + 1.0
    g_uu, g_vv = 1.0 + 2.0 * p * x + p**2 * square, 1.0 + 2.0 * q * y + q**2 * square
    g_uv = q * x + p * y + p * q * square
    d_u, d_v = x + p * square, y + q * square
    determinant = g_uu * g_vv - g_uv**2
    return (g_vv * d_u - g_uv * d_v) / determinant, (g_uu * d_v - g_uv * d_u) / determinant
