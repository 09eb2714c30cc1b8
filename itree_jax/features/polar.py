"""Maps of a region in polar cells round its mass centre, in the face frame: how edges and surface characteristics lie.

Angles count from the maximum inertia direction, as those of d(theta) do, so that a rotation of the part moves a map by
cells along its angle, and all rotations are compared at once by one circular correlation. The cells are the search
areas of the paper (Ikeuchi 1987, sec. 2.1.3): as wide as the mass centre and the direction are uncertain.
"""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from itree_jax.features.inertia import window_grid
from itree_jax.features.rectify import affine_T
from itree_jax.features.window import Window

RADII = 5  # a region's mass centre moves by a few pixels under noise and shadow: a tenth of a window each
ANGLES = 32  # 11 degrees: A4's direction errs by about as much
RIM = 2  # [px] beyond the region where its border's edges lie


def polar_place(
    window: Window, T: Float[Array, "2 2"], centroid: Float[Array, "2"], alpha: Float[Array, ""]
) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
    """Radius in cells and angle [rad] from `alpha` of every pixel of a window, on the face."""
    size, pitch = jnp.asarray(window.mask).shape[0], jnp.asarray(window.pitch)
    x, y = window_grid(size, pitch) - centroid[:, None, None]
    x, y = T[0, 0] * x + T[0, 1] * y, T[1, 1] * y
    squared = (x**2 + y**2).reshape(-1)
    safe = jnp.where(squared > 0, squared, 1.0)
    radius = jnp.where(squared > 0, jnp.sqrt(safe), 0.0)
    angle = jnp.arctan2(jnp.where(squared > 0, y.reshape(-1), 0.0), jnp.where(squared > 0, x.reshape(-1), 1.0))
    return radius / (size * pitch / 2.0 / RADII), angle - alpha


def polar_map(
    radius: Float[Array, "n"], angle: Float[Array, "n"], values: Float[Array, "n c"]
) -> Float[Array, "radii angles c"]:
    """Sums of values in polar cells, each shared linearly with the neighbouring ones; what lies farther out is in the
    last ring."""
    at = jnp.clip(radius - 0.5, 0.0, RADII - 1.0)
    ring = jnp.maximum(1.0 - jnp.abs(at[:, None] - jnp.arange(RADII, dtype=at.dtype)), 0.0)
    step = angle * (ANGLES / (2.0 * jnp.pi))
    apart = step[:, None] - jnp.arange(ANGLES, dtype=at.dtype)
    apart = apart - ANGLES * jnp.round(apart / ANGLES)
    sector = jnp.maximum(1.0 - jnp.abs(apart), 0.0)
    return jnp.einsum("nr,nt,nc->rtc", ring, sector, values)


def strongest(values: Float[Array, "n c"], weight: Float[Array, "n"], most: int) -> tuple[Array, Array]:
    """Indices of the `most` places of largest weight, and the values there (0 where the weight is)."""
    weight, index = jax.lax.top_k(weight, min(most, weight.shape[0]))
    return index, jnp.where(weight[:, None] > 0, values[index], 0.0)


def turn_correlation(
    observed: Float[Array, "*n radii angles c"], model: Float[Array, "*m radii angles c"]
) -> Float[Array, "*k angles"]:
    """Likeness in 0..1 (cosine) of an observed map and a model's turned by 2 pi k/ANGLES; 0 where one is empty.

    Leading axes broadcast.
    """
    f, g = jnp.fft.rfft(observed, axis=-2), jnp.fft.rfft(model, axis=-2)
    cross = jnp.einsum("...rtc,...rtc->...t", f, jnp.conj(g))
    power = jnp.sum(observed**2, axis=(-3, -2, -1)) * jnp.sum(model**2, axis=(-3, -2, -1))
    there = power > 0
    scale = jnp.where(there, jnp.sqrt(jnp.where(there, power, 1.0)), 1.0)
    return jnp.where(there[..., None], jnp.fft.irfft(cross, n=observed.shape[-2], axis=-1) / scale[..., None], 0.0)


def face_angle(edge: Float[Array, "n 2"], p: Float[Array, ""], q: Float[Array, ""]) -> Float[Array, "n"]:
    """Direction [rad] in face axes of edges given as strength times (cos, sin) of twice their image direction."""
    there = jnp.sum(edge**2, axis=-1) > 0
    half = 0.5 * jnp.arctan2(jnp.where(there, edge[:, 1], 0.0), jnp.where(there, edge[:, 0], 1.0))
    T = affine_T(p, q)
    x, y = jnp.cos(half), jnp.sin(half)
    return jnp.arctan2(T[1, 1] * y, T[0, 0] * x + T[0, 1] * y)
