"""Classification rules L1-L3: what each compares, and how likely a region is under every attitude group (sec. 2.1.4).

Each rule turns a region's work models into a short vector that no rotation in the image changes. Its distribution under
a group is the set of vectors that noisy draws of the group gave, smoothed by a Gaussian kernel.
"""

from collections.abc import Callable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax.nn import logsumexp
from jaxtyping import Array, Float, Int

from itree_jax.features.region import RegionFeatures

OUTLINE_HARMONICS = 5  # of d(theta): beyond it a window of 48 pixels holds mostly its own raster
BEYOND_KERNELS = -0.5 * 6.0**2
REGIONS_AT_ONCE = 16  # of regions compared with all draws of all groups
LEAST_BANDWIDTH = 0.02  # 2 % of a length, 1 degree: what two exposures of one region differ by at least


@dataclass(frozen=True)
class ClassificationRule:
    """One of L1..L7: a name, the relative cost of measuring it, and the vector it compares."""

    name: str
    title: str
    cost: float  # relative to L1
    quantity_names: tuple[str, ...]
    quantity: Callable[[RegionFeatures], Float[Array, "regions d"]]


def inertia_quantity(features: RegionFeatures) -> Float[Array, "regions 2"]:
    """L1: the principal moments of the original face, as logarithms of lengths."""
    inertia = features.inertia
    moments = jnp.stack([inertia.I_max, inertia.I_min], axis=-1)
    return 0.25 * jnp.log(jnp.maximum(moments, 1.0))


def shape_quantity(features: RegionFeatures) -> Float[Array, "regions d"]:
    """L2: size and harmonics of d(theta). Amplitudes don't know where theta starts, so no rotation changes them."""
    spectrum = jnp.abs(jnp.fft.rfft(features.outline, axis=-1))[..., : OUTLINE_HARMONICS + 1]
    mean = jnp.maximum(spectrum[..., :1], 1e-6)
    return jnp.concatenate([jnp.log(mean), 2.0 * spectrum[..., 1:] / mean], axis=-1)


def egi_quantity(features: RegionFeatures) -> Float[Array, "regions 4"]:
    """L3: spread and mass of the extended Gaussian image, in every frame the same."""
    shortfall = 1.0 - jnp.sum(features.mass_centre**2, axis=-1)
    spread = jnp.sqrt(jnp.maximum(shortfall, 0.0))
    scatter = jnp.sqrt(jnp.maximum(features.normal_scatter, 0.0))
    mass = 0.5 * jnp.log(jnp.maximum(features.area, 1.0))
    return jnp.concatenate([spread[..., None], scatter, mass[..., None]], axis=-1)


CLASSIFICATION_RULES = (
    ClassificationRule("L1", "original face inertia", 1.0, ("log I_max / 4", "log I_min / 4"), inertia_quantity),
    ClassificationRule(
        "L2", "original face shape", 2.0,
        ("log d", *(f"d_{k}" for k in range(1, OUTLINE_HARMONICS + 1))), shape_quantity,
    ),
    ClassificationRule(
        "L3", "extended Gaussian image", 3.0, ("spread", "scatter 1", "scatter 2", "log mass / 2"), egi_quantity
    ),
)
RULE_NAMES = tuple(rule.name for rule in CLASSIFICATION_RULES)


def kernel_bandwidth(samples: Float[np.ndarray, "draws d"], group: Int[np.ndarray, "draws"]) -> Float[np.ndarray, "d"]:
    """Scott's rule on the spread within groups, not under what one more exposure would change."""
    within = np.sqrt(np.mean([samples[group == g].var(axis=0) for g in np.unique(group)], axis=0))
    per_group = len(samples) / len(np.unique(group))
    scott = per_group ** (-1.0 / (samples.shape[1] + 4))
    return np.maximum(scott * within, LEAST_BANDWIDTH).astype(np.float32)


def group_log_likelihood(
    quantity: Float[Array, "regions d"], samples: Float[Array, "groups draws d"], bandwidth: Float[Array, "d"]
) -> Float[Array, "regions groups"]:
    """log p(quantity | group) by kernel density over the group's draws (NaN rows pad groups with fewer draws)."""
    z = (quantity[:, None, None, :] - samples[None]) / bandwidth
    missing = jnp.isnan(samples[..., 0])
    exponent = jnp.where(missing[None], -jnp.inf, -0.5 * jnp.sum(jnp.where(jnp.isnan(z), 0.0, z) ** 2, axis=-1))
    count = jnp.maximum(jnp.sum(~missing, axis=-1), 1)
    # beyond every kernel all groups are equally unlikely: a floor at 6 sigma keeps the logarithm finite
    return jnp.maximum(logsumexp(exponent, axis=-1), BEYOND_KERNELS) - jnp.log(count)


@jax.jit
def quantities(features: RegionFeatures) -> tuple[Float[Array, "regions d"], ...]:
    """What every rule compares, in the order of `CLASSIFICATION_RULES`."""
    return tuple(rule.quantity(features) for rule in CLASSIFICATION_RULES)


@jax.jit
def log_likelihoods(
    measured: tuple[Float[Array, "regions d"], ...],
    samples: tuple[Float[Array, "groups draws d"], ...],
    bandwidth: tuple[Float[Array, "d"], ...],
) -> Float[Array, "rules regions groups"]:
    """`group_log_likelihood` of every rule, a few regions at a time, which bounds its memory."""

    def one(quantity):
        each = zip(quantity, samples, bandwidth, strict=True)
        return jnp.stack([group_log_likelihood(q[None], s, h)[0] for q, s, h in each])

    return jnp.moveaxis(jax.lax.map(one, measured, batch_size=REGIONS_AT_ONCE), 0, 1)
