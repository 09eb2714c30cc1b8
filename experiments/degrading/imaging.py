"""Images of settled bins under a condition."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from itree_cad.bundled import part_from_solid
from itree_cad.csg import box
from itree_cad.part import Part
from itree_kernels.apparent import cast_apparent_shapes
from itree_kernels.mesh import ray_mesh
from itree_kernels.noise import sensor_noise
from jaxtyping import Float
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from degrading.conditions import Condition
from itree_jax.sensing.bundled import DEPTH_NOISE, LIGHTS_OFF_AXIS, bundled_sensor
from itree_jax.sensing.scene_folder import Scene
from itree_jax.sensing.scene_writer import TrueObject
from itree_jax.sensor import Sensor
from itree_jax.simulate.bin import Bin, camera_above
from itree_jax.simulate.imaging import ImageNoise, image_mixed_bin

SMALL = 0.5  # of the bench camera's sides: 320 x 240 px at 1 mm, so that a scene takes seconds
PATCH = 8.0  # [mm] of a stain
ABOVE = 10.0  # [mm] from a part's highest point to the plate that covers some of it
THICK, RIM = 2.0, 4.0  # [mm] of a plate; what it reaches beyond the part


class Placed(NamedTuple):
    """A solid with its pose."""

    part: Part
    T_bin_obj: Float[np.ndarray, "4 4"]


def sensor_of(condition: Condition) -> Sensor:
    """The bench sensor with a smaller image and so many lights evenly around the axis, all as they are told."""
    sensor = bundled_sensor("bench")
    L = _ring(condition.lights) if condition.lights != sensor.light_count else sensor.light_directions
    return replace(
        scaled(sensor, SMALL * condition.scale), light_directions=L, light_intensities=np.ones(condition.lights)
    )


def told_sensor(condition: Condition) -> Sensor:
    """What the trees are compiled for: without a light that is known to have failed."""
    sensor = sensor_of(condition)
    if not condition.missing:
        return sensor
    left = sensor.light_directions[1:]
    return replace(sensor, light_directions=left, light_intensities=np.ones(len(left)))


def scene_of(
    part: Part, T_bin_obj: Float[np.ndarray, "parts 4 4"], bin_: Bin, condition: Condition, seed: int
) -> tuple[Scene, list[TrueObject]]:
    """The scene as the product is given it, and the truth about the parts. The same seed gives the same bytes."""
    light_rng, stain_rng, plate_rng, depth_rng = np.random.default_rng(seed).spawn(4)
    told = sensor_of(condition)
    true = replace(told, light_directions=turned(told.light_directions, condition.light_error, light_rng))
    plates = [plate_over(part, T, told, condition.hidden, plate_rng) for T in T_bin_obj] if condition.hidden else []
    kinds = [(part, 1), *((plate.part, 2 + k) for k, plate in enumerate(plates))]
    of_kind = np.concatenate([np.zeros(len(T_bin_obj), int), 1 + np.arange(len(plates))])
    poses = np.concatenate([T_bin_obj, *(plate.T_bin_obj[None] for plate in plates)])
    ideal, truth = image_mixed_bin(kinds, of_kind, poses, bin_, true, noise=ImageNoise(False, 0.0), seed=seed)
    images = ideal.images * stains(ideal.images.shape[1:], condition.stain, PATCH / told.mm_per_px, stain_rng)
    if condition.dark:
        images[0] = 0.0
    n = told.noise
    wells, read = n.full_well_e / condition.noise**2, n.read_noise_e / condition.noise
    images = sensor_noise(images, wells, read, n.bits, seed)
    jitter = depth_rng.normal(0.0, DEPTH_NOISE, ideal.depth.shape)
    depth = np.where(ideal.depth > 0, ideal.depth + jitter, 0.0).astype(np.float32)
    images = images[1:] if condition.missing else images
    return replace(ideal, images=images, depth=depth, sensor=told_sensor(condition)), list(truth[: len(T_bin_obj)])


def turned(L: Float[np.ndarray, "lights 3"], degrees: float, rng: np.random.Generator) -> Float[np.ndarray, "lights 3"]:
    """Each light turned by so much about a random axis across it."""
    if not degrees:
        return L
    axis = np.cross(L, rng.normal(size=L.shape))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    return Rotation.from_rotvec(np.radians(degrees) * axis).apply(L)


def stains(
    shape: tuple[int, ...], deviation: float, patch_px: float, rng: np.random.Generator
) -> Float[np.ndarray, "height width"]:
    """Factors of the albedo whose logs have this standard deviation, smooth over a patch."""
    if not deviation:
        return np.ones(shape, np.float32)
    smooth = gaussian_filter(rng.normal(size=shape), patch_px / 2.0)
    return np.exp(deviation * smooth / smooth.std()).astype(np.float32)


def plate_over(
    part: Part, T_bin_obj: Float[np.ndarray, "4 4"], sensor: Sensor, share: float, rng: np.random.Generator
) -> Placed:
    """A level plate above a part that covers this share of the pixels it shows alone, from a random side."""
    T_cam_bin = camera_above(sensor)
    T = T_cam_bin @ T_bin_obj
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle)
    alone = cast_apparent_shapes(
        mesh, T[:3, :3][None], T[:3, 3][None], sensor.camera, sensor.light_directions, sensor.slant_limit
    )
    v, u = np.nonzero(alone.face[0] >= 0)
    level = (part.vertices @ T[:3, :3].T + T[:3, 3])[:, 2].min() - ABOVE
    sight = sensor.camera.unproject(np.stack([u, v], axis=1).astype(float), np.full(len(u), level))
    angle = rng.uniform(0.0, 2.0 * np.pi)
    along, across = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([-np.sin(angle), np.cos(angle), 0.0])
    a, b = sight @ along, sight @ across
    low, edge = a.min() - RIM, np.quantile(a, share)
    size = edge - low, float(np.ptp(b)) + 2.0 * RIM
    R = np.stack([along, across, np.cross(along, across)], axis=1)
    T_cam_plate = np.eye(4)
    T_cam_plate[:3, :3] = R
    T_cam_plate[:3, 3] = low * along + (b.min() - RIM) * across + np.array([0.0, 0.0, level - THICK])
    plate = part_from_solid("plate", box((0.0, 0.0, 0.0), (*size, THICK), "plate"))
    return Placed(plate, np.linalg.inv(T_cam_bin) @ T_cam_plate)


def _ring(count: int) -> Float[np.ndarray, "lights 3"]:
    azimuth = np.radians(270.0) + 2.0 * np.pi * np.arange(count) / count
    sin, cos = np.sin(LIGHTS_OFF_AXIS), np.cos(LIGHTS_OFF_AXIS)
    return np.stack([sin * np.cos(azimuth), sin * np.sin(azimuth), np.full(count, -cos)], axis=1)


def scaled(sensor: Sensor, k: float) -> Sensor:
    """The same view in fewer or more pixels; the centre of the image stays."""
    c = sensor.camera
    width, height = round(c.width * k), round(c.height * k)
    kx, ky = width / c.width, height / c.height
    return replace(sensor, camera=replace(
        c, fx=c.fx * k, fy=c.fy * k, cx=(c.cx + 0.5) * kx - 0.5, cy=(c.cy + 0.5) * ky - 0.5, width=width, height=height
    ))  # fmt: skip
