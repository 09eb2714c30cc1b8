"""Noisy draws: regions as the sensor would measure them, for distributions and error rates.

A draw is an attitude rendered under every light, given the sensor's noise, read by photometric stereo and cut into
regions again: what recognition will see of an unoccluded part.
"""

from dataclasses import dataclass

import jax
import numpy as np
from itree_kernels.apparent import cast_apparent_shapes
from itree_kernels.errors import ItreeError
from itree_kernels.mesh import RayMesh
from itree_kernels.noise import sensor_noise
from jaxtyping import Bool, Float, Int

from itree_jax.features.region import RegionFeatures
from itree_jax.sensing.photometric import photometric_stereo
from itree_jax.sensor import Sensor
from itree_jax.tree.appearances import VIEWS_AT_ONCE, largest_regions, measured, mesh_reach, window_camera
from itree_jax.tree.dome import camera_rotation
from itree_jax.tree.groups import roll_rotation

BRIGHTEST = 0.7  # of full scale: an exposure that leaves room for highlights
PIXELS_AT_ONCE = (256, 256)  # solved in one call, so that one shape is compiled; background pixels are left out


@dataclass(frozen=True)
class Draws:
    """One target region (the largest) per draw that shows any."""

    features: RegionFeatures  # leading axis draws, camera frame
    group: Int[np.ndarray, "draws"]  # true attitude group
    R_cam_obj: Float[np.ndarray, "draws 3 3"]  # true attitude
    empty: int  # draws that showed no region


def random_attitudes(
    triangles: Float[np.ndarray, "cells 3 3"], group: Int[np.ndarray, "cells"], count: int, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "draws 3 3"], Int[np.ndarray, "draws"]]:
    """`count` attitudes of every group: a random point of a random cell of the group, turned at random about the line
    of sight. The appearances are cast at the middle of the cells, which no real part keeps to.
    """
    cell = np.concatenate([rng.choice(np.flatnonzero(group == g), count) for g in np.unique(group)])
    corner = rng.dirichlet(np.ones(3), len(cell))  # uniform over a triangle
    direction = np.einsum("dc,dcx->dx", corner, triangles[cell])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    roll = rng.uniform(0.0, 2.0 * np.pi, len(cell))
    return roll_rotation(roll) @ camera_rotation(direction), group[cell]


def noisy_draws(
    mesh: RayMesh, sensor: Sensor, R_cam_obj: Float[np.ndarray, "draws 3 3"], group: Int[np.ndarray, "draws"],
    rng: np.random.Generator,
) -> Draws:
    """Renders, adds noise, solves and measures the largest region of every draw.

    Raises ItreeError when none shows a region: the sensor's noise hides the part.
    """
    camera, pitch = window_camera(mesh_reach(mesh))
    least = sensor.smallest_region / pitch**2
    masks, normals, kept = [], [], []
    for first in range(0, len(R_cam_obj), VIEWS_AT_ONCE):
        R = R_cam_obj[first : first + VIEWS_AT_ONCE]
        shapes = cast_apparent_shapes(
            mesh, R, np.zeros((len(R), 3)), camera, sensor.light_directions, sensor.slant_limit
        )
        there = shapes.face >= 0
        images = lit_images(shapes.normal[there], np.moveaxis(shapes.lit, 1, -1)[there].T, sensor)
        detectable, needles = np.zeros(there.shape, bool), np.zeros((*there.shape, 3), np.float32)
        detectable[there], needles[there] = interpreted(images, sensor, int(rng.integers(2**31)))
        for k in range(len(R)):
            regions = largest_regions(detectable[k], least, most=1)
            if regions:
                kept.append(first + k)
                masks.append(regions[0])
                normals.append(np.where(regions[0][..., None], needles[k], 0.0))
    if not kept:
        raise ItreeError(
            f"Under the sensor's noise ({sensor.noise}) none of {len(R_cam_obj)} views of the part shows a region. "
            "Check the noise of the sensor, or lower its smallest region."
        )
    index = np.array(kept, int)
    return Draws(measured(masks, normals, pitch), group[index], R_cam_obj[index], len(R_cam_obj) - len(index))


def lit_images(
    normal: Float[np.ndarray, "pixels 3"], lit: Bool[np.ndarray, "lights pixels"], sensor: Sensor
) -> Float[np.ndarray, "lights pixels"]:
    """Lambertian intensities, exposed so that the brightest light gives `BRIGHTEST` on a surface that faces it."""
    relative = sensor.light_intensities / sensor.light_intensities.max()
    cosine = sensor.light_directions @ normal.T
    return (BRIGHTEST * relative[:, None] * np.maximum(cosine, 0.0) * lit).astype(np.float32)


def interpreted(
    images: Float[np.ndarray, "lights pixels"], sensor: Sensor, seed: int
) -> tuple[Bool[np.ndarray, "pixels"], Float[np.ndarray, "pixels 3"]]:
    """What photometric stereo makes of the pixels under the sensor's noise: which are detectable, and their needles."""
    noise, relative = sensor.noise, sensor.light_intensities / sensor.light_intensities.max()
    images = sensor_noise(images, noise.full_well_e, noise.read_noise_e, noise.bits, seed)
    lights, count = images.shape
    chunk = PIXELS_AT_ONCE[0] * PIXELS_AT_ONCE[1]
    padded = np.pad(images, ((0, 0), (0, -count % chunk)))
    parts = []
    for first in range(0, padded.shape[1], chunk):
        image = padded[:, first : first + chunk].reshape(lights, *PIXELS_AT_ONCE)
        needles = photometric_stereo(image, sensor.light_directions, relative, noise, sensor.slant_limit)
        parts.append(jax.device_get((needles.interpretable.reshape(-1), needles.normals.reshape(-1, 3))))
    interpretable, normals = (np.concatenate(p)[:count] for p in zip(*parts, strict=True))
    return interpretable & (-normals[:, 2] > np.cos(sensor.slant_limit)), normals
