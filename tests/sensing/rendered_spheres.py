"""Photographs of spheres by closed forms: where a ray meets the sphere, what it mirrors, how it is lit."""

from pathlib import Path

import cv2
import numpy as np
from itree_kernels.camera import Camera

from itree_jax.sensing.light_calibration.sphere import Sphere

SIZE = (320, 240)
PINHOLE = Camera("pinhole", 400.0, 400.0, 159.5, 119.5, *SIZE)
ORTHOGRAPHIC = Camera("orthographic", 2.0, 2.0, 150.0, 100.0, *SIZE)
# Off the axis, where a pinhole's outline is an ellipse; about 90 px of radius, as the other one.
BY_PINHOLE = Sphere(PINHOLE, np.array([25.0, -8.0, 170.0]), 36.0, 0.0)
BY_ORTHOGRAPHIC = Sphere(ORTHOGRAPHIC, np.array([8.3, 6.1, 0.0]), 44.7, 0.0)
LAMP = np.radians(3.0)  # radius of a lamp's glow in the mirror


def pixels(camera: Camera) -> np.ndarray:
    v, u = np.mgrid[: camera.height, : camera.width].astype(float)
    return np.stack([u, v], axis=-1)


def mask_of(sphere: Sphere) -> np.ndarray:
    return np.isfinite(sphere.at(pixels(sphere.camera))[0][..., 0])


def mirror(sphere: Sphere, directions: np.ndarray) -> np.ndarray:
    """Images of a mirror sphere under distant lamps: a saturated glow where a ray is mirrored into the lamp."""
    return near_mirror(sphere, 1e9 * directions)


def near_mirror(sphere: Sphere, positions: np.ndarray) -> np.ndarray:
    """Images of a mirror sphere under lamps at `positions`."""
    X, normal, sight = sphere.at(pixels(sphere.camera))
    mirrored = sight - 2 * (sight * normal).sum(-1, keepdims=True) * normal
    away = positions - X[..., None, :]
    toward = away / np.linalg.norm(away, axis=-1, keepdims=True)
    apart = np.arccos(np.clip((mirrored[..., None, :] * toward).sum(-1), -1, 1))
    glow = 3.0 * np.exp(-0.5 * (apart / LAMP) ** 2)
    return np.moveaxis(np.clip(np.nan_to_num(glow), 0.0, 1.0), -1, 0).astype(np.float32)


def matte(sphere: Sphere, directions: np.ndarray, strengths: np.ndarray) -> np.ndarray:
    """Images of a Lambertian sphere under distant lights."""
    _, normal, _ = sphere.at(pixels(sphere.camera))
    shade = strengths * np.maximum(normal @ directions.T, 0.0)
    return np.moveaxis(np.nan_to_num(shade), -1, 0).astype(np.float32)


def near_matte(sphere: Sphere, positions: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Images of a Lambertian sphere under point lights: own n . (p - X) / |p - X|^3."""
    X, normal, _ = sphere.at(pixels(sphere.camera))
    away = positions - X[..., None, :]
    shade = own * np.maximum((normal[..., None, :] * away).sum(-1), 0.0) / np.linalg.norm(away, axis=-1) ** 3
    return np.moveaxis(np.nan_to_num(shade), -1, 0).astype(np.float32)


def degrees_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.degrees(2 * np.arcsin(np.clip(np.linalg.norm(np.asarray(a, float) - b, axis=-1) / 2, 0, 1)))


def write_photographs(folder: Path, images: np.ndarray, mask: np.ndarray | None = None, colour: bool = False) -> Path:
    """16-bit PNG without leading zeros in their numbers, and mask.png."""
    folder.mkdir(parents=True)
    for k, image in enumerate(images):
        stored = np.round(65535 * image).astype(np.uint16)
        cv2.imwrite(str(folder / f"photo.{k}.png"), np.stack([stored] * 3, -1) if colour else stored)
    if mask is not None:
        cv2.imwrite(str(folder / "mask.png"), mask.astype(np.uint8) * 255)
    return folder
