"""Light directions from the highlight on a mirror sphere.

The lamp is seen mirrored where the normal halves the angle between sight and lamp: the lamp's direction is the viewing
direction mirrored about the normal there, not the normal itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Bool, Float

from itree_jax.sensing.light_calibration.sphere import Sphere

RIM = 0.97  # of the radius, inside of which highlights are looked for: a rim mirrors what lies behind the sphere
LEAST_PEAK = 0.2  # of full scale above what all images show: a lamp in a mirror is brilliant, often saturated
MOST_AREA = 0.05  # of the sphere's disk: a larger bright patch is a window or a white wall
LEAST_IMAGES = 3  # whose darkest value at a pixel is no lamp's: what stays bright in all of them stands still
HALF = 0.5  # of the peak: the blob's edge


@dataclass(frozen=True)
class Highlights:
    """The highlight in each image."""

    uv: Float[np.ndarray, "lights 2"]  # [px], centre of brightness
    radius: Float[np.ndarray, "lights"]  # [px], of a disk of the blob's area


def find_highlights(
    images: Float[np.ndarray, "lights height width"], sphere: Sphere, names: Sequence[str] | None = None
) -> Highlights:
    """The brightest compact blob inside the sphere in each image (linear, 1.0 = full scale).

    What is bright in every image (windows, the camera's own surroundings) is subtracted first if there are three or
    more of them. Of the blobs above half of the peak, the one with most light times compactness (share of the disk
    around it) counts. Raises `ItreeError` with the image's name if there is none.
    """
    names = names or [f"image {k}" for k in range(len(images))]
    static = images.min(0) if len(images) >= LEAST_IMAGES else np.zeros_like(images[0])
    inside = _inner(sphere, images.shape[1:])
    own = np.where(inside, images - static, 0.0)
    found = [_highlight(image, inside, name) for image, name in zip(own, names, strict=True)]
    return Highlights(np.array([uv for uv, _ in found]), np.array([radius for _, radius in found]))


def lights_from_highlights(
    uv: Float[np.ndarray, "*n 2"], sphere: Sphere
) -> tuple[Float[np.ndarray, "*n 3"], Float[np.ndarray, "*n 3"]]:
    """Unit directions toward the lamps, camera frame, and the surface points that mirror them."""
    X_cam, normal, sight = sphere.at(uv)
    return sight - 2.0 * (sight * normal).sum(-1, keepdims=True) * normal, X_cam


def _inner(sphere: Sphere, shape: tuple[int, ...]) -> Bool[np.ndarray, "height width"]:
    outline = sphere.outline()
    centre = outline.mean(0)
    polygon = np.round(centre + RIM * (outline - centre)).astype(np.int32)
    mask = np.zeros(shape, np.uint8)
    cv2.fillPoly(mask, [polygon], 1)
    return mask > 0


def _highlight(
    image: Float[np.ndarray, "height width"], inside: Bool[np.ndarray, "height width"], name: str
) -> tuple[Float[np.ndarray, "2"], float]:
    peak = float(image.max())
    if peak < LEAST_PEAK:
        raise ItreeError(
            f"{name}: no highlight on the sphere: nothing inside it is more than {peak:.2f} of full scale brighter "
            f"than in the other images (a lamp's mirror image is {LEAST_PEAK} or more); is it the mirror sphere, and "
            "one lamp an image?"
        )
    _, label, stats, _ = cv2.connectedComponentsWithStats((image > HALF * peak).astype(np.uint8), connectivity=8)
    best = max(range(1, len(stats)), key=lambda k: _light_times_compactness(image, label == k))
    blob, area = label == best, int(stats[best, cv2.CC_STAT_AREA])
    if area > MOST_AREA * inside.sum():
        raise ItreeError(
            f"{name}: no highlight on the sphere: the brightest patch covers {100 * area / inside.sum():.0f} % of it; "
            "is it the mirror sphere?"
        )
    v, u = np.nonzero(blob)
    weight = image[blob] - HALF * peak  # fades out at the blob's edge, so that no pixel comes in or goes by a hair
    return np.array([np.average(u, weights=weight), np.average(v, weights=weight)]), float(np.sqrt(area / np.pi))


def _light_times_compactness(
    image: Float[np.ndarray, "height width"], blob: Bool[np.ndarray, "height width"]
) -> float:
    points = np.argwhere(blob).astype(np.float32)
    around = cv2.minEnclosingCircle(points)[1] + 0.5
    return float(image[blob].sum() * len(points) / (np.pi * around**2))
