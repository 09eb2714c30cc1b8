"""What sensor noise does to an intensity: shot noise, read noise, quantisation."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from itree_jax.sensing.needle import Array
from itree_jax.sensor import Noise


def intensity_std(images: Float[Array, "*pixels"], noise: Noise) -> Float[Array, "*pixels"]:
    """Standard deviation of a stored intensity, 1.0 = full scale, from its (noisy) value.

    Shot noise is the root of the electrons, quantisation an even distribution over one step.
    """
    of = jnp if isinstance(images, jax.Array) else np  # host arrays stay there: JAX would compile each step
    dark = (noise.read_noise_e / noise.full_well_e) ** 2 + 4.0**-noise.bits / 12.0
    return of.sqrt(of.maximum(images, 0.0) / noise.full_well_e + dark)


def saturation_level(noise: Noise) -> float:
    """The least intensity that counts as saturated: the converter's last step."""
    return 1.0 - 2.0**-noise.bits
