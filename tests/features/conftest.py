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
