"""Photometric residuals of recognised parts as functions of their rotation, of the lights and of the albedo.

A Lambertian pixel of part k under light i shows I = a (n . g_i + c b_i) + noise, where a is the albedo, n = R_k n_obj
the normal that the pose gives it, g_i = e_i l_i the light's direction times its intensity, and b_i the light that
reaches it from the other parts, traced for parts of a typical reflectance (what theirs is no image tells, since the
exposure is in a: c is fitted). I is linear in the lights, and in the pose through n alone (delta n = omega x n; that a
curved surface also slides under its pixel is left out, as for needles). So each part and light has a block of eight
unknowns (omega [rad], g, log a, c), and these blocks are all that the joint normal equations need.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from itree_jax.refinement.residuals import tukey
from itree_jax.sensing.needle import Array

OMEGA, LIGHT, ALBEDO, REFLECTED = slice(0, 3), slice(3, 6), 6, 7  # places of the unknowns in a block


class LitPixels(NamedTuple):
    """Pixels at which recognised parts are visible, padded; `used` is False in the padding."""

    intensity: Float[Array, "pixels lights"]  # as stored, 1.0 = full scale
    std: Float[Array, "pixels lights"]  # of the sensor's noise
    used: Bool[Array, "pixels lights"]  # lit by the light, not saturated, far from every edge
    reflected: Float[Array, "pixels lights"]  # b: irradiance by way of the other parts
    normal: Float[Array, "pixels 3"]  # of the part at its pose, camera frame
    part: Int[Array, "pixels"]
    patch: Int[Array, "pixels"]  # consecutive numbers of patches: of a face, what faces one way


class ModelErrors(NamedTuple):
    """How far a Lambertian surface under distant lights is believed; all relative to albedo times intensity."""

    pixel: Float[Array, ""]  # standard deviation at one pixel, beside the sensor's noise
    patch_bias: Float[Array, ""]  # shared by a patch under one light: reflected light, reflectance
    gate: Float[Array, ""]  # beyond it (or four times the noise) the model does not hold at a pixel


class LightEquations(NamedTuple):
    """Sums over the pixels of each part under each light: w d d^T, w d r, Tukey's loss, and how many were looked at."""

    hessian: Float[Array, "parts lights 8 8"]
    gradient: Float[Array, "parts lights 8"]
    loss: Float[Array, "parts lights"]  # of the residual over its gate: 0 none .. 1 beyond the gate
    count: Float[Array, "parts lights"]
    patch_weight: Float[Array, "patches lights"]  # pixels that fit
    patch_residual: Float[Array, "patches lights"]  # their mean residual, relative to albedo times intensity


def predicted_intensity(
    normal: Float[Array, "*pixels 3"], reflected: Float[Array, "*pixels lights"], lights: Float[Array, "lights 3"],
    albedo: Float[Array, "*pixels"], share: float | Float[Array, ""],
) -> Float[Array, "*pixels lights"]:
    """a (n . g + c b) of every pixel under every light; `share` is c."""
    return albedo[..., None] * (normal @ lights.T + share * reflected)


def light_jacobian(
    normal: Float[Array, "*pixels 3"], reflected: Float[Array, "*pixels lights"], lights: Float[Array, "lights 3"],
    albedo: Float[Array, "*pixels"], share: float | Float[Array, ""],
) -> Float[Array, "*pixels lights 8"]:
    """Derivatives of `predicted_intensity` with respect to (omega, g, log albedo, c)."""
    turned = jnp.cross(normal[..., None, :], lights)
    along = jnp.broadcast_to(normal[..., None, :], turned.shape)
    arriving = normal @ lights.T + share * reflected
    columns = jnp.concatenate([turned, along, arriving[..., None], reflected[..., None]], axis=-1)
    return albedo[..., None, None] * columns


@partial(jax.jit, static_argnames=("parts", "patches"))
def light_equations(
    pixels: LitPixels,
    lights: Float[Array, "lights 3"],
    albedo: Float[Array, "parts"],
    share: Float[Array, ""],
    errors: ModelErrors,
    parts: int,
    patches: int,
) -> LightEquations:
    """The blocks of all parts and lights. `parts` and `patches` are upper bounds of the numbers in `pixels`.

    Weights are Tukey's biweight over the variance, with the bias that a patch's pixels share: N pixels of one patch are
    worth no more than 1 / patch_bias^2.
    """
    a = albedo[pixels.part]
    residual = pixels.intensity - predicted_intensity(pixels.normal, pixels.reflected, lights, a, share)
    full = a[:, None] * jnp.linalg.norm(lights, axis=-1)
    gate = jnp.hypot(4.0 * pixels.std, errors.gate * full)
    squared = jnp.square(residual / gate)
    robust = jnp.where(pixels.used, tukey(squared), 0.0)
    of_patch = partial(jax.ops.segment_sum, segment_ids=pixels.patch, num_segments=patches)
    patch_weight = of_patch(robust)
    shared = patch_weight[pixels.patch] * errors.patch_bias**2
    variance = jnp.square(pixels.std) + jnp.square(full) * (errors.pixel**2 + shared)
    weight = robust / variance
    d = light_jacobian(pixels.normal, pixels.reflected, lights, a, share)
    weighted = d * weight[..., None]
    # Tukey's loss, 1 - (1 - s)^3 up to the gate
    loss = jnp.where(pixels.used, 1.0 - jnp.power(jnp.clip(1.0 - squared, 0.0, 1.0), 3), 0.0)

    def of_part(values: Array) -> Array:
        return jax.ops.segment_sum(values, pixels.part, num_segments=parts)

    return LightEquations(
        of_part(weighted[..., :, None] * d[..., None, :]),
        of_part(weighted * residual[..., None]),
        of_part(loss),
        of_part(pixels.used.astype(loss.dtype)),
        patch_weight,
        of_patch(robust * residual / full) / jnp.maximum(patch_weight, 1e-6),
    )
