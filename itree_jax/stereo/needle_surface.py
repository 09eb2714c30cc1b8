"""The surface that needles and matched points agree on.

A needle fixes the slope of log depth between neighbours (under a pinhole, d ln z / du = -n_x / (f n . r), r the viewing
ray with z = 1); matched points fix depth itself, coarsely. The surface is the least-squares compromise of both,
reweighted: a link across a depth step, or a point that was matched wrongly, gives in.
"""

from functools import partial
from typing import NamedTuple

import cv2
import jax
import jax.numpy as jnp
import numpy as np
from itree_kernels.camera import Camera
from jaxtyping import Array, Float
from scipy.ndimage import distance_transform_edt

NEEDLE_ERROR = np.radians(2.0)  # of a needle, what neighbours share of it included
LOOSE = 10.0  # times that error is what links pixels without a needle: depth goes on as it is
STEP = 0.6  # [mm] between neighbours beyond which a link is more likely broken than wrong
DOUBT = 2.0  # deviations at which a matched point has a quarter of its weight
ROUNDS = 4  # of reweighting; later ones move nothing by a tenth of a millimetre
LONE = 5  # [px] side of the window in which a depth needs company to begin with
ITERATIONS = 80  # of conjugate gradients in each round, from where the last one ended


class Slopes(NamedTuple):
    """What needles say about log depth between pixel neighbours, toward the right and downward."""

    right: Float[np.ndarray, "height width1"]
    down: Float[np.ndarray, "height1 width"]
    weight_right: Float[np.ndarray, "height width1"]  # 0..1
    weight_down: Float[np.ndarray, "height1 width"]


def needle_slopes(
    normals: Float[np.ndarray, "height width 3"], weight: Float[np.ndarray, "height width"], camera: Camera
) -> Slopes:
    """Differences of log depth between neighbours from their needles; weight 0 where either has none."""
    v, u = np.indices(weight.shape)
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    toward = normals[..., 0] * x + normals[..., 1] * y + normals[..., 2]
    seen = (toward < -0.05) & (weight > 0.0)
    toward = np.where(seen, toward, -1.0)
    across, along = -normals[..., 0] / (camera.fx * toward), -normals[..., 1] / (camera.fy * toward)
    w = np.where(seen, weight, 0.0)
    w_right, w_down = np.minimum(w[:, :-1], w[:, 1:]), np.minimum(w[:-1], w[1:])
    right = np.where(w_right > 0.0, 0.5 * (across[:, :-1] + across[:, 1:]), 0.0)
    down = np.where(w_down > 0.0, 0.5 * (along[:-1] + along[1:]), 0.0)
    return Slopes(*(a.astype(np.float32) for a in (right, down, w_right, w_down)))


def surface(
    slopes: Slopes,
    matched: Float[np.ndarray, "height width"],
    deviation: Float[np.ndarray, "height width"],
    camera: Camera,
    start: Float[np.ndarray, "height width"] | None = None,
    rounds: int = ROUNDS,
) -> Float[np.ndarray, "height width"]:
    """Depth [mm] everywhere, from matched depths [mm] (0 = none) with their deviations [mm] and the needles' slopes.

    Where nothing is matched and no needle leads, depth is that of the surroundings: what is known there is for the
    caller to say. `start`: a surface to begin from.
    """
    there = matched > 0.0
    middle = float(np.median(matched[there])) if there.any() else 1.0
    unit = middle / camera.fx * NEEDLE_ERROR / middle  # of log depth from pixel to pixel
    target = np.log(np.where(there, matched, middle) / middle).astype(np.float32)
    s = np.log((_filled(matched, middle) if start is None else start) / middle).astype(np.float32)
    relative = (deviation / middle / unit).astype(np.float32)
    known = jnp.asarray(there)
    return middle * np.exp(np.asarray(_surface(jnp.asarray(s), jnp.asarray(target), known, jnp.asarray(relative),
                                               slopes, unit, STEP / middle, rounds)))


def _filled(matched: Float[np.ndarray, "height width"], middle: float) -> Float[np.ndarray, "height width"]:
    """Each pixel's nearest matched depth, without lone pixels that differ: what links are held against at first. One
    that starts broken for want of a depth beside it would stay so, and a wrong point cut off would keep its place.
    """
    there = matched > 0.0
    if not there.any():
        return np.full(matched.shape, middle)
    i, j = np.asarray(distance_transform_edt(~there, return_distances=False, return_indices=True))
    return cv2.medianBlur(np.ascontiguousarray(matched[i, j], np.float32), LONE)


@partial(jax.jit, static_argnames=("rounds",))
def _surface(
    s: Float[Array, "h w"], target: Float[Array, "h w"], known: Array, relative: Float[Array, "h w"], slopes: Slopes,
    unit: float, step: float, rounds: int,
) -> Float[Array, "h w"]:
    """Log depth. Residuals are in units of the needles' error per pixel."""

    def weigh(s: Float[Array, "h w"], first: Array) -> tuple[Array, Array, Array]:
        off = (s - target) / unit / (DOUBT * relative)
        data = jnp.where(known, jnp.where(first, 1.0, _give(off)) / relative**2, 0.0)
        right = _give((s[:, 1:] - s[:, :-1] - slopes.right) / step) * (slopes.weight_right + LOOSE**-2)
        down = _give((s[1:] - s[:-1] - slopes.down) / step) * (slopes.weight_down + LOOSE**-2)
        return data, right, down

    def one_round(k: Array, s: Float[Array, "h w"]) -> Float[Array, "h w"]:
        data, right, down = weigh(s, k == 0)

        def apply(x: Float[Array, "h w"]) -> Float[Array, "h w"]:
            return data * x + _divergence(right * (x[:, 1:] - x[:, :-1]), down * (x[1:] - x[:-1]))

        b = data * target + _divergence(right * slopes.right, down * slopes.down)
        diagonal = data + 1e-9 + _spread(right, down)
        return jax.scipy.sparse.linalg.cg(apply, b, x0=s, maxiter=ITERATIONS, tol=1e-7, M=lambda r: r / diagonal)[0]

    return jax.lax.fori_loop(0, rounds, one_round, s)


def _give(off: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Geman and McClure's weight: 1 at no residual, 1/4 at 1."""
    return 1.0 / jnp.square(1.0 + jnp.square(off))


def _divergence(right: Float[Array, "h w1"], down: Float[Array, "h1 w"]) -> Float[Array, "h w"]:
    """The transpose of taking differences."""
    across = jnp.pad(right, ((0, 0), (1, 0))) - jnp.pad(right, ((0, 0), (0, 1)))
    return across + jnp.pad(down, ((1, 0), (0, 0))) - jnp.pad(down, ((0, 1), (0, 0)))


def _spread(right: Float[Array, "h w1"], down: Float[Array, "h1 w"]) -> Float[Array, "h w"]:
    across = jnp.pad(right, ((0, 0), (1, 0))) + jnp.pad(right, ((0, 0), (0, 1)))
    return across + jnp.pad(down, ((1, 0), (0, 0))) + jnp.pad(down, ((0, 1), (0, 0)))
