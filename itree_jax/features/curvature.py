"""Gaussian and mean curvature of a region from its needles (Ikeuchi 1987, sec. 2.1.3 and 5.2).

The derivatives come from planes fitted to the x and y components of the unit normals around every pixel, not to p and
q: over a sphere these components are linear in (x, y), so that the fit has no bias there, and their noise stays bounded
at any slant. p = -n_x/n_z and q = -n_y/n_z carry the derivatives over: with m = (n_x, n_y), the second derivatives of z
are sqrt(1 + p^2 + q^2) times the first fundamental form times dm/d(x, y).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from itree_jax.features.window import Window

# Half the side of the neighbourhood [px]. 5 x 5 averages over two or more facets of the pixel pitch, and still finds a
# cylinder of radius 20 mm at a pitch of 1.65 mm with needles that err by 5 degrees.
REACH = 2
# The slope across a pixel is believed when its neighbourhood reaches this far: the smaller second moment of the pixel
# offsets, summed over the pixels that belong to the region [px^2]. 3 x 3 pixels have 6, any two rows or columns 2.5.
LEAST_SPREAD = 4.0
LEAST_PIXELS = 7  # two planes have 6 unknowns; 7 pixels (14 components) leave a residual to judge them by
# Slants beyond 84 degrees have no usable derivatives; the limit only keeps the division finite.
LEAST_COS_SLANT = 0.1


class NeedleFit(NamedTuple):
    """Planes through the needles around every pixel; zeros where `valid` is False."""

    normal: Float[Array, "s s 2"]  # smoothed n_x, n_y at the pixel
    slope: Float[Array, "s s 2 2"]  # d(n_x, n_y)/d(x, y) [1/mm]: rows n_x, n_y
    gain: Float[Array, "s s"]  # at most this times the noise of a needle [rad] is the noise of a curvature [1/mm]
    residual: Float[Array, "s s"]  # variance of a needle about the fit [rad^2], per direction in the tangent plane
    freedom: Float[Array, "s s"]  # degrees of freedom of `residual`
    valid: Bool[Array, "s s"]  # pixels of the region with support enough


class Curvatures(NamedTuple):
    """Gaussian and mean curvature of every pixel; zeros where `valid` is False. A batch has a leading axis."""

    K: Float[Array, "s s"]  # Gaussian [1/mm^2]
    H: Float[Array, "s s"]  # mean [1/mm], positive where convex
    valid: Bool[Array, "s s"]  # pixels of the region with support enough


def curvatures(window: Window) -> Curvatures:
    """K and H of every pixel of a region by the fundamental forms. A crease is not told apart here.

    The printed sign holds, H > 0 convex, because z points away from the viewer.
    """
    fit = fit_needles(window)
    K, H = gaussian_and_mean(fit)
    return Curvatures(K, H, fit.valid)


def fit_needles(window: Window) -> NeedleFit:
    """Least-squares planes n_x(x, y) and n_y(x, y) around every pixel, from the pixels of the region alone."""
    mask, pitch = jnp.asarray(window.mask), jnp.asarray(window.pitch)
    m = jnp.where(mask[..., None], jnp.asarray(window.normals)[..., :2], 0.0)
    pixels, mean_offset, spread = _support(mask.astype(m.dtype))
    least = _smaller_eigenvalue(spread)
    valid = mask & (pixels >= LEAST_PIXELS) & (least >= LEAST_SPREAD)
    safe = jnp.where(valid[..., None, None], spread, jnp.eye(2, dtype=m.dtype)[None, None])
    count = jnp.maximum(pixels, 1.0)[..., None]
    total = _box(m)
    along = jnp.stack([_box(m, x=1), _box(m, y=1)], axis=-1) - total[..., :, None] * mean_offset[..., None, :]
    slope = along @ _inverse(safe)  # per pixel
    mean = total / count
    normal = mean - jnp.einsum("abcd,abd->abc", slope, mean_offset)
    scatter = _box(m[..., :, None] * m[..., None, :]) - total[..., :, None] * mean[..., None, :]
    left = scatter - slope @ jnp.swapaxes(along, -1, -2)
    # An error seen in the image is longer on the surface; the first fundamental form gives its true length.
    squares = jnp.maximum(jnp.einsum("abcd,abcd->ab", first_form(normal), left), 0.0)
    freedom = jnp.where(valid, 2.0 * (pixels - 3.0), 1.0)
    return NeedleFit(
        normal=jnp.where(valid[..., None], normal, 0.0),
        slope=jnp.where(valid[..., None, None], slope, 0.0) / pitch,
        gain=jnp.where(valid, 1.0 / (jnp.sqrt(jnp.where(valid, least, 1.0)) * pitch), 0.0),
        residual=jnp.where(valid, squares / freedom, 0.0),
        freedom=freedom,
        valid=valid,
    )


def first_form(normal: Float[Array, "*n 2"]) -> Float[Array, "*n 2 2"]:
    """[[E, F], [F, G]] of the surface with unit normals (n_x, n_y, n_z < 0)."""
    towards_squared = jnp.maximum(1.0 - jnp.sum(normal**2, axis=-1), LEAST_COS_SLANT**2)
    pp_pq_qq = normal[..., :, None] * normal[..., None, :] / towards_squared[..., None, None]
    return jnp.broadcast_to(jnp.eye(2, dtype=normal.dtype), pp_pq_qq.shape) + pp_pq_qq


def gaussian_and_mean(fit: NeedleFit) -> tuple[Float[Array, "s s"], Float[Array, "s s"]]:
    """K [1/mm^2] and H [1/mm] from the fundamental forms as printed, with f = (p_y + q_x)/2."""
    first = first_form(fit.normal)
    second = jnp.einsum("abij,abjk->abik", first, fit.slope)
    E, F, G = first[..., 0, 0], first[..., 0, 1], first[..., 1, 1]
    e, f, g = second[..., 0, 0], (second[..., 0, 1] + second[..., 1, 0]) / 2.0, second[..., 1, 1]
    det = E * G - F**2
    return (e * g - f**2) / det, (e * G - 2.0 * f * F + g * E) / (2.0 * det)


def _support(
    weight: Float[Array, "s s"],
) -> tuple[Float[Array, "s s"], Float[Array, "s s 2"], Float[Array, "s s 2 2"]]:
    """The region's pixels around every pixel: how many, their mean offset (x, y) [px], its second moments [px^2]."""
    pixels = _box(weight)
    mean = jnp.stack([_box(weight, x=1), _box(weight, y=1)], axis=-1) / jnp.maximum(pixels, 1.0)[..., None]
    xx, xy, yy = _box(weight, x=2), _box(weight, x=1, y=1), _box(weight, y=2)
    about_pixel = jnp.stack([jnp.stack([xx, xy], axis=-1), jnp.stack([xy, yy], axis=-1)], axis=-2)
    return pixels, mean, about_pixel - pixels[..., None, None] * mean[..., :, None] * mean[..., None, :]


