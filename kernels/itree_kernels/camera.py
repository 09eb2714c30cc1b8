"""The two cameras: orthographic, as in the paper, and pinhole.

Camera frame as in OpenCV and BOP: x right, y down, z forward. Pixel centres lie at integers.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Camera:
    """An ideal (undistorted) camera.

    Pinhole: `u = fx X/Z + cx` with `fx, fy` in [px]. Orthographic: `u = fx X + cx` with `fx, fy` in [px/mm].
    """

    kind: Literal["orthographic", "pinhole"]
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    @property
    def is_orthographic(self) -> bool:
        return self.kind == "orthographic"

    def mm_per_px(self, depth: float) -> float:
        """Size of a pixel [mm] on a plane that faces the camera at `depth` [mm]."""
        return (1.0 if self.is_orthographic else depth) / float(np.sqrt(self.fx * self.fy))

    def project(self, X_cam: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 2"]:
        """Image points (u, v) [px] of points [mm] in the camera frame."""
        z = np.ones_like(X_cam[..., 2]) if self.is_orthographic else X_cam[..., 2]
        return np.stack([self.fx * X_cam[..., 0] / z + self.cx, self.fy * X_cam[..., 1] / z + self.cy], axis=-1)

    def unproject(self, uv: Float[np.ndarray, "*n 2"], depth: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 3"]:
        """Points [mm] in the camera frame at image points (u, v) [px] and depth z [mm]."""
        scale = np.ones_like(depth) if self.is_orthographic else depth
        x = (uv[..., 0] - self.cx) / self.fx * scale
        y = (uv[..., 1] - self.cy) / self.fy * scale
        return np.stack([x, y, depth], axis=-1)

    def viewing_ray(self, uv: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 3"]:
        """Unit direction of sight at image points (u, v) [px], away from the camera."""
        if self.is_orthographic:
            return np.broadcast_to(np.array([0.0, 0.0, 1.0]), (*np.shape(uv)[:-1], 3)).copy()
        ray = np.stack(
            [(uv[..., 0] - self.cx) / self.fx, (uv[..., 1] - self.cy) / self.fy, np.ones(np.shape(uv)[:-1])], axis=-1
        )
        return ray / np.linalg.norm(ray, axis=-1, keepdims=True)

    def cropped(self, u0: float, v0: float, width: int, height: int, stride: float = 1.0) -> "Camera":
        """The camera of a window whose pixel (0, 0) is image point (u0, v0), every `stride` pixels."""
        return Camera(self.kind, self.fx / stride, self.fy / stride, (self.cx - u0) / stride, (self.cy - v0) / stride,
                      width, height)
