"""Lambertian scenes whose normals are known in closed form."""

from collections.abc import Callable

import numpy as np
import pytest

SIZE = 64


def light_ring(count: int, off_axis: float = np.radians(35.0)) -> np.ndarray:
    """Unit directions toward `count` lights evenly around the optical axis."""
    azimuth = 2 * np.pi * np.arange(count) / count
    sin, cos = np.sin(off_axis), np.cos(off_axis)
    return np.stack([sin * np.cos(azimuth), sin * np.sin(azimuth), np.full(count, -cos)], axis=1)


def sphere_normals(size: int = SIZE) -> np.ndarray:
    """Normals of a sphere that fills an orthographic image; 0 outside it."""
    offset = (np.arange(size) - (size - 1) / 2) / (size / 2)
    x, y = np.meshgrid(offset, offset)
    inside = x**2 + y**2 < 1
    z = -np.sqrt(np.where(inside, 1 - x**2 - y**2, 0))
    return np.where(inside[..., None], np.stack([x, y, z], axis=-1), 0.0)


def lambert(normals: np.ndarray, L: np.ndarray, e: np.ndarray, albedo: np.ndarray | float = 0.6) -> np.ndarray:
    """Noise-free images [n, h, w] with attached shadows."""
    return e[:, None, None] * albedo * np.maximum(np.einsum("hwk,nk->nhw", normals, L), 0.0)


def angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle [rad] between unit vectors, accurate when small."""
    return 2 * np.arcsin(np.clip(np.linalg.norm(np.asarray(a, float) - b, axis=-1) / 2, 0, 1))


@pytest.fixture(scope="session")
def make_lights() -> Callable[..., np.ndarray]:
    return light_ring


@pytest.fixture(scope="session")
def sphere() -> np.ndarray:
    return sphere_normals()


@pytest.fixture(scope="session")
def shade() -> Callable[..., np.ndarray]:
    return lambert


@pytest.fixture(scope="session")
def angle_between() -> Callable[..., np.ndarray]:
    return angle
