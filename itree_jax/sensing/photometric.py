"""Photometric stereo: intensities under three or more lights -> needle map (Ikeuchi 1987, sec. 4.1; Woodham 1980).

A Lambertian pixel of albedo r and normal n shows x_i = I_i / e_i = r n . l_i under light i. Every pixel is solved by
weighted least squares over the lights that reach it; `reaching.py` decides which these are.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from itree_kernels.errors import ItreeError
from jaxtyping import Bool, Float

from itree_jax.kept_functions import kept
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

BLOCK = 4096  # pixels: some sixty arrays of a block fit a megabyte of cache


class Shown(NamedTuple):
    """Images over the strength of their lights, lights first."""

    x: Float[Array, "lights *pixels"]  # r n . l_i on a Lambertian surface that the light reaches
    std: Float[Array, "lights *pixels"]  # of its noise
    saturated: Bool[Array, "lights *pixels"]
    floor: Float[Array, "lights *or_pixels"]  # the darkest that is told from noise
    L: LightPlanes


class Read(NamedTuple):
    """What the lights say about each pixel."""

    albedo: Float[Array, "*pixels"]
    normals: Float[Array, "3 *pixels"]
    interpretable: Bool[Array, "*pixels"]
    albedo_std: Float[Array, "*pixels"]
    normal_std: Float[Array, "*pixels"]
    normal_bias: Float[Array, "*pixels"]
    shadowed: Bool[Array, "lights *pixels"]
    shadow_probability: Float[Array, "lights *pixels"]
    reaching: Bool[Array, "lights *pixels"]


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


@kept("noise")
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
    highlights, and the normal faces the camera. With `albedo_tolerance`, moreover `|albedo / dominant albedo - 1|` must
    be less: the one test that three lights leave, off by default because another material would fail it; `confidence`
    says the same softly.

    `slant_limit` [rad] sets the shadow test (`shadow_ratio`); it does not cut normals beyond it (`regions` does).
    Differentiable with respect to images, light directions and intensities, the choice of lights at each pixel and the
    dominant albedo held fixed; zero where there is no normal. Raises `ItreeError` on shapes that do not fit.
    """
    shown, read = _shown_and_read(images, light_directions, light_intensities, noise, slant_limit)
    dominant = jax.lax.stop_gradient(mode_of_albedo(read.albedo, read.interpretable))
    result = _needles(read, shown.saturated, dominant)
    if albedo_tolerance is None:
        return result
    typical = dominant[..., None, None]
    strict = read.interpretable & (jnp.abs(read.albedo - typical) < jnp.asarray(albedo_tolerance) * typical)
    return result._replace(interpretable=strict, confidence=jnp.where(strict, result.confidence, 0.0))


@kept("noise")
def read_pixels(
    images: Float[Array, "lights height width"],
    light_directions: Float[Array, "lights 3"],
    light_intensities: Float[Array, "lights"],
    noise: Noise,
    slant_limit: float | Float[Array, ""],
) -> tuple[NeedleMap, Float[Array, "height width"]]:
    """`photometric_stereo` of pixels whose dominant albedo others have a part in: the needle map, its confidence left
    open (0), and the albedo's standard deviation.
    """
    shown, read = _shown_and_read(images, light_directions, light_intensities, noise, slant_limit)
    return _needles(read, shown.saturated, jnp.zeros(())), read.albedo_std


@kept("noise")
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
    read = by_blocks(_read_all_lights, shown)
    return _needles(read, shown.saturated, mode_of_albedo(read.albedo, read.interpretable))


