"""The albedo of the parts, and how far a pixel's is from it.

Three lights fit any three intensities, so a wrong light shows only in the albedo: where a shadow is taken for light, or
a neighbour's reflection for the lamp, the least-squares albedo leaves that of the material.
"""

import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from itree_jax.batches import power_of_two_above
from itree_jax.kept_functions import kept
from itree_jax.sensing.needle import Array, NeedleMap
from itree_jax.sensing.pixel_row import as_row

# Interreflection adds to a lit pixel about 5 % of its albedo (in bins rendered with two bounces, 15 % of the pixels are
# off by more than 3 %, and they carry most of the error of the normals).
INTERREFLECTION = 0.05
LEAST_ALBEDO, MOST_ALBEDO = 0.005, 5.0  # darker is noise, brighter is a mirror: the ends of the histogram
BIN = 0.02  # of log albedo: finer than interreflection, wide enough for a thousand pixels to fill
SMOOTHING_BINS = 2.0
STEADY_COLUMNS = 256  # few enough that their sum is not shared between threads


def dominant_albedo(needle: NeedleMap) -> Float[Array, "*batch"]:
    """The albedo that the parts share: the mode of log albedo over interpretable pixels, each weighted by albedo^2.

    The weight is there because a bin is often much darker than what lies in it, and larger. 0 where no pixel is
    interpretable.
    """
    albedo, interpretable = needle.albedo, needle.interpretable
    if isinstance(albedo, np.ndarray) and isinstance(interpretable, np.ndarray):
        return dominant_of_maps(albedo, interpretable)
    return mode_of_albedo(albedo, interpretable)


def dominant_of_maps(
    albedo: Float[np.ndarray, "*batch height width"], interpretable: Bool[np.ndarray, "*batch height width"]
) -> Float[Array, "*batch"]:
    """The same of NumPy arrays; for images of all sizes few are compiled."""
    pixels = power_of_two_above(albedo.shape[-2] * albedo.shape[-1])
    return mode_of_albedo(as_row(albedo, pixels), as_row(interpretable, pixels))


@kept()
def mode_of_albedo(
    albedo: Float[Array, "*batch height width"], interpretable: Bool[Array, "*batch height width"]
) -> Float[Array, "*batch"]:
    """`dominant_albedo` of the two arrays that it depends on."""
    batch, pixels = albedo.shape[:-2], albedo.shape[-2] * albedo.shape[-1]
    modes = jax.vmap(_mode)(albedo.reshape(-1, pixels), interpretable.reshape(-1, pixels))
    return modes.reshape(batch)


@kept()
def confidence_of_pixels(
    albedo: Float[Array, "height width"],
    albedo_std: Float[Array, "height width"],
    interpretable: Bool[Array, "height width"],
    dominant: Float[Array, ""],
) -> Float[Array, "height width"]:
    """`NeedleMap.confidence`."""
    return jnp.where(interpretable, albedo_confidence(albedo, albedo_std, dominant), 0.0)


def albedo_confidence(
    albedo: Float[Array, "*batch height width"],
    albedo_std: Float[Array, "*batch height width"],
    dominant: Float[Array, "*batch"],
) -> Float[Array, "*batch height width"]:
    """exp(-d^2 / 2), d = (albedo / dominant - 1) over its tolerance: noise and `INTERREFLECTION` together."""
    typical = jnp.where(dominant > 0.0, dominant, 1.0)[..., None, None]
    deviation = (albedo / typical - 1.0) ** 2 / ((albedo_std / typical) ** 2 + INTERREFLECTION**2)
    return jnp.where(dominant[..., None, None] > 0.0, jnp.exp(-0.5 * deviation), 0.0)


def _mode(albedo: Float[Array, "pixels"], interpretable: Bool[Array, "pixels"]) -> Float[Array, ""]:
    bins = round(math.log(MOST_ALBEDO / LEAST_ALBEDO) / BIN)
    inside = interpretable & (albedo > LEAST_ALBEDO) & (albedo < MOST_ALBEDO)
    position = jnp.log(jnp.where(inside, albedo, 1.0) / LEAST_ALBEDO) / BIN
    weight = jnp.where(inside, albedo**2, 0.0)
    histogram = jnp.zeros(bins, albedo.dtype).at[position.astype(int)].add(weight)
    offsets = jnp.arange(-6, 7)
    kernel = jnp.exp(-0.5 * (offsets / SMOOTHING_BINS) ** 2).astype(albedo.dtype)
    peak = jnp.argmax(jnp.convolve(histogram, kernel, mode="same"))
    near = weight * (jnp.abs(position - peak - 0.5) <= SMOOTHING_BINS)
    total = _steady_sum(near)
    return jnp.where(total > 0.0, _steady_sum(near * albedo) / jnp.where(total > 0.0, total, 1.0), 0.0)


def _steady_sum(values: Float[Array, "pixels"]) -> Float[Array, ""]:
    """The sum in one order, whatever the number of threads: a last bit here would reach every pose."""
    columns = jnp.pad(values, (0, -len(values) % STEADY_COLUMNS)).reshape(-1, STEADY_COLUMNS)
    total, _ = jax.lax.scan(lambda sums, row: (sums + row, None), jnp.zeros(STEADY_COLUMNS, values.dtype), columns)
    return total.sum()
