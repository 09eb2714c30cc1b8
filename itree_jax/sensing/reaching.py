"""Which lights reach a pixel: neither shadowed nor saturated nor a highlight.

No threshold at full scale does it, because interreflection fills shadows (2 / 8 / 22 % of full scale at the 50 / 90 /
99 percentile of rendered bins). Two tests relative to the pixel itself do:

- a light is in shadow when it is at the noise floor, or darker beside the pixel's brightest light than a surface within
  the slant limit can be (`shadow_ratio`): this alone serves three lights;
- of more than three lights, sets that leave out some of the darkest (shadow) and of the brightest (highlight) are
  compared by likelihood: lit lights scatter about the least-squares fit by noise and model error, a shadowed one is
  dark with an exponential of interreflection, a highlight outshines the lit ones and is anywhere above the fit.

The likelihoods also tell how probable each light's shadow is. Lights come first in all arrays here: every step is then
an operation on whole images, one light after another, which the compiler turns into vector instructions.
"""

import itertools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from itree_jax.sensing.least_squares import LightPlanes, light_sum, normal_equations
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
HIGHLIGHT_STDS = 2.0  # above the fit: what agrees with it is no highlight, however bright
HIGHLIGHTS_LEFT_OUT = 2  # at most so many: a lobe sends one light or two to the camera
MOST_FILL = 0.4  # of full albedo: beyond the 99 percentile of what fills shadows (22 % of full scale, albedo 0.6)
LEAST_SHADOW_RATIO = 0.1  # with lights far off the axis the geometric ratio is 0, but 8 % are often filled in
AZIMUTHS = 72  # every 5 degrees: the ratio changes by less than 1 % between two
# Of a lit light, beside the logarithm of its deviation: the Gaussian's own, less that of its prior.
LIT_COST = 0.5 * math.log(2.0 * math.pi) - math.log(1.0 - SHADOW_PRIOR - HIGHLIGHT_PRIOR)
LEAST_DETERMINANT = 1e-6  # of unit-trace normal equations: the set's lights lie in one plane


class Reaching(NamedTuple):
    """Which lights reach each pixel."""

    lit: Bool[Array, "lights *pixels"]  # the most likely set; fewer than three where there is no such set
    shadow_probability: Float[Array, "lights *pixels"]  # over all sets that were compared


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
    x: Float[Array, "lights *pixels"],
    std: Float[Array, "lights *pixels"],
    saturated: Bool[Array, "lights *pixels"],
    L: LightPlanes,
    floor: Float[Array, "lights *or_pixels"],
    ratio: Float[Array, ""],
) -> Reaching:
    """The most likely set of lights that reach each pixel, and the probability that each is in shadow there.

    `x` intensities over light intensities, `std` theirs, `floor` the darkest that is told from noise, `ratio` of
    `shadow_ratio`. Where three lights are all there are, their fit is exact and says nothing: the ratio decides, and
    the probability is that of darkness alone. A saturated light is lit: its probability of shadow is 0.
    """
    usable = ~saturated
    rank, count = _ranks(x, usable), light_sum(usable.astype(jnp.int32))

    def candidate(left_out: Int[Array, "2"]) -> tuple[Array, Array, Array]:
        lit = usable & (rank >= left_out[0]) & (rank < count - left_out[1])
        lit &= x > jnp.maximum(floor, ratio * brightest(x, lit))
        cost, shadow = _cost(x, std, usable, lit, L)
        return lit, cost, shadow

    def compare(so_far: tuple, left_out: Int[Array, "2"]) -> tuple[tuple, None]:
        best, least, total, shadows = so_far
        lit, cost, shadow = candidate(left_out)
        take = cost < least
        lower = jnp.minimum(cost, least)
        keep, new = jnp.exp(lower - least), jnp.exp(lower - cost)
        return (
            jnp.where(take, lit, best), lower, keep * total + new, keep * shadows + new * shadow.astype(x.dtype),
        ), None  # fmt: skip

    nothing = jnp.zeros_like(x[0])
    start = (jnp.zeros_like(usable), nothing + jnp.inf, nothing, jnp.zeros_like(x))
    # All sets go through the loop, the first one too: a loop of one round would be fused into what uses its result,
    # and computed again in every use.
    (best, _, total, shadows), _ = jax.lax.scan(compare, start, jnp.asarray(_sets_left_out(len(x))))
    return Reaching(best, shadows / total)


