"""Which lights reach a pixel: neither shadowed nor saturated nor a highlight.

No threshold at full scale does it, because interreflection fills shadows (2 / 8 / 22 % of full scale at the 50 / 90 /
99 percentile of rendered bins). Two tests relative to the pixel itself do:

- a light is in shadow when it is at the noise floor, or darker beside the pixel's brightest light than a surface within
  the slant limit can be (`shadow_ratio`): this alone serves three lights;
- of more than three lights, sets that leave out some of the darkest (shadow) and of the brightest (highlight) are
  compared by likelihood: lit lights scatter about the least-squares fit by noise and model error, a shadowed one is
  dark with an exponential of interreflection, a highlight outshines the lit ones and is anywhere above the fit.
"""

import itertools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from itree_jax.sensing.needle import Array

LIGHTS_NEEDED = 3
DEFAULT_SLANT_LIMIT = math.radians(42.0)
NOISE_SIGMAS = 4.0  # darkness and residuals are told from noise at four sigma: 20 of 307200 pixels go wrong
# Of one light beside the brightest one of its pixel, when neighbours reflect: 15 % of lit pixels of bins rendered with
# two bounces are off by more.
MODEL_ERROR = 0.03
SHADOW_FILL = 0.035  # of full albedo: the exponential whose 90 percentile is the 8 % that rendered bins show
SHADOW_PRIOR = 0.3  # of a light at a pixel: just over half of the visible area of a bin is lit by all of three lights
HIGHLIGHT_PRIOR = 0.05
HIGHLIGHTS_LEFT_OUT = 2  # at most so many: a lobe sends one light or two to the camera
MOST_FILL = 0.4  # of full albedo: beyond the 99 percentile of what fills shadows (22 % of full scale, albedo 0.6)
LEAST_SHADOW_RATIO = 0.1  # with lights far off the axis the geometric ratio is 0, but 8 % are often filled in
AZIMUTHS = 72  # every 5 degrees: the ratio changes by less than 1 % between two
LEAST_DETERMINANT = 1e-6  # of unit-trace normal equations: the set's lights lie in one plane


def shadow_ratio(L: Float[Array, "lights 3"], slant_limit: float | Float[Array, ""]) -> Float[Array, ""]:
    """The least ratio of darkest to brightest light on a lit Lambertian surface whose slant is within the limit [rad].

    A light that is darker beside the brightest one is in shadow, or the surface is beyond the limit. For three lights
    35 degrees off the axis and 42 degrees of slant it is 0.27.
    """
    azimuth = jnp.asarray(np.linspace(0.0, 2.0 * np.pi, AZIMUTHS, endpoint=False), L.dtype)
    sin, cos = jnp.sin(slant_limit), jnp.cos(slant_limit)
    normals = jnp.stack([sin * jnp.cos(azimuth), sin * jnp.sin(azimuth), -cos * jnp.ones_like(azimuth)], axis=-1)
    shading = normals @ L.T
    return jnp.maximum((shading.min(-1) / shading.max(-1)).min(), LEAST_SHADOW_RATIO)


def lights_that_reach(
    x: Float[Array, "*pixels lights"],
    std: Float[Array, "*pixels lights"],
    saturated: Bool[Array, "*pixels lights"],
    L: Float[Array, "lights 3"],
    floor: Float[Array, "lights"],
    ratio: Float[Array, ""],
) -> Bool[Array, "*pixels lights"]:
    """The most likely set of lights that reach each pixel; fewer than three where there is no such set.

    `x` intensities over light intensities, `std` theirs, `floor` the darkest that is told from noise, `ratio` of
    `shadow_ratio`.
    """
    usable = ~saturated
    rank, count = _ranks(x, usable), usable.sum(-1)[..., None]

    def candidate(darkest: Int[Array, ""], brightest_: Int[Array, ""]) -> tuple[Array, Array]:
        lit = usable & (rank >= darkest) & (rank < count - brightest_)
        lit &= x > jnp.maximum(floor, ratio * brightest(x, lit)[..., None])
        return lit, _cost(x, std, usable, lit, L)

    def better(best: tuple[Array, Array], left_out: Int[Array, "2"]) -> tuple[tuple[Array, Array], None]:
        lit, cost = candidate(left_out[0], left_out[1])
        take = cost < best[1]
        return (jnp.where(take[..., None], lit, best[0]), jnp.where(take, cost, best[1])), None

    left_out = jnp.asarray(_sets_left_out(L.shape[0]))
    (reaching, _), _ = jax.lax.scan(better, candidate(left_out[0, 0], left_out[0, 1]), left_out[1:])
    return reaching


def _sets_left_out(lights: int) -> np.ndarray:
    """How many of the darkest and of the brightest lights to leave out, none first; last, all but two are in shadow.

    The last one is no solution but what else a pixel may be: without it, two shadows would pass for a highlight.
    """
    pairs = itertools.product(range(lights - LIGHTS_NEEDED + 1), range(HIGHLIGHTS_LEFT_OUT + 1))
    kept = sorted((pair for pair in pairs if sum(pair) <= lights - LIGHTS_NEEDED), key=sum)
    return np.array([*kept, (lights - 2, 0)], dtype=np.int32)


