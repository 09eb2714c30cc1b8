"""How likely a rule's quantity is under each attitude group: kernel densities over what its noisy draws gave."""

import jax.numpy as jnp
import numpy as np
from jax.nn import logsumexp
from jaxtyping import Array, Float, Int

BEYOND_KERNELS = -0.5 * 6.0**2
SHARES = (1.0, 0.7, 0.5, 0.35, 0.25, 0.18)  # of Scott's bandwidth that are tried
LEAST_BANDWIDTH = 0.02  # 2 % of a length, 1 degree: what two exposures of one region differ by at least


def kernel_bandwidth(samples: Float[np.ndarray, "draws d"], group: Int[np.ndarray, "draws"]) -> Float[np.ndarray, "d"]:
    """Bandwidths of a vector's kernel: Scott's rule on the spread within groups, narrowed as the draws themselves ask.

    A group may be seen in two shapes (its shadow joins two faces or parts them); its spread then says nothing about how
    wide a kernel should be. So the share of Scott's bandwidth is the one under which every draw is likeliest by the
    other draws of its group (leave-one-out cross-validation, e.g. Silverman 1986, sec. 3.4.4).
    """
    groups = [samples[group == g] for g in np.unique(group)]
    within = np.sqrt(np.mean([own.var(axis=0) for own in groups], axis=0))
    scott = max(len(samples) / len(groups), 2.0) ** (-1.0 / (samples.shape[1] + 4)) * within
    widths = [np.maximum(share * scott, LEAST_BANDWIDTH) for share in SHARES]
    return max(widths, key=lambda width: left_out_likelihood(groups, width)).astype(np.float32)


def relational_bandwidth(
    samples: Float[np.ndarray, "draws groups"], group: Int[np.ndarray, "draws"]
) -> Float[np.ndarray, "groups"]:
    """The same for agreements, each a density in one dimension."""
    return np.array([kernel_bandwidth(column[:, None], group)[0] for column in samples.T], np.float32)


def left_out_likelihood(groups: list[Float[np.ndarray, "n d"]], bandwidth: Float[np.ndarray, "d"]) -> float:
    """Sum over draws of log p(draw | other draws of its group)."""
    total = 0.0
    for own in groups:
        if len(own) < 2:
            continue
        z = own / bandwidth
        squared = ((z[:, None] - z[None]) ** 2).sum(axis=-1)
        np.fill_diagonal(squared, np.inf)
        density = np.maximum(np.logaddexp.reduce(-0.5 * squared, axis=1), BEYOND_KERNELS)
        total += float(np.sum(density - np.log(len(own) - 1) - np.log(bandwidth).sum()))
    return total


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
