"""Scenes that two cameras see, rendered with the truth of both."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.instances import Material
from itree_kernels.lit_scene import LitScene, render_scene
from itree_kernels.mesh import RayMesh, ray_mesh
from itree_kernels.noise import sensor_noise
from scipy.spatial.transform import Rotation

from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensor import Sensor
from itree_jax.stereo.second_camera import SecondCamera

FINE = 3  # rays across a pixel: cameras have no stairs
FOCAL, DISTANCE, BASELINE = 1815.0, 900.0, 120.0  # of the bench: a pixel is half a millimetre, and 3.7 mm of disparity
CAMERA = Camera("pinhole", FOCAL, FOCAL, 99.5, 79.5, 200, 160)
# Parallel to it and 120 mm to the right, its sensor shifted so that both see the same place of the floor.
SHIFTED = replace(CAMERA, cx=CAMERA.cx + FOCAL * BASELINE / DISTANCE)
PARALLEL, ASIDE = np.eye(3), np.array([-BASELINE, 0.0, 0.0])


class TwoViews(NamedTuple):
    images: np.ndarray
    sensor: Sensor
    second: SecondCamera
    lit: LitScene  # what the first camera sees, one ray a pixel
    lit_second: LitScene


def converging() -> tuple[np.ndarray, np.ndarray]:
    """Rotation and translation of a second camera 120 mm aside that looks at the same point, rolled a little."""
    turn = Rotation.from_euler("yxz", [np.degrees(np.arctan2(BASELINE, DISTANCE)), -0.6, 1.0], degrees=True)
    R_second_first = turn.as_matrix()
    centre = np.array([BASELINE, -8.0, 5.0])  # of the second camera, in the first one's frame
    return R_second_first, -R_second_first @ centre


def sensor_with(camera: Camera) -> Sensor:
    return replace(bundled_sensor("bench"), camera=camera, light_intensities=np.array([0.95, 1.0, 1.05]))


def second_of(images: np.ndarray, camera: Camera, R: np.ndarray, t: np.ndarray) -> SecondCamera:
    return SecondCamera(images, sensor_with(camera), R, t).with_lights_of(sensor_with(CAMERA))


def two_views(
    meshes: list[RayMesh], R: np.ndarray, t: np.ndarray, material: Material, camera_2: Camera = SHIFTED, R_2=PARALLEL,
    t_2=ASIDE, seed: int | None = None,
) -> TwoViews:  # fmt: skip
    """Mesh k at pose k of the first camera's frame; with noise if there is a seed for it."""
    sensor = sensor_with(CAMERA)
    second = second_of(np.zeros((3, camera_2.height, camera_2.width)), camera_2, R_2, t_2)
    images, lit = _photographs(meshes, R, t, sensor, material, seed)
    seed_2 = None if seed is None else seed + 1
    images_2, lit_2 = _photographs(meshes, R_2 @ R, t @ R_2.T + t_2, second.sensor, material, seed_2)
    return TwoViews(images, sensor, replace(second, images=images_2), lit, lit_2)


def _photographs(meshes, R, t, sensor: Sensor, material: Material, seed: int | None) -> tuple[np.ndarray, LitScene]:
    camera, offset = sensor.camera, -(FINE - 1) / (2 * FINE)
    fine = camera.cropped(offset, offset, camera.width * FINE, camera.height * FINE, 1.0 / FINE)
    which, light = list(range(len(meshes))), (sensor.light_directions, sensor.light_intensities, material)
    images = render_scene(meshes, which, R, t, fine, *light).images
    images = images.reshape(len(images), camera.height, FINE, camera.width, FINE).mean(axis=(2, 4))
    if seed is not None:
        images = sensor_noise(images, 12000.0, 6.0, 12, seed)
    return images.astype(np.float32), render_scene(meshes, which, R, t, camera, *light)


def as_mesh(solid) -> RayMesh:
    return ray_mesh(solid.vertices, solid.faces, np.zeros(len(solid.faces), np.int32), device="cpu")


def rays(camera: Camera) -> np.ndarray:
    """Viewing rays with z = 1 of every pixel [h, w, 3]."""
    v, u = np.indices((camera.height, camera.width)).astype(float)
    return camera.unproject(np.stack([u, v], axis=-1), np.ones(u.shape))


def plane_depth(camera: Camera, normal: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Depth [mm] of a plane at every pixel."""
    return (normal @ point) / (rays(camera) @ normal)