def _ranks(x: Float[Array, "*pixels lights"], usable: Bool[Array, "*pixels lights"]) -> Int[Array, "*pixels lights"]:
    """Place of each light among the usable ones of its pixel, darkest 0; ties in the order of the lights."""
    i = jnp.arange(x.shape[-1])
    darker = (x[..., None, :] < x[..., :, None]) | ((x[..., None, :] == x[..., :, None]) & (i[None, :] < i[:, None]))
    return (darker & usable[..., None, :]).sum(-1)


def _cost(
    x: Float[Array, "*pixels lights"],
    std: Float[Array, "*pixels lights"],
    usable: Bool[Array, "*pixels lights"],
    lit: Bool[Array, "*pixels lights"],
    L: Float[Array, "lights 3"],
) -> Float[Array, "*pixels"]:
    """Negative log likelihood of the intensities if the lights `lit` reach the pixel and other usable ones do not."""
    solvable = (lit.sum(-1) >= LIGHTS_NEEDED) & (_determinant(lit, L) > LEAST_DETERMINANT)
    b, _ = solve(x, std, lit | ~solvable[..., None], L)
    top = brightest(x, lit)[..., None]
    # Two lights always fit; of the albedo they tell that it is no less than the brighter one.
    expected = jnp.where(solvable[..., None], predicted(b, L), x)
    scale = jnp.where(solvable, jnp.sqrt((b * b).sum(-1)), top[..., 0])[..., None]
    scale = jnp.maximum(scale, 1e-6)  # densities are over x / albedo
    sigma = jnp.hypot(std, MODEL_ERROR * top) / scale
    as_lit = 0.5 * ((x - expected) / scale / sigma) ** 2 + jnp.log(sigma * math.sqrt(2.0 * math.pi))
    as_lit -= math.log(1.0 - SHADOW_PRIOR - HIGHLIGHT_PRIOR)
    as_shadow = jnp.maximum(x, 0.0) / scale / SHADOW_FILL + math.log(SHADOW_FILL / SHADOW_PRIOR)
    as_other = jnp.where(x > jnp.maximum(expected, top), -math.log(HIGHLIGHT_PRIOR), as_shadow)
    return jnp.where(usable, jnp.where(lit, as_lit, as_other), 0.0).sum(-1)


def brightest(x: Float[Array, "*pixels lights"], reaching: Bool[Array, "*pixels lights"]) -> Float[Array, "*pixels"]:
    """The largest intensity among the lights that reach the pixel, at least 0."""
    return jnp.where(reaching, x, 0.0).max(-1)


def predicted(b: Float[Array, "*pixels 3"], L: Float[Array, "lights 3"]) -> Float[Array, "*pixels lights"]:
    """Lambert's x_i = b . l_i, b = albedo * normal."""
    return b @ L.T


def solve(
    x: Float[Array, "*pixels lights"],
    std: Float[Array, "*pixels lights"],
    reaching: Bool[Array, "*pixels lights"],
    L: Float[Array, "lights 3"],
) -> tuple[Float[Array, "*pixels 3"], Float[Array, "*pixels 3 lights"]]:
    """Weighted least squares b = G x over the lights that reach; they must span space.

    Weights are one over the variance of noise and model error together, relative to the largest; x, b and std may have
    any common scale.
    """
    variance = std**2 + (MODEL_ERROR * brightest(x, reaching)[..., None]) ** 2
    w = jnp.where(reaching, variance.min(-1, keepdims=True) / variance, 0.0)
    inverse = _inverse_of_symmetric(w @ _squares(L))
    G = inverse @ (w[..., None, :] * L.T)
    return (G * x[..., None, :]).sum(-1), G


def _squares(L: Float[Array, "lights 3"]) -> Float[Array, "lights 6"]:
    """xx, xy, xz, yy, yz, zz of each light."""
    i, j = np.triu_indices(3)
    return L[:, i] * L[:, j]


def _inverse_of_symmetric(A: Float[Array, "*pixels 6"]) -> Float[Array, "*pixels 3 3"]:
    a, b, c, d, e, f = jnp.moveaxis(A, -1, 0)
    cofactors = (d * f - e * e, c * e - b * f, b * e - c * d, a * f - c * c, b * c - a * e, a * d - b * b)
    determinant = a * cofactors[0] + b * cofactors[1] + c * cofactors[2]
    xx, xy, xz, yy, yz, zz = (cofactor / determinant for cofactor in cofactors)
    return jnp.stack([jnp.stack([xx, xy, xz], -1), jnp.stack([xy, yy, yz], -1), jnp.stack([xz, yz, zz], -1)], axis=-2)


def _determinant(lit: Bool[Array, "*pixels lights"], L: Float[Array, "lights 3"]) -> Float[Array, "*pixels"]:
    """Of the sum of l l^T over the lit lights, divided by their number: 1/27 at most, 0 for lights in one plane."""
    number = jnp.maximum(lit.sum(-1, keepdims=True), 1).astype(L.dtype)
    a, b, c, d, e, f = jnp.moveaxis((lit.astype(L.dtype) @ _squares(L)) / number, -1, 0)
    return a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)
