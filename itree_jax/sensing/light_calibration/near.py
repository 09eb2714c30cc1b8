"""Near point lights: their positions, from the directions seen on spheres at several places."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.optimize
from itree_kernels.errors import ItreeError
from jaxtyping import Float

from itree_jax.sensing.light_calibration.matte import LIT, SATURATED, sphere_pixels
from itree_jax.sensing.light_calibration.sphere import Sphere
from itree_jax.sensing.lights import axis_point

# Between the rays to one lamp, which are measured to a few tenths of a degree: less tells no position.
LEAST_PARALLAX = np.radians(0.5)


MOST_PIXELS = 20000  # of all spheres together: more add time, not knowledge of four numbers
ROBUST_SCALE = 0.02  # of the strength: residuals beyond, such as stains and gloss, count less


class NearLights(NamedTuple):
    """Point lights in the camera frame."""

    positions: Float[np.ndarray, "lights 3"]  # [mm]
    misses: Float[np.ndarray, "lights"]  # [mm], root mean square distance between the position and the rays


@dataclass(frozen=True)
class NearShading:
    """What the shading of matte spheres at several places says about each near light."""

    positions: Float[np.ndarray, "lights 3"]  # [mm]
    strengths: Float[np.ndarray, "lights"]  # intensity times albedo at the working distance, 1.0 = full scale
    residuals: Float[np.ndarray, "lights"]  # robust standard deviation of the fit over the strength


def triangulate(
    points: Float[np.ndarray, "spheres lights 3"], directions: Float[np.ndarray, "spheres lights 3"]
) -> NearLights:
    """The point closest to the rays from `points` [mm] along unit `directions`, for each light.

    Each ray takes the component of the miss across itself: sum_k (1 - d d^T)(p - x_k) = 0. Raises `ItreeError` for
    fewer than two spheres, or when the rays to a light are parallel (it is distant, or the spheres stand too close).
    """
    if len(points) < 2:
        raise ItreeError(f"near lights need spheres at two places or more, there is {len(points)}")
    across = np.eye(3) - directions[..., :, None] * directions[..., None, :]
    A, b = across.sum(0), (across @ points[..., None]).sum(0)[..., 0]
    least = np.linalg.eigvalsh(A)[:, 0] / len(points)  # mean squared sine of the rays against their middle
    for light, square in enumerate(least):
        if square < (LEAST_PARALLAX / 2.0) ** 2:
            raise ItreeError(
                f"light {light}: the rays to it from the {len(points)} spheres are parallel within "
                f"{np.degrees(2.0 * np.sqrt(max(float(square), 0.0))):.2f} degrees: no position can be told; take it "
                "as a distant light, or put the spheres farther apart"
            )
    positions = np.linalg.solve(A, b[..., None])[..., 0]
    miss = (across @ (positions - points)[..., None])[..., 0]
    return NearLights(positions, np.sqrt((miss**2).sum(-1).mean(0)))


def refine_from_shading(
    images: Float[np.ndarray, "spheres lights height width"],
    spheres: Sequence[Sphere],
    positions: Float[np.ndarray, "lights 3"],
    working_distance: float,
) -> NearShading:
    """Positions [mm] and strengths that least squares finds in the shading of matte spheres, from `positions` on.

    x = own albedo n . (p - X) / |p - X|^3 over the lit pixels of all spheres at once: each part of a sphere is lit from
    its own direction and distance, which the distant fit of one sphere leaves out. Strengths are those where the
    optical axis meets `working_distance` [mm].
    """
    found = [_refine(images[:, light], spheres, p, working_distance) for light, p in enumerate(positions)]
    p, strength, residual = (np.array(values) for values in zip(*found, strict=True))
    return NearShading(p, strength, residual)


def _refine(
    images: Float[np.ndarray, "spheres height width"],
    spheres: Sequence[Sphere],
    start: Float[np.ndarray, "3"],
    working_distance: float,
) -> tuple[Float[np.ndarray, "3"], float, float]:
    seen = [sphere_pixels(sphere, image.shape) for sphere, image in zip(spheres, images, strict=True)]
    X = np.concatenate([pixels.X_cam for pixels in seen])
    n = np.concatenate([pixels.normal for pixels in seen])
    x = np.concatenate([image[pixels.used] for image, pixels in zip(images, seen, strict=True)]).astype(float)
    to_light = start - X
    lit = ((n * to_light).sum(1) > LIT * np.linalg.norm(to_light, axis=1)) & (x < SATURATED)
    stride = max(1, int(lit.sum()) // MOST_PIXELS)
    X, n, x = X[lit][::stride], n[lit][::stride], x[lit][::stride]
    axis = axis_point(working_distance)

    def per_strength(p: np.ndarray) -> np.ndarray:
        away = p - X
        return (n * away).sum(1) * ((p - axis) ** 2).sum() / (away**2).sum(1) ** 1.5

    unit = float(np.linalg.norm(start - axis))  # so that all unknowns are about 1
    strength = float(np.median(x / per_strength(start)))
    fit = scipy.optimize.least_squares(
        lambda a: a[3] * per_strength(a[:3] * unit) - x / strength,
        np.array([*start / unit, 1.0]), loss="cauchy", f_scale=ROBUST_SCALE,
    )  # fmt: skip
    p, strength = fit.x[:3] * unit, float(fit.x[3]) * strength
    residual = x - strength * per_strength(p)
    return p, strength, 1.4826 * float(np.median(np.abs(residual))) / strength