def by_blocks(read: Callable[[Shown], Read], shown: Shown) -> Read:
    """`read` on blocks of pixels, one after the other: their arrays stay in the cache, and a pixel's result does not
    depend on how many others there are.
    """
    shape = shown.x.shape[1:]
    pixels = math.prod(shape)
    count = -(-pixels // BLOCK)
    of_pixels = [math.prod(a.shape[a.ndim - len(shape) :]) > 1 for a in shown]  # distant lights are the same for all

    def flat(a: Array) -> Array:
        return a.reshape(*a.shape[: a.ndim - len(shape)], -1)

    def in_blocks(a: Array) -> Array:
        everywhere = jnp.broadcast_to(a, (*a.shape[: a.ndim - len(shape)], *shape))
        whole = jnp.pad(flat(everywhere), [(0, 0)] * (a.ndim - len(shape)) + [(0, count * BLOCK - pixels)], mode="edge")
        return jnp.moveaxis(whole.reshape(*whole.shape[:-1], count, BLOCK), -2, 0)

    def one(block: list[Array]) -> Read:
        parts = iter(block)
        return read(Shown(*(next(parts) if own else flat(a) for a, own in zip(shown, of_pixels, strict=True))))

    found = jax.lax.map(one, [in_blocks(a) for a, own in zip(shown, of_pixels, strict=True) if own])

    def joined(a: Array) -> Array:
        whole = jnp.moveaxis(a, 0, -2)
        return whole.reshape(*whole.shape[:-2], -1)[..., :pixels].reshape(*whole.shape[:-2], *shape)

    return Read(*(joined(a) for a in found))


def _shown_and_read(
    images: Array, light_directions: Array, light_intensities: Array, noise: Noise,
    slant_limit: float | Float[Array, ""],
) -> tuple[Shown, Read]:
    shown = _shown(images, light_directions, light_intensities, noise)
    mean_direction = shown.L.mean(tuple(range(2, shown.L.ndim)))
    mean_direction /= jnp.linalg.norm(mean_direction, axis=-1, keepdims=True)
    ratio = shadow_ratio(mean_direction, jnp.asarray(slant_limit, shown.x.dtype))
    return shown, by_blocks(partial(_read, ratio=ratio), shown)


def _read(shown: Shown, ratio: Float[Array, ""]) -> Read:
    x, std, saturated, floor, L = shown
    reaching, shadow_probability = lights_that_reach(*jax.lax.stop_gradient((x, std, saturated, L, floor, ratio)))
    enough = light_sum(reaching.astype(jnp.int32)) >= LIGHTS_NEEDED
    b, equations, weight = _solve(shown, reaching | ~enough)
    albedo, normals = _split(b, enough)
    shadowed = ~saturated & ~reaching & _is_dark(x, b, albedo, reaching, shown, ratio)
    explained = reaching | saturated | shadowed | _is_highlight(x, b, reaching, L)
    fits = _fits(shown, b, reaching) & jnp.all(explained, axis=0)
    interpretable = enough & fits & (normals[2] < 0.0)
    deviations = _deviations(shown, reaching, enough, (albedo, normals), (equations, weight))
    return Read(albedo, normals, interpretable, *deviations, shadowed, shadow_probability, reaching)


def _read_all_lights(shown: Shown) -> Read:
    ones, all_lights = jnp.ones_like(shown.x), jnp.ones_like(shown.saturated)
    equations = normal_equations(ones, shown.L)
    b = equations.solve(light_sum(shown.x[:, None] * shown.L))
    enough = jnp.ones_like(all_lights[0])
    albedo, normals = _split(b, enough)
    interpretable = (albedo > 0.0) & (normals[2] < 0.0)
    deviations = _deviations(shown, all_lights, enough, (albedo, normals), (equations, ones))
    return Read(albedo, normals, interpretable, *deviations, ~all_lights, jnp.zeros_like(shown.x), all_lights)


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


def _deviations(
    shown: Shown,
    reaching: Bool[Array, "lights *pixels"],
    enough: Bool[Array, "*pixels"],
    split: tuple[Float[Array, "*pixels"], Float[Array, "3 *pixels"]],
    solved: tuple[Symmetric, Float[Array, "lights *pixels"]],
) -> tuple[Float[Array, "*pixels"], Float[Array, "*pixels"], Float[Array, "*pixels"]]:
    """Standard deviation of the albedo, and the angles by which noise and the model's error turn the normal."""
    albedo, normals = split
    equations, weight = solved
    inverse = Symmetric(tuple(jnp.where(enough, entry, 0.0) for entry in equations.inverse.entries))
    shared = jnp.broadcast_to(MODEL_ERROR * brightest(shown.x, reaching), weight.shape)
    (along, across), (_, across_shared) = _stds(inverse, weight, (shown.std, shared), shown.L, normals)
    there = enough & (albedo > 0.0)
    unit = jnp.where(there, albedo, 1.0)
    return along, jnp.where(enough, across / unit, 0.0), jnp.where(enough, across_shared / unit, 0.0)


def _needles(
    read: Read, saturated: Bool[Array, "lights *batch height width"], dominant: Float[Array, "*batch"]
) -> NeedleMap:
    confidence = albedo_confidence(read.albedo, read.albedo_std, dominant)
    of_lights = (jnp.moveaxis(a, 0, -3) for a in (read.shadowed, saturated, read.shadow_probability, read.reaching))
    shadowed, saturated, shadow_probability, reaching = of_lights
    return NeedleMap(
        normals=jnp.moveaxis(read.normals, 0, -1),
        albedo=read.albedo,
        interpretable=read.interpretable,
        shadowed=shadowed,
        saturated=saturated,
        confidence=jnp.where(read.interpretable, confidence, 0.0),
        normal_std=read.normal_std,
        normal_bias=read.normal_bias,
        shadow_probability=shadow_probability,
        reaching=reaching,
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
