"""What the sensor makes of views of a part: lit images, needles, edges, and the regions it cuts them into.

Model views without noise and noisy draws pass through the same functions, so that work models and what is measured are
alike.
"""

from functools import cache
from typing import NamedTuple

import cv2
import jax
import jax.numpy as jnp
import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.noise import sensor_noise
from jaxtyping import Bool, Float

from itree_jax.features.edges import edge_map, seen_by
from itree_jax.kept_functions import kept
from itree_jax.sensing.depth_camera import depth_needle_deviation, depth_noise_of
from itree_jax.sensing.noise_model import intensity_std
from itree_jax.sensing.photometric import photometric_stereo
from itree_jax.sensing.reaching import MODEL_ERROR
from itree_jax.sensor import Noise, Sensor

BRIGHTEST = 0.7  # of full scale: an exposure that leaves room for highlights
PIXELS_AT_ONCE = (256, 256)  # solved in one call, so that one shape is compiled; background pixels are left out
WINDOWS_AT_ONCE = 64  # edge maps of one compiled call
MOST_REGIONS = 3  # regions kept per attitude, the largest ones
NO_PIXELS = np.zeros((0, 0), bool)


class Region(NamedTuple):
    """One region of a window."""

    mask: Bool[np.ndarray, "s s"]
    centre: Float[np.ndarray, "3"]  # mean surface point [mm], camera frame
    normal: Float[np.ndarray, "3"]  # unit mean normal
    area: float  # of surface [mm^2]

    def without_pixels(self) -> "Region":
        """What is kept of many regions at once."""
        return self._replace(mask=NO_PIXELS)


def lit_images(
    normal: Float[np.ndarray, "pixels 3"], lit: Bool[np.ndarray, "lights pixels"], sensor: Sensor
) -> Float[np.ndarray, "lights pixels"]:
    """Lambertian intensities, exposed so that the brightest light gives `BRIGHTEST` on a surface that faces it."""
    cosine = sensor.light_directions @ normal.T
    return (BRIGHTEST * relative_intensities(sensor)[:, None] * np.maximum(cosine, 0.0) * lit).astype(np.float32)


def relative_intensities(sensor: Sensor) -> Float[np.ndarray, "lights"]:
    return sensor.light_intensities / sensor.light_intensities.max(initial=0.0)


def noisy(images: Float[np.ndarray, "lights *pixels"], sensor: Sensor, seed: int) -> Float[np.ndarray, "lights *n"]:
    """Images under the sensor's noise."""
    noise = sensor.noise
    return sensor_noise(images, noise.full_well_e, noise.read_noise_e, noise.bits, seed)


def read(
    images: Float[np.ndarray, "lights pixels"], sensor: Sensor
) -> tuple[Bool[np.ndarray, "pixels"], Float[np.ndarray, "pixels 3"]]:
    """Photometric stereo on a list of pixels: which are detectable, and their needles."""
    lights, count = images.shape
    chunk = PIXELS_AT_ONCE[0] * PIXELS_AT_ONCE[1]
    padded = np.pad(images, ((0, 0), (0, -count % chunk)))
    parts = []
    for first in range(0, padded.shape[1], chunk):
        image = padded[:, first : first + chunk].reshape(lights, *PIXELS_AT_ONCE)
        needles = photometric_stereo(
            image, sensor.light_directions, relative_intensities(sensor), sensor.noise, sensor.slant_limit
        )
        parts.append(jax.device_get((needles.interpretable.reshape(-1), needles.normals.reshape(-1, 3))))
    interpretable, normals = (np.concatenate(p)[:count] for p in zip(*parts, strict=True))
    return interpretable & (-normals[:, 2] > np.cos(sensor.slant_limit)), normals


def window_images(
    there: Bool[np.ndarray, "n s s"], normal: Float[np.ndarray, "n s s 3"], lit: Bool[np.ndarray, "n lights s s"],
    sensor: Sensor,
) -> Float[np.ndarray, "lights n s s"]:
    """Lit images of a batch of windows, dark where nothing is."""
    images = np.zeros((sensor.light_count, *there.shape), np.float32)
    images[:, there] = lit_images(normal[there], np.moveaxis(lit, 1, 0)[:, there], sensor)
    return images


@kept("noise")
def window_edges(images: Float[jax.Array, "n lights s s"], noise: Noise) -> Float[jax.Array, "n s s 2"]:
    """Edge maps of a batch of windows: what two lights or more show.

    The border of a cast shadow, which one light shows, is not the part's. Thresholds go by the intensities' noise. To a
    depth camera there are no edges: its noise lets it place a crease no better than to its window, which is several of
    these pixels wide, and a step is the region's outline already.
    """
    if images.shape[1] == 0:
        return jnp.zeros((images.shape[0], *images.shape[2:], 2), jnp.float32)

    def one(image: jax.Array) -> jax.Array:
        return seen_by(edge_map(image, jnp.asarray(intensity_std(image, noise))), image.shape[0])

    return jax.lax.map(one, jnp.asarray(images), batch_size=16)


def edges_of(images: Float[np.ndarray, "n lights s s"], sensor: Sensor) -> Float[np.ndarray, "n s s 2"]:
    """`window_edges` of any number of windows, in batches of one size so that one shape is compiled."""
    found = []
    for first in range(0, len(images), WINDOWS_AT_ONCE):
        batch = images[first : first + WINDOWS_AT_ONCE]
        filled = np.zeros((WINDOWS_AT_ONCE, *images.shape[1:]), np.float32)
        filled[: len(batch)] = batch
        found.append(np.asarray(window_edges(filled, sensor.noise))[: len(batch)])
    return np.concatenate(found) if found else np.zeros((0, *images.shape[2:], 2), np.float32)


@cache
def needle_deviation(noise: Noise, exposure: float = BRIGHTEST) -> float:
    """By how much a needle may err [rad]: noise of an intensity at this exposure, and model error, both relative."""
    std = float(intensity_std(np.asarray(exposure, np.float32), noise)) / exposure
    return float(np.hypot(std, MODEL_ERROR))


def sensor_needle_deviation(sensor: Sensor) -> float:
    """By how much a needle may err [rad] under a sensor, whatever its kind."""
    if sensor.is_depth_camera:
        return depth_needle_deviation(depth_noise_of(sensor), sensor.mm_per_px)
    return needle_deviation(sensor.noise)


def largest_regions(
    mask: Bool[np.ndarray, "s s"], least_pixels: float, most: int = MOST_REGIONS
) -> list[Bool[np.ndarray, "s s"]]:
    """8-connected regions of at least this many pixels, the largest first."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    areas = stats[1:, cv2.CC_STAT_AREA]
    order = [k for k in np.argsort(-areas, kind="stable") if areas[k] >= least_pixels][:most]
    return [labels == k + 1 for k in order] if count > 1 else []


def describe_region(
    mask: Bool[np.ndarray, "s s"], normals: Float[np.ndarray, "s s 3"], depth: Float[np.ndarray, "s s"], camera: Camera
) -> Region:
    """Where a region lies in space, how it is tilted and how large it is."""
    v, u = np.nonzero(mask)
    X_cam = camera.unproject(np.stack([u, v], axis=-1).astype(float), depth[mask].astype(float))
    needle = normals[mask]
    total = needle.sum(axis=0)
    area = float((camera.mm_per_px(1.0) ** 2 / np.maximum(-needle[:, 2], 0.1)).sum())
    return Region(mask, X_cam.mean(axis=0), total / max(float(np.linalg.norm(total)), 1e-9), area)
