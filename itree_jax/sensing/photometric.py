"""Photometric stereo: intensities under three or more lights -> needle map (Ikeuchi 1987, sec. 4.1; Woodham 1980).

A Lambertian pixel of albedo r and normal n shows x_i = I_i / e_i = r n . l_i under light i. Every pixel is solved by
weighted least squares over the lights that reach it; `reaching.py` decides which these are.
"""

from functools import partial

import jax
import jax.numpy as jnp
from itree_kernels.errors import ItreeError
from jaxtyping import Bool, Float

from itree_jax.sensing.albedo import albedo_confidence, mode_of_albedo
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
    predicted,
    shadow_ratio,
    solve,
)
from itree_jax.sensor import Noise, Sensor


def needle_map(images: Float[Array, "*batch lights height width"], sensor: Sensor) -> NeedleMap:
    """`photometric_stereo` with the lights, the noise and the slant limit of a sensor."""
    return photometric_stereo(
        images, sensor.light_directions, sensor.light_intensities, sensor.noise, sensor.slant_limit
    )


@partial(jax.jit, static_argnames=("noise",))
def photometric_stereo(
    images: Float[Array, "*batch lights height width"],
    light_directions: Float[Array, "lights 3"],
    light_intensities: Float[Array, "lights"],
    noise: Noise,
    slant_limit: float | Float[Array, ""] = DEFAULT_SLANT_LIMIT,
    albedo_tolerance: float | Float[Array, ""] | None = None,
) -> NeedleMap:
    """The needle map of images (linear, 1.0 = full scale) under n >= 3 distant lights. Jitted; any leading batch.

    A pixel is interpretable when three or more lights reach it unsaturated, they fit (each residual within 4 sigma of
    noise and model error; three lights always fit), the others are dark or brilliant enough to be shadows or
    highlights, and the normal faces the camera. With `albedo_tolerance`, moreover |albedo / dominant albedo - 1| must
    be less: the one test that three lights leave, off by default because another material would fail it; `confidence`
    says the same softly.

    `slant_limit` [rad] sets the shadow test (`shadow_ratio`); it does not cut normals beyond it (`regions` does).
    Differentiable with respect to images, light directions and intensities, the choice of lights at each pixel and the
    dominant albedo held fixed; zero where there is no normal. Raises `ItreeError` on shapes that do not fit.
    """
    images = jnp.asarray(images)
    _check_shapes(images, light_directions, light_intensities)
    dtype = images.dtype
    L, e = jnp.asarray(light_directions, dtype), jnp.asarray(light_intensities, dtype)
    stored = jnp.moveaxis(images, -3, -1)
    x, std = stored / e, intensity_std(stored, noise) / e
    saturated = stored >= saturation_level(noise)
    floor = NOISE_SIGMAS * intensity_std(jnp.zeros((), dtype), noise) / e
    ratio = shadow_ratio(L, jnp.asarray(slant_limit, dtype))
    reaching = lights_that_reach(*jax.lax.stop_gradient((x, std, saturated, L, floor, ratio)))
    enough = reaching.sum(-1) >= LIGHTS_NEEDED

    b, G = solve(x, std, reaching | ~enough[..., None], L)
    albedo, normals = _split(b, enough)
    shadowed = ~saturated & ~reaching & _is_dark(x, b, albedo, reaching, L, floor, ratio)
    explained = reaching | saturated | shadowed | _is_highlight(x, b, reaching, L)
    fits = _fits(x, b, std, reaching, L) & jnp.all(explained, axis=-1)
    interpretable = enough & fits & (normals[..., 2] < 0.0)
    std_along, std_across = _stds(G, std, normals)
    dominant = jax.lax.stop_gradient(mode_of_albedo(albedo, interpretable))
    confidence = albedo_confidence(albedo, std_along, dominant)
    if albedo_tolerance is not None:
        typical = dominant[..., None, None]
        interpretable &= jnp.abs(albedo - typical) < jnp.asarray(albedo_tolerance, dtype) * typical
    return NeedleMap(
        normals=normals,
        albedo=albedo,
        interpretable=interpretable,
        shadowed=jnp.moveaxis(shadowed, -1, -3),
        saturated=jnp.moveaxis(saturated, -1, -3),
        confidence=jnp.where(interpretable, confidence, 0.0),
        normal_std=jnp.where(enough, std_across / jnp.where(enough, albedo, 1.0), 0.0),
    )