def _sets_left_out(lights: int) -> np.ndarray:
    """How many of the darkest and of the brightest lights to leave out, none first; last, all but two are in shadow.

    The last one is no solution but what else a pixel may be: without it, two shadows would pass for a highlight.
    """
    pairs = itertools.product(range(lights - LIGHTS_NEEDED + 1), range(HIGHLIGHTS_LEFT_OUT + 1))
    kept = sorted((pair for pair in pairs if sum(pair) <= lights - LIGHTS_NEEDED), key=sum)
    return np.array([*kept, (lights - 2, 0)], dtype=np.int32)


def _ranks(x: Float[Array, "lights *pixels"], usable: Bool[Array, "lights *pixels"]) -> Int[Array, "lights *pixels"]:
    """Place of each light among the usable ones of its pixel, darkest 0; ties in the order of the lights."""
    lights = range(len(x))
    return jnp.stack([
        light_sum(jnp.stack([
            (usable[j] & ((x[j] < x[i]) | ((x[j] == x[i]) & (j < i)))).astype(jnp.int32) for j in lights if j != i
        ]))
        for i in lights
    ])  # fmt: skip


def _cost(
    x: Float[Array, "lights *pixels"],
    std: Float[Array, "lights *pixels"],
    usable: Bool[Array, "lights *pixels"],
    lit: Bool[Array, "lights *pixels"],
    L: LightPlanes,
) -> tuple[Float[Array, "*pixels"], Bool[Array, "lights *pixels"]]:
    """Negative log likelihood of the intensities if the lights `lit` reach the pixel and other usable ones do not, and
    which of these would be shadows (the others are highlights).
    """
    top = brightest(x, lit)
    variance = std**2 + (MODEL_ERROR * top) ** 2
    precision = 1.0 / jnp.maximum(variance, 1e-30)
    weight = jnp.where(lit, precision * variance.min(0), 0.0)
    solved = normal_equations(weight, L)
    solvable = (light_sum(lit.astype(jnp.int32)) >= LIGHTS_NEEDED) & (_spread(lit, L) > LEAST_DETERMINANT)
    b = solved.solve(light_sum(weight[:, None] * x[:, None] * L))
    # Two lights always fit; of the albedo they tell that it is no less than the brighter one.
    scale = jnp.maximum(jnp.where(solvable, jnp.sqrt(light_sum(b * b)), top), 1e-6)  # densities are over x / albedo
    over = 1.0 / scale

    def add_light(so_far: Array, light: tuple) -> tuple[Array, Array]:
        seen, is_usable, is_lit, off, toward = light
        expected = jnp.where(solvable, light_sum(b * toward), seen)
        sigma = jnp.sqrt(off) * over
        as_lit = 0.5 * ((seen - expected) * over / sigma) ** 2 + jnp.log(sigma) + LIT_COST
        outshines = seen > jnp.maximum(expected + HIGHLIGHT_STDS * jnp.sqrt(off), top)
        as_shadow = jnp.maximum(seen, 0.0) * (over / SHADOW_FILL) + math.log(SHADOW_FILL / SHADOW_PRIOR)
        as_other = jnp.where(outshines, -math.log(HIGHLIGHT_PRIOR), as_shadow)
        cost = so_far + jnp.where(is_usable, jnp.where(is_lit, as_lit, as_other), 0.0)
        return cost, is_usable & ~is_lit & ~outshines

    return jax.lax.scan(add_light, jnp.zeros_like(top), (x, usable, lit, variance, L))


def weights(
    std: Float[Array, "lights *pixels"], reaching: Bool[Array, "lights *pixels"], x: Float[Array, "lights *pixels"]
) -> Float[Array, "lights *pixels"]:
    """One over the variance of noise and model error together, relative to the largest; 0 for lights that don't reach.

    x and std may have any scale.
    """
    variance = std**2 + (MODEL_ERROR * brightest(x, reaching)) ** 2
    return jnp.where(reaching, variance.min(0) / variance, 0.0)


def brightest(x: Float[Array, "lights *pixels"], reaching: Bool[Array, "lights *pixels"]) -> Float[Array, "*pixels"]:
    """The largest intensity among the lights that reach the pixel, at least 0."""
    return jnp.where(reaching, x, 0.0).max(0)


def _spread(lit: Bool[Array, "lights *pixels"], L: LightPlanes) -> Float[Array, "*pixels"]:
    """Determinant of the mean of l l^T over the lit lights: 1/27 at most, 0 for lights in one plane."""
    weight = lit.astype(L.dtype)
    number = jnp.maximum(light_sum(weight), 1.0)
    return normal_equations(weight / number, L).determinant
