"""Surface characteristic of every pixel of a region and their shares: rule L4 (Ikeuchi 1987, sec. 2.1.3 and 5.2).

"K = 0" and "H = 0" are no tests for noisy data. Here the principal curvatures, the roots of k^2 - 2 H k + K, are told
from 0 in units of their own standard deviation, which follows from that of a needle: K = 0 when the smaller one can't
be told from 0, K = H = 0 when neither can. Decisions are soft, so that memberships are differentiable in the normals.
"""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from itree_jax.features.curvature import NeedleFit, fit_needles, gaussian_and_mean
from itree_jax.features.egi import surface_area
from itree_jax.features.window import Window

CHARACTERISTICS = ("planar", "cylindrical", "convex elliptic", "concave elliptic", "hyperbolic")
# The larger principal curvature of a plane's noise passes 4 sigma once in a thousand pixels, 3 sigma once in fifty.
SIGMAS = 4.0
SOFTNESS = 0.5  # width of a decision [sigmas]: 0 itself is decided with 1 : 3000
# A radius beyond this many windows bends the whole part by less than 12 degrees: a plane, however good the needles are.
LARGEST_RADIUS = 5.0
# A bend across of less than this share of the bend along is the fit's own error: without noise, 98 % of the pixels of
# tilted cylinders with radii of 3 to 12 px, smooth or of 5 degree facets, stay under 4 %.
LEAST_RATIO = 0.05
# Edges of less than this [rad] are taken for edges between facets (of 4 degrees in a STEP file, which two of may fall
# into one neighbourhood).
LEAST_CREASE = 0.175
# Residual (standard deviation in one direction) that a crease leaves, per angle: a step fitted by a line. 0.18 in the
# middle of the neighbourhood, 0.21 near its side.
CREASE_RESIDUAL = 0.18


def characteristics(window: Window, needle_std: Float[Array, ""]) -> Float[Array, "s s 5"]:
    """Membership of every pixel in each of `CHARACTERISTICS`; sums to 1, or to 0 off the region and where not known.

    Not known are pixels with too little support (region of less than three pixels' width) and those at a crease, where
    two orientations within one neighbourhood would pass for a strong curvature.

    Args:
        window: one region.
        needle_std: standard deviation [rad] of a needle in either direction of the tangent plane, independent from
            pixel to pixel; the rms angle between needle and normal is an upper bound of it. One value for model views
            and image regions, so that both are judged alike.
    """
    fit = fit_needles(window)
    K, H = gaussian_and_mean(fit)
    deviation = _curvature_std(fit, needle_std, jnp.asarray(window.pitch))
    known = fit.valid & ~at_crease(fit, needle_std)
    return jnp.where(known[..., None], _memberships(K, H, deviation), 0.0)


def characteristic_shares(memberships: Float[Array, "s s 5"], window: Window) -> Float[Array, "5"]:
    """Shares of the region's surface area with each characteristic; 1 less their sum is the share not known.

    Zeros for an empty region.
    """
    area = surface_area(jnp.asarray(window.normals), jnp.asarray(window.mask), jnp.asarray(window.pitch))
    total = jnp.sum(area)
    return jnp.einsum("ab,abc->c", area, memberships) / jnp.where(total > 0, total, 1.0)


def at_crease(fit: NeedleFit, needle_std: Float[Array, ""]) -> Bool[Array, "s s"]:
    """Pixels whose needles lie farther from their planes than noise and facets can put them."""
    noise = needle_std**2 * (1.0 + SIGMAS * jnp.sqrt(2.0 / fit.freedom))
    return jax.lax.stop_gradient(fit.valid & (fit.residual > noise + (CREASE_RESIDUAL * LEAST_CREASE) ** 2))


def _curvature_std(fit: NeedleFit, needle_std: Float[Array, ""], pitch: Float[Array, ""]) -> Float[Array, "s s"]:
    """Standard deviation of a principal curvature [1/mm], not less than the resolution floor."""
    size = fit.valid.shape[0]
    floor = 1.0 / (SIGMAS * LARGEST_RADIUS * size * pitch)
    return jnp.sqrt((fit.gain * needle_std) ** 2 + floor**2)


def _memberships(
    K: Float[Array, "s s"], H: Float[Array, "s s"], deviation: Float[Array, "s s"]
) -> Float[Array, "s s 5"]:
    """The table of sec. 5.2 with soft decisions."""
    squared = H**2 - K
    apart = jnp.where(squared > 0, jnp.sqrt(jnp.where(squared > 0, squared, 1.0)), 0.0)  # sqrt has no derivative at 0
    larger = (jnp.abs(H) + apart) / deviation
    unsure = jnp.sqrt(1.0 + (LEAST_RATIO / SIGMAS * larger) ** 2)
    smaller = (jnp.abs(H) - apart) / deviation / unsure  # of the sign of K
    positive = jax.nn.sigmoid((smaller - SIGMAS) / SOFTNESS)
    negative = jax.nn.sigmoid((-smaller - SIGMAS) / SOFTNESS)
    zero = 1.0 - positive - negative
    curved = jax.nn.sigmoid((larger - SIGMAS) / SOFTNESS)
    convex = jax.nn.sigmoid(H / deviation / SOFTNESS)
    each = [zero * (1.0 - curved), zero * curved, positive * convex, positive * (1.0 - convex), negative]
    return jnp.stack(each, axis=-1)
