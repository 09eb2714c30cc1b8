"""Between the face frame of a region, its window and the image: pictures are drawn through the inverse of T."""

from dataclasses import dataclass
from functools import cached_property

import jax.numpy as jnp
import numpy as np
from itree_kernels.camera import Camera
from jaxtyping import Float

from itree_jax.features.rectify import face_axes, gradient_space


@dataclass(frozen=True)
class RegionFrame:
    """Where one region lies. Window coordinates are (x, y) [mm] from the window's centre, across the viewing ray."""

    T: Float[np.ndarray, "2 2"]  # image offsets [mm] to face coordinates [mm]
    centroid: Float[np.ndarray, "2"]  # mass centre in window coordinates
    alpha: float  # maximum inertia direction [rad] in face axes
    mean_normal: Float[np.ndarray, "3"]  # in the frame of the viewing ray
    R_ray_cam: Float[np.ndarray, "3 3"]
    centre_uv: Float[np.ndarray, "2"]  # image point of the window's centre [px]
    depth: float  # mean z [mm]
    pitch: float  # of a window pixel [mm]
    size: int  # of the window [px]
    camera: Camera

    @cached_property
    def centre_px(self) -> Float[np.ndarray, "2"]:
        """The mass centre in window pixels."""
        return self.centroid / self.pitch + (self.size - 1) / 2.0

    def face_to_window(self, xy: Float[np.ndarray, "*n 2"], turn: float = 0.0) -> Float[np.ndarray, "*n 2"]:
        """Points [mm] of the face frame, turned by `turn` [rad] beyond the maximum inertia direction."""
        c, s = np.cos(self.alpha + turn), np.sin(self.alpha + turn)
        on_face = np.asarray(xy, float) @ np.array([[c, s], [-s, c]])
        return np.linalg.solve(self.T, on_face[..., None])[..., 0] + self.centroid

    def pixels_to_window(self, ij: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        """Window pixels (x, y) to window coordinates [mm]."""
        return (np.asarray(ij, float) - (self.size - 1) / 2.0) * self.pitch

    def window_to_image(self, xy: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        """Image points (u, v) [px] of window coordinates, at the region's distance."""
        if self.camera.is_orthographic:
            return self.centre_uv + np.asarray(xy) * np.array([self.camera.fx, self.camera.fy])
        distance = self.depth / self.R_ray_cam[2, 2]
        X_ray = np.concatenate([np.asarray(xy, float), np.full((*np.shape(xy)[:-1], 1), distance)], axis=-1)
        return self.camera.project(X_ray @ self.R_ray_cam)

    def face_to_image(self, xy: Float[np.ndarray, "*n 2"], turn: float = 0.0) -> Float[np.ndarray, "*n 2"]:
        return self.window_to_image(self.face_to_window(xy, turn))

    def inertia_axes(self) -> Float[np.ndarray, "2 3"]:
        """3-D directions along and across the maximum inertia direction, in the frame of the viewing ray."""
        e1, e2 = (np.asarray(e) for e in face_axes(*gradient_space(jnp.asarray(self.mean_normal, jnp.float32))))
        c, s = np.cos(self.alpha), np.sin(self.alpha)
        return np.stack([c * e1 + s * e2, c * e2 - s * e1])