def _check_shapes(images: Array, light_directions: Array, light_intensities: Array) -> None:
    if images.ndim < 3 or not jnp.issubdtype(images.dtype, jnp.floating):
        raise ItreeError(f"images must be floats [..., lights, height, width], they are {images.dtype} {images.shape}")
    n = images.shape[-3]
    if n < LIGHTS_NEEDED or light_directions.shape != (n, 3) or light_intensities.shape != (n,):
        raise ItreeError(
            f"photometric stereo needs three or more lights, as many as images: there are {n} images, directions "
            f"of shape {light_directions.shape}, intensities of shape {light_intensities.shape}"
        )


def _split(
    b: Float[Array, "*pixels 3"], enough: Bool[Array, "*pixels"]
) -> tuple[Float[Array, "*pixels"], Float[Array, "*pixels 3"]]:
    """Albedo and unit normal of b = albedo * normal; 0 (with zero gradients) where there are not enough lights."""
    square = (b * b).sum(-1)
    there = enough & (square > 0.0)
    albedo = jnp.sqrt(jnp.where(there, square, 1.0))
    normals = jnp.where(there[..., None], b / albedo[..., None], 0.0)
    return jnp.where(there, albedo, 0.0), normals


def _fits(
    x: Float[Array, "*pixels lights"],
    b: Float[Array, "*pixels 3"],
    std: Float[Array, "*pixels lights"],
    reaching: Bool[Array, "*pixels lights"],
    L: Float[Array, "lights 3"],
) -> Bool[Array, "*pixels"]:
    allowed = NOISE_SIGMAS * jnp.hypot(std, MODEL_ERROR * brightest(x, reaching)[..., None])
    return jnp.all(~reaching | (jnp.abs(x - predicted(b, L)) < allowed), axis=-1)


def _stds(
    G: Float[Array, "*pixels 3 lights"], std: Float[Array, "*pixels lights"], normals: Float[Array, "*pixels 3"]
) -> tuple[Float[Array, "*pixels"], Float[Array, "*pixels"]]:
    """Standard deviation of b = G x along the normal, and the root of its summed variances across the normal."""
    variance = std**2
    along = ((normals[..., None] * G).sum(-2) ** 2 * variance).sum(-1)
    total = ((G**2).sum(-2) * variance).sum(-1)
    return _safe_sqrt(along), _safe_sqrt(total - along)


def _safe_sqrt(square: Float[Array, "*pixels"]) -> Float[Array, "*pixels"]:
    positive = square > 0.0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1.0)), 0.0)


def _is_dark(
    x: Float[Array, "*pixels lights"],
    b: Float[Array, "*pixels 3"],
    albedo: Float[Array, "*pixels"],
    reaching: Bool[Array, "*pixels lights"],
    L: Float[Array, "lights 3"],
    floor: Float[Array, "lights"],
    ratio: Float[Array, ""],
) -> Bool[Array, "*pixels lights"]:
    """Darker than the normal predicts by more than interreflection fills, or too dark beside the brightest light."""
    most = jnp.minimum(predicted(b, L), MOST_FILL * albedo[..., None])  # no more than 0 without a normal
    top = brightest(x, reaching)[..., None]
    return x <= jnp.maximum(most, jnp.maximum(floor, ratio * top))


def _is_highlight(
    x: Float[Array, "*pixels lights"],
    b: Float[Array, "*pixels 3"],
    reaching: Bool[Array, "*pixels lights"],
    L: Float[Array, "lights 3"],
) -> Bool[Array, "*pixels lights"]:
    return x > jnp.maximum(predicted(b, L), brightest(x, reaching)[..., None])
