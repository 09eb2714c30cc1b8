"""Photometric stereo: intensities under three or more lights -> needle map (Ikeuchi 1987, sec. 4.1; Woodham 1980).

A Lambertian pixel of albedo r and normal n shows x_i = I_i / e_i = r n . l_i under light i. Every pixel is solved by
weighted least squares over the lights that reach it; `reaching.py` decides which these are.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from itree_kernels.errors import ItreeError
from jaxtyping import Bool, Float

from itree_jax.sensing.albedo import albedo_confidence, mode_of_albedo
from itree_jax.sensing.least_squares import LightPlanes, Symmetric, light_sum, normal_equations, predicted
from itree_jax.sensing.near_lights import lights_of
from itree_jax.sensing.needle import Array, NeedleMap
from itree_jax.sensing.noise_model import intensity_std, saturation_level
from itree_jax.sensing.reaching import (
    DEFAULT_SLANT_LIMIT,
    LIGHTS_NEEDED,
    MODEL_ERROR,
    MOST_FILL,
    NOISE_SIGMAS,
    brightest,
    lights_that_reach,
    shadow_ratio,
    weights,
)
from itree_jax.sensor import Noise, Sensor


class Shown(NamedTuple):
    """Images over the strength of their lights, lights first."""

    x: Float[Array, "lights *pixels"]  # r n . l_i on a Lambertian surface that the light reaches
    std: Float[Array, "lights *pixels"]  # of its noise
    saturated: Bool[Array, "lights *pixels"]
    floor: Float[Array, "lights *or_pixels"]  # the darkest that is told from noise
    L: LightPlanes


def needle_map(
    images: Float[Array, "*batch lights height width"],
    sensor: Sensor,
    depth: Float[Array, "height width"] | None = None,
    albedo_tolerance: float | None = None,
) -> NeedleMap:
    """`photometric_stereo` with the lights, the noise and the slant limit of a sensor.

    Of near lights, directions and intensities are those at the surface that `depth` [mm] tells (0: unknown), or at the
    working distance.
    """
    lights = lights_of(sensor, depth)
    return photometric_stereo(images, *lights, sensor.noise, sensor.slant_limit, albedo_tolerance)


@partial(jax.jit, static_argnames=("noise",))
def photometric_stereo(
    images: Float[Array, "*batch lights height width"],
    light_directions: Float[Array, "*pixels_or_none lights 3"],
    light_intensities: Float[Array, "*pixels_or_none lights"],
    noise: Noise,
    slant_limit: float | Float[Array, ""] = DEFAULT_SLANT_LIMIT,
    albedo_tolerance: float | Float[Array, ""] | None = None,
) -> NeedleMap:
    """The needle map of images (linear, 1.0 = full scale) under n >= 3 lights. Jitted; any leading batch.

    Distant lights have directions [lights, 3] and intensities [lights]; near ones [height, width, lights, 3] and
    [height, width, lights], another at each pixel (`near_lights`).

    A pixel is interpretable when three or more lights reach it unsaturated, they fit (each residual within 4 sigma of
    noise and model error; three lights always fit), the others are dark or brilliant enough to be shadows or
    highlights, and the normal faces the camera. With `albedo_tolerance`, moreover |albedo / dominant albedo - 1| must
    be less: the one test that three lights leave, off by default because another material would fail it; `confidence`
    says the same softly.

    `slant_limit` [rad] sets the shadow test (`shadow_ratio`); it does not cut normals beyond it (`regions` does).
    Differentiable with respect to images, light directions and intensities, the choice of lights at each pixel and the
    dominant albedo held fixed; zero where there is no normal. Raises `ItreeError` on shapes that do not fit.
    """
    shown = _shown(images, light_directions, light_intensities, noise)
    x, std, saturated, floor, L = shown
    mean_direction = L.mean(tuple(range(2, L.ndim)))
    mean_direction /= jnp.linalg.norm(mean_direction, axis=-1, keepdims=True)
    ratio = shadow_ratio(mean_direction, jnp.asarray(slant_limit, x.dtype))
    reaching, shadow_probability = lights_that_reach(*jax.lax.stop_gradient((x, std, saturated, L, floor, ratio)))
    enough = light_sum(reaching.astype(jnp.int32)) >= LIGHTS_NEEDED

    used = reaching | ~enough
    b, equations, weight = _solve(shown, used)
    albedo, normals = _split(b, enough)
    shadowed = ~saturated & ~reaching & _is_dark(x, b, albedo, reaching, shown, ratio)
    explained = reaching | saturated | shadowed | _is_highlight(x, b, reaching, L)
    fits = _fits(shown, b, reaching) & jnp.all(explained, axis=0)
    interpretable = enough & fits & (normals[2] < 0.0)
    dominant = jax.lax.stop_gradient(mode_of_albedo(albedo, interpretable))
    result = _needles(shown, reaching, enough, interpretable, (albedo, normals), (equations, weight), dominant)
    if albedo_tolerance is not None:
        typical = dominant[..., None, None]
        strict = interpretable & (jnp.abs(albedo - typical) < jnp.asarray(albedo_tolerance, x.dtype) * typical)
        result = result._replace(interpretable=strict, confidence=jnp.where(strict, result.confidence, 0.0))
    return result._replace(
        shadowed=jnp.moveaxis(shadowed, 0, -3), shadow_probability=jnp.moveaxis(shadow_probability, 0, -3)
    )


@partial(jax.jit, static_argnames=("noise",))
def least_squares(
    images: Float[Array, "*batch lights height width"],
    light_directions: Float[Array, "*pixels_or_none lights 3"],
    light_intensities: Float[Array, "*pixels_or_none lights"],
    noise: Noise,
) -> NeedleMap:
    """The needle map when every light is taken to reach every pixel: what shadows and highlights do to it shows.

    Interpretable is every pixel whose normal faces the camera. See `photometric_stereo` for the arguments.
    """
    shown = _shown(images, light_directions, light_intensities, noise)
    all_lights = jnp.ones_like(shown.saturated)
    ones = jnp.ones_like(shown.x)
    equations = normal_equations(ones, shown.L)
    b = equations.solve(light_sum(shown.x[:, None] * shown.L))
    enough = jnp.ones_like(all_lights[0])
    albedo, normals = _split(b, enough)
    interpretable = (albedo > 0.0) & (normals[2] < 0.0)
    dominant = mode_of_albedo(albedo, interpretable)
    return _needles(shown, all_lights, enough, interpretable, (albedo, normals), (equations, ones), dominant)


def _shown(images: Array, light_directions: Array, light_intensities: Array, noise: Noise) -> Shown:
    images = jnp.asarray(images)
    _check_shapes(images, light_directions, light_intensities)
    dtype, batch = images.dtype, images.ndim - 3
    L, e = jnp.asarray(light_directions, dtype), jnp.asarray(light_intensities, dtype)
    stored = jnp.moveaxis(images, -3, 0)
    L, e = jnp.moveaxis(L, (-2, -1), (0, 1)), jnp.moveaxis(e, -1, 0)
    spread = (1,) * batch + (L.shape[2:] or (1, 1))
    L, e = L.reshape(*L.shape[:2], *spread), e.reshape(len(e), *spread)
    floor = NOISE_SIGMAS * intensity_std(jnp.zeros((), dtype), noise) / e
    return Shown(stored / e, intensity_std(stored, noise) / e, stored >= saturation_level(noise), floor, L)


def _check_shapes(images: Array, light_directions: Array, light_intensities: Array) -> None:
    if images.ndim < 3 or not jnp.issubdtype(images.dtype, jnp.floating):
        raise ItreeError(f"images must be floats [..., lights, height, width], they are {images.dtype} {images.shape}")
    n, of_pixels = images.shape[-3], images.shape[-2:]
    allowed = [((n, 3), (n,)), ((*of_pixels, n, 3), (*of_pixels, n))]
    if n < LIGHTS_NEEDED or (light_directions.shape, light_intensities.shape) not in allowed:
        raise ItreeError(
            f"photometric stereo needs three or more lights, as many as images: there are {n} images, directions "
            f"of shape {light_directions.shape}, intensities of shape {light_intensities.shape}"
        )


def _solve(
    shown: Shown, used: Bool[Array, "lights *pixels"]
) -> tuple[Float[Array, "3 *pixels"], Symmetric, Float[Array, "lights *pixels"]]:
    """b = albedo * normal over the lights that are used, which must span space; the equations and their weights."""
    weight = weights(shown.std, used, shown.x)
    equations = normal_equations(weight, shown.L)
    b = equations.solve(light_sum(weight[:, None] * shown.x[:, None] * shown.L))
    return b, equations, weight


def _needles(
    shown: Shown,
    reaching: Bool[Array, "lights *pixels"],
    enough: Bool[Array, "*pixels"],
    interpretable: Bool[Array, "*pixels"],
    split: tuple[Float[Array, "*pixels"], Float[Array, "3 *pixels"]],
    solved: tuple[Symmetric, Float[Array, "lights *pixels"]],
    dominant: Float[Array, "*batch"],
) -> NeedleMap:
    albedo, normals = split
    equations, weight = solved
    inverse = Symmetric(tuple(jnp.where(enough, entry, 0.0) for entry in equations.inverse.entries))
    shared = jnp.broadcast_to(MODEL_ERROR * brightest(shown.x, reaching), weight.shape)
    (along, across), (_, across_shared) = _stds(inverse, weight, (shown.std, shared), shown.L, normals)
    confidence = albedo_confidence(albedo, along, dominant)
    unit = jnp.where(enough, albedo, 1.0)
    unit = jnp.where(unit > 0.0, unit, 1.0)
    return NeedleMap(
        normals=jnp.moveaxis(normals, 0, -1),
        albedo=albedo,
        interpretable=interpretable,
        shadowed=jnp.moveaxis(jnp.zeros_like(shown.saturated), 0, -3),
        saturated=jnp.moveaxis(shown.saturated, 0, -3),
        confidence=jnp.where(interpretable, confidence, 0.0),
        normal_std=jnp.where(enough, across / unit, 0.0),
        normal_bias=jnp.where(enough, across_shared / unit, 0.0),
        shadow_probability=jnp.moveaxis(jnp.zeros_like(shown.x), 0, -3),
        reaching=jnp.moveaxis(reaching, 0, -3),
    )


def _split(
    b: Float[Array, "3 *pixels"], enough: Bool[Array, "*pixels"]
) -> tuple[Float[Array, "*pixels"], Float[Array, "3 *pixels"]]:
    """Albedo and unit normal of b = albedo * normal; 0 (with zero gradients) where there are not enough lights."""
    square = light_sum(b * b)
    there = enough & (square > 0.0)
    albedo = jnp.sqrt(jnp.where(there, square, 1.0))
    normals = jnp.where(there, b / albedo, 0.0)
    return jnp.where(there, albedo, 0.0), normals


def _fits(
    shown: Shown, b: Float[Array, "3 *pixels"], reaching: Bool[Array, "lights *pixels"]
) -> Bool[Array, "*pixels"]:
    allowed = NOISE_SIGMAS * jnp.hypot(shown.std, MODEL_ERROR * brightest(shown.x, reaching))
    return jnp.all(~reaching | (jnp.abs(shown.x - predicted(b, shown.L)) < allowed), axis=0)


def _stds(
    inverse: Symmetric, weight: Float[Array, "lights *pixels"], stds: tuple[Float[Array, "lights *pixels"], ...],
    L: LightPlanes, normals: Float[Array, "3 *pixels"],
) -> list[tuple[Float[Array, "*pixels"], Float[Array, "*pixels"]]]:
    """Standard deviation of b along the normal, and the root of its summed variances across the normal, when the
    intensities have independent deviations (one pair for each of `stds`). b is G x with g_i = w_i A^-1 l_i.
    """
    nothing = jnp.zeros_like(weight[0])

    def add_light(sums: tuple, light: tuple) -> tuple[tuple, None]:
        w, direction, deviations = light
        g = w * inverse.times(direction)
        along, total = light_sum(normals * g) ** 2, light_sum(g * g)
        added = [(a + along * d**2, t + total * d**2) for (a, t), d in zip(sums, deviations, strict=True)]
        return tuple(added), None

    start = tuple((nothing, nothing) for _ in stds)
    sums, _ = jax.lax.scan(add_light, start, (weight, L, stds))
    return [(_safe_sqrt(along), _safe_sqrt(total - along)) for along, total in sums]


def _safe_sqrt(square: Float[Array, "*pixels"]) -> Float[Array, "*pixels"]:
    positive = square > 0.0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1.0)), 0.0)


def _is_dark(
    x: Float[Array, "lights *pixels"],
    b: Float[Array, "3 *pixels"],
    albedo: Float[Array, "*pixels"],
    reaching: Bool[Array, "lights *pixels"],
    shown: Shown,
    ratio: Float[Array, ""],
) -> Bool[Array, "lights *pixels"]:
    """Darker than the normal predicts by more than interreflection fills, or too dark beside the brightest light."""
    most = jnp.minimum(predicted(b, shown.L), MOST_FILL * albedo)  # no more than 0 without a normal
    return x <= jnp.maximum(most, jnp.maximum(shown.floor, ratio * brightest(x, reaching)))


def _is_highlight(
    x: Float[Array, "lights *pixels"],
    b: Float[Array, "3 *pixels"],
    reaching: Bool[Array, "lights *pixels"],
    L: LightPlanes,
) -> Bool[Array, "lights *pixels"]:
    return x > jnp.maximum(predicted(b, L), brightest(x, reaching))
