"""Windows whose original face is known in closed form."""

from collections.abc import Callable

import numpy as np
import pytest

from itree_jax.features.window import Window

Indicator = Callable[[np.ndarray, np.ndarray], np.ndarray]


def face_window(indicator: Indicator, p: float, q: float, pitch: float = 1.0, size: int = 64) -> Window:
    """The region of a plane face of gradient (p, q): pixels whose point on the face satisfies `indicator(x', y')`.

    The face coordinates are taken from the 3-D point (x, y, p x + q y), not from T.
    """
    offset = (np.arange(size) - (size - 1) / 2) * pitch
    x, y = np.meshgrid(offset, offset)
    X = np.stack([x, y, p * x + q * y], axis=-1)
    normal = np.array([p, q, -1.0]) / np.sqrt(1 + p**2 + q**2)
    e1 = np.array([1.0, 0.0, p]) / np.sqrt(1 + p**2)
    e2 = np.cross(e1, normal)  # x right, y down, z away: e1 x e2 points away from the viewer
    e2 = e2 if e2[1] > 0 else -e2
    mask = indicator(X @ e1, X @ e2)
    normals = np.where(mask[..., None], normal, 0.0).astype(np.float32)
    return Window(mask, normals, np.float32(pitch))


@pytest.fixture(scope="session")
def make_face_window() -> Callable[..., Window]:
    return face_window


Normals = Callable[[np.ndarray, np.ndarray], np.ndarray]


class Shapes:
    """Unit normals toward the viewer (z < 0) as functions of the image coordinates [mm], in closed form."""

    @staticmethod
    def plane(p: float, q: float) -> Normals:
        return lambda u, v: np.broadcast_to(np.array([p, q, -1.0]) / np.sqrt(1 + p**2 + q**2), (*u.shape, 3))

    @staticmethod
    def sphere(radius: float, sign: float = 1.0) -> Normals:
        """Its convex outside (sign 1) or its concave inside (-1)."""
        return lambda u, v: toward_viewer(sign * u / radius, sign * v / radius)

    @staticmethod
    def cylinder(radius: float, tilt: float = 0.0, sign: float = 1.0, facet: float = 0.0) -> Normals:
        """Axis along u, its far end tilted away from the viewer; `facet` [rad] makes normals constant on facets."""

        def normals(u: np.ndarray, v: np.ndarray) -> np.ndarray:
            turn = np.arcsin(np.clip(v / radius, -1, 1)) * sign
            turn = (np.floor(turn / facet) + 0.5) * facet if facet else turn
            upper, side = np.array([np.sin(tilt), 0, -np.cos(tilt)]), np.array([0.0, 1, 0])
            return np.cos(turn)[..., None] * upper + np.sin(turn)[..., None] * side

        return normals

    @staticmethod
    def neck(profile: float, centre: float) -> Normals:
        """A groove of circular profile turned about the u axis: the inner side of a torus, K < 0."""

        def normals(u: np.ndarray, v: np.ndarray) -> np.ndarray:
            lean = np.sqrt(np.maximum(profile**2 - u**2, 0)) / profile
            return toward_viewer(-u / profile, lean * v / (centre - profile * lean))

        return normals


def toward_viewer(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Unit normals with these components in the image plane."""
    return np.stack([x, y, -np.sqrt(np.maximum(1 - x**2 - y**2, 0))], axis=-1)


def surface_window(
    normals: Normals, inside: Indicator, roll: float = 0.0, pitch: float = 1.65, size: int = 48,
    slant_limit: float = np.radians(60.0), needle_std: float = 0.0,
) -> Window:
    """The region of a surface whose (u, v) axes are turned by `roll` in the image; noise of the needles on request."""
    offset = (np.arange(size) - (size - 1) / 2) * pitch
    x, y = np.meshgrid(offset, offset)
    c, s = np.cos(roll), np.sin(roll)
    u, v = c * x + s * y, c * y - s * x
    n = normals(u, v) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    mask = inside(u, v) & (-n[..., 2] > np.cos(slant_limit))
    n = n + np.random.default_rng(0).normal(size=n.shape) * needle_std
    n = n / np.linalg.norm(n, axis=-1, keepdims=True)
    return Window(mask, np.where(mask[..., None], n, 0.0).astype(np.float32), np.float32(pitch))


@pytest.fixture(scope="session")
def make_surface_window() -> Callable[..., Window]:
    return surface_window


@pytest.fixture(scope="session")
def shapes() -> type[Shapes]:
    return Shapes
