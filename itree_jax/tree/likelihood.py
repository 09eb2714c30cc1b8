"""How likely a rule's quantity is under each attitude group: kernel densities over what noisy draws of the group gave."""

import jax.numpy as jnp
import numpy as np
from jax.nn import logsumexp
from jaxtyping import Array, Float, Int

BEYOND_KERNELS = -0.5 * 6.0**2
LEAST_BANDWIDTH = 0.02  # 2 % of a length, 1 degree: what two exposures of one region differ by at least


def kernel_bandwidth(samples: Float[np.ndarray, "draws d"], group: Int[np.ndarray, "draws"]) -> Float[np.ndarray, "d"]:
    """Scott's rule on the spread within groups, not under what one more exposure would change."""
    within = np.sqrt(np.mean([samples[group == g].var(axis=0) for g in np.unique(group)], axis=0))
    return scott(within, len(samples) / len(np.unique(group)), samples.shape[1])


def relational_bandwidth(
    samples: Float[np.ndarray, "draws groups"], group: Int[np.ndarray, "draws"]
) -> Float[np.ndarray, "groups"]:
    """The same for agreements, each a density in one dimension."""
    within = np.sqrt(np.mean([samples[group == g].var(axis=0) for g in np.unique(group)], axis=0))
    return scott(within, len(samples) / len(np.unique(group)), 1)


def scott(spread: Float[np.ndarray, "d"], count: float, dimensions: int) -> Float[np.ndarray, "d"]:
    """Scott's bandwidth of each dimension, at least `LEAST_BANDWIDTH`."""
    return np.maximum(count ** (-1.0 / (dimensions + 4)) * spread, LEAST_BANDWIDTH).astype(np.float32)


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


def relational_log_likelihood(
    agreement: Float[Array, "groups"], samples: Float[Array, "groups draws groups"], bandwidth: Float[Array, "groups"],
    prior: Float[Array, "groups"],
) -> Float[Array, "groups"]:
    """log p(agreement with group k | group k) - log p(agreement with group k | any other group), for every k.

    All regions are measured against all groups, so that the ratio to the background is what agreements of different
    groups can be compared by (a likelihood up to a factor that all groups share).
    """
    z = (agreement - samples) / bandwidth  # [true group, draw, compared with]
    missing = jnp.isnan(samples)
    exponent = jnp.where(missing, -jnp.inf, -0.5 * jnp.where(missing, 0.0, z) ** 2)
    count = jnp.maximum(jnp.sum(~missing, axis=1), 1)
    density = jnp.maximum(logsumexp(exponent, axis=1), BEYOND_KERNELS) - jnp.log(count)
    groups = samples.shape[0]
    own = jnp.eye(groups, dtype=bool)
    weight = jnp.log(jnp.maximum(prior, 1e-12))[:, None]
    background = logsumexp(jnp.where(own, -jnp.inf, density + weight), axis=0) - logsumexp(
        jnp.where(own, -jnp.inf, weight), axis=0
    )
    ratio = jnp.diagonal(density) - background
    return jnp.where((groups > 1) & jnp.isfinite(ratio), ratio, 0.0)
