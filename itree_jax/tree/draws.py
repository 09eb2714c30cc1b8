"""Noisy draws: regions as the sensor would measure them, for error rates and distributions (design: rules are measured).

A draw is an attitude rendered under every light, given the sensor's noise, read by photometric stereo and cut into
regions again: what recognition will see of an unoccluded part.
"""

from dataclasses import dataclass

import jax
import numpy as np
from itree_kernels.apparent import cast_apparent_shapes
from itree_kernels.mesh import RayMesh
from itree_kernels.noise import sensor_noise
from jaxtyping import Bool, Float, Int

from itree_jax.features.region import RegionFeatures
from itree_jax.sensing.photometric import photometric_stereo
from itree_jax.sensor import Sensor
from itree_jax.tree.appearances import VIEWS_AT_ONCE, largest_regions, measured, mesh_reach, window_camera

BRIGHTEST = 0.7  # of full scale: an exposure that leaves room for highlights


@dataclass(frozen=True)
class Draws:
    """One target region (the largest) per draw that shows any."""

    features: RegionFeatures  # leading axis draws, camera frame; `egi` is empty unless it was asked for
    group: Int[np.ndarray, "draws"]  # true attitude group
    R_cam_obj: Float[np.ndarray, "draws 3 3"]  # true attitude
    empty: int  # draws that showed no region


def random_attitudes(
    R_cam_obj: Float[np.ndarray, "views 3 3"], group: Int[np.ndarray, "views"], count: int, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "draws 3 3"], Int[np.ndarray, "draws"]]:
    """`count` attitudes of every group: a random view of the group, turned at random about the line of sight."""
    chosen = np.concatenate([rng.choice(np.flatnonzero(group == g), count) for g in np.unique(group)])
    angle = rng.uniform(0.0, 2.0 * np.pi, len(chosen))
    c, s, o = np.cos(angle), np.sin(angle), np.zeros(len(chosen))
    R_turn = np.stack([c, -s, o, s, c, o, o, o, o + 1.0], axis=-1).reshape(-1, 3, 3)
    return R_turn @ R_cam_obj[chosen], group[chosen]


def noisy_draws(
    mesh: RayMesh, sensor: Sensor, R_cam_obj: Float[np.ndarray, "draws 3 3"], group: Int[np.ndarray, "draws"],
    rng: np.random.Generator, with_egi: bool = True,
) -> Draws:
    """Renders, adds noise, solves and measures the largest region of every draw."""
    camera, pitch = window_camera(mesh_reach(mesh))
    least = sensor.smallest_region / pitch**2
    masks, normals, kept = [], [], []
    for first in range(0, len(R_cam_obj), VIEWS_AT_ONCE):
        R = R_cam_obj[first : first + VIEWS_AT_ONCE]
        shapes = cast_apparent_shapes(
            mesh, R, np.zeros((len(R), 3)), camera, sensor.light_directions, sensor.slant_limit
        )
        images = lit_images(shapes.normal, shapes.lit, sensor)
        noise = sensor.noise
        images = sensor_noise(images, noise.full_well_e, noise.read_noise_e, noise.bits, int(rng.integers(2**31)))
        found, needles = interpreted(images, sensor)
        for k in range(len(R)):
            regions = largest_regions(found[k], least, most=1)
            if regions:
                kept.append(first + k)
                masks.append(regions[0])
                normals.append(np.where(regions[0][..., None], needles[k], 0.0))
    index = np.array(kept, int)
    return Draws(measured(masks, normals, pitch, with_egi), group[index], R_cam_obj[index], len(R_cam_obj) - len(index))


def lit_images(
    normal: Float[np.ndarray, "draws s s 3"], lit: Bool[np.ndarray, "draws lights s s"], sensor: Sensor
) -> Float[np.ndarray, "draws lights s s"]:
    """Lambertian images, exposed so that the brightest light gives `BRIGHTEST` on a surface that faces it."""
    relative = sensor.light_intensities / sensor.light_intensities.max()
    cosine = np.einsum("dhwc,lc->dlhw", normal, sensor.light_directions)
    return (BRIGHTEST * relative[:, None, None] * np.maximum(cosine, 0.0) * lit).astype(np.float32)


def interpreted(
    images: Float[np.ndarray, "draws lights s s"], sensor: Sensor
) -> tuple[Bool[np.ndarray, "draws s s"], Float[np.ndarray, "draws s s 3"]]:
    """Pixels with a needle under the slant limit, and the needles."""
    relative = sensor.light_intensities / sensor.light_intensities.max()
    full = np.zeros((VIEWS_AT_ONCE, *images.shape[1:]), np.float32)
    full[: len(images)] = images
    needles = photometric_stereo(full, sensor.light_directions, relative, sensor.noise, sensor.slant_limit)
    interpretable, normals = jax.device_get((needles.interpretable, needles.normals))
    interpretable, normals = interpretable[: len(images)], normals[: len(images)]
    return interpretable & (-normals[..., 2] > np.cos(sensor.slant_limit)), normals
