"""Light directions and intensities from the shading of a matte (Lambertian) sphere.

With the normals known, intensity = e_i albedo n . l_i is linear in b_i = e_i albedo l_i: three unknowns for thousands
of pixels. The sphere's albedo is one number that all lights share, so intensities are relative.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Bool, Float

from itree_jax.sensing.light_calibration.sphere import Sphere

# Between normal and sight: beyond 70 degrees, an error of the outline turns the normal three times as much as in the
# middle.
LEAST_COSINE = 0.35
# Lit: this far from the terminator, as a share of the brightest, where dark pixels would pull the fit.
LIT = 0.1
FIRST_LIT = 0.3  # of the 99 percentile: surely lit, to start with
SATURATED = 0.995  # of full scale: 8-bit images saturate at their last step
ROUNDS = 15
LEAST_SCALE = 1e-4  # of full scale: keeps weights finite when the fit is exact
LEAST_PIXELS = 50  # lit ones: below, the sphere is not lit or not there


@dataclass(frozen=True)
class Shading:
    """What the shading of a matte sphere says about each light."""

    directions: Float[np.ndarray, "lights 3"]  # unit, toward the light, camera frame
    strengths: Float[np.ndarray, "lights"]  # intensity times albedo, 1.0 = full scale
    residuals: Float[np.ndarray, "lights"]  # robust standard deviation of the fit over the strength

    @property
    def intensities(self) -> Float[np.ndarray, "lights"]:
        """Relative to their mean."""
        return self.strengths / self.strengths.mean()


class SpherePixels(NamedTuple):
    """Pixels of a sphere that are not near its rim, with what they show."""

    used: Bool[np.ndarray, "height width"]
    X_cam: Float[np.ndarray, "pixels 3"]
    normal: Float[np.ndarray, "pixels 3"]


def sphere_pixels(
    sphere: Sphere, shape: tuple[int, ...], pixels: Bool[np.ndarray, "height width"] | None = None
) -> SpherePixels:
    """The pixels of an image of `shape` whose slant is under 70 degrees, of `pixels` alone if given."""
    v, u = np.mgrid[: shape[0], : shape[1]].astype(float)
    X_cam, normal, sight = sphere.at(np.stack([u, v], axis=-1))
    used = np.nan_to_num(-(normal * sight).sum(-1)) > LEAST_COSINE
    if pixels is not None:
        used &= pixels
    return SpherePixels(used, X_cam[used], normal[used])


def lights_from_shading(
    images: Float[np.ndarray, "lights height width"],
    sphere: Sphere,
    pixels: Bool[np.ndarray, "height width"] | None = None,
    names: Sequence[str] | None = None,
) -> Shading:
    """Robust least squares over the lit pixels of each image (linear, 1.0 = full scale), `pixels` alone if given.

    Lit is what the fit itself predicts to be clear of the terminator (a threshold on noisy intensities would prefer the
    bright ones); saturated pixels are left out; stains, cast shadows and gloss count little (Cauchy's weights). Raises
    `ItreeError` with the image's name if too few pixels are lit.
    """
    seen = sphere_pixels(sphere, images.shape[1:], pixels)
    names = names or [f"image {k}" for k in range(len(images))]
    b, residual = zip(
        *(_fit(image[seen.used].astype(float), seen.normal, name) for image, name in zip(images, names, strict=True)),
        strict=True,
    )
    strength = np.linalg.norm(b, axis=1)
    return Shading(np.array(b) / strength[:, None], strength, np.array(residual) / strength)


def strengths_along(
    images: Float[np.ndarray, "lights height width"],
    sphere: Sphere,
    directions: Float[np.ndarray, "lights 3"],
) -> Shading:
    """Strengths alone, for directions known from a mirror sphere: the median ratio of intensity to n . l of lit pixels.

    Raises `ItreeError` if too few pixels are lit.
    """
    seen = [lit_by(image, sphere, light) for image, light in zip(images, directions, strict=True)]
    strengths = np.array([s.strength for s in seen])
    return Shading(directions, strengths, np.array([s.scatter for s in seen]) / strengths)


class LitSphere(NamedTuple):
    """A sphere's image beside what one light of known direction makes of it."""

    strength: float
    scatter: float  # robust standard deviation of the residual
    predicted: Float[np.ndarray, "height width"]  # 0 off the sphere and in attached shadow
    residual: Float[np.ndarray, "height width"]  # image less prediction
    used: Bool[np.ndarray, "height width"]  # lit, not saturated, not near the rim


def lit_by(
    image: Float[np.ndarray, "height width"], sphere: Sphere, light: Float[np.ndarray, "3"]
) -> LitSphere:
    """What a light along the unit direction `light` predicts; its strength is the median ratio over lit pixels."""
    seen = sphere_pixels(sphere, image.shape)
    shade = np.zeros(image.shape)
    shade[seen.used] = np.maximum(seen.normal @ light, 0.0)
    used = (shade > LIT) & (image < SATURATED)
    if used.sum() < LEAST_PIXELS:
        raise ItreeError(f"the sphere has {int(used.sum())} lit, unsaturated pixels under light {light.round(3)}")
    strength = float(np.median(image[used] / shade[used]))
    residual = image - strength * shade
    scatter = 1.4826 * float(np.median(np.abs(residual[used])))
    return LitSphere(strength, scatter, strength * shade, residual, used)


def _fit(
    x: Float[np.ndarray, "pixels"], n: Float[np.ndarray, "pixels 3"], name: str
) -> tuple[Float[np.ndarray, "3"], float]:
    """b with x = n . b on lit pixels, and the robust standard deviation of x about it."""
    open_ = x < SATURATED
    lit = open_ & (x > FIRST_LIT * np.percentile(x, 99.0)) if len(x) else open_
    weight = np.ones(len(x))
    b, scale = np.zeros(3), 0.0
    for _ in range(ROUNDS):
        if lit.sum() < LEAST_PIXELS:
            raise ItreeError(
                f"{name}: {int(lit.sum())} pixels of the sphere are lit and not saturated, {LEAST_PIXELS} are needed; "
                "is this the matte sphere, and its exposure right?"
            )
        w = weight[lit]
        b = np.linalg.lstsq(n[lit] * w[:, None], x[lit] * w, rcond=None)[0]
        scale = 1.4826 * float(np.median(np.abs(x - n @ b)[lit]))
        weight = 1.0 / np.sqrt(1.0 + ((x - n @ b) / (2.0 * max(scale, LEAST_SCALE))) ** 2)
        lit = open_ & (n @ b > LIT * np.linalg.norm(b))
    return b, scale