def _box(image: Float[Array, "s s *c"], x: int = 0, y: int = 0) -> Float[Array, "s s *c"]:
    """Sum over the neighbourhood of every pixel of the image times dx^x dy^y, offsets in pixels; 0 beyond the image."""
    for axis, power in enumerate((y, x)):
        size = image.shape[axis]
        padded = jnp.pad(image, [(REACH, REACH) if k == axis else (0, 0) for k in range(image.ndim)])
        image = sum(
            (float(k**power) * jax.lax.slice_in_dim(padded, k + REACH, k + REACH + size, axis=axis)
             for k in range(-REACH, REACH + 1) if k**power),
            start=jnp.zeros_like(image),
        )
    return image


def _smaller_eigenvalue(symmetric: Float[Array, "*n 2 2"]) -> Float[Array, "*n"]:
    half_sum = (symmetric[..., 0, 0] + symmetric[..., 1, 1]) / 2.0
    half_difference = (symmetric[..., 0, 0] - symmetric[..., 1, 1]) / 2.0
    return half_sum - jnp.sqrt(half_difference**2 + symmetric[..., 0, 1] ** 2)


def _inverse(symmetric: Float[Array, "*n 2 2"]) -> Float[Array, "*n 2 2"]:
    a, b, d = symmetric[..., 0, 0], symmetric[..., 0, 1], symmetric[..., 1, 1]
    rows = jnp.stack([jnp.stack([d, -b], axis=-1), jnp.stack([-b, a], axis=-1)], axis=-2)
    return rows / (a * d - b**2)[..., None, None]
