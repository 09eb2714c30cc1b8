"""One pose rendered into the smallest window that holds it, at the scale of a picture."""

from dataclasses import dataclass

import numpy as np
from itree_kernels.apparent import cast_apparent_shapes
from itree_kernels.camera import Camera
from itree_kernels.mesh import RayMesh
from jaxtyping import Bool, Float, Int

MARGIN = 3  # [px] around the part, so that its silhouette is closed inside of the window
NO_LIGHT = np.array([[0.0, 0.0, -1.0]])  # rays toward lights are not needed here, and one is the least there may be


@dataclass(frozen=True)
class RenderedPose:
    """Pixel (i, j) of the window is pixel (i + top, j + left) of the image magnified by `scale`."""

    left: int
    top: int
    scale: float
    face: Int[np.ndarray, "h w"]  # component face, -1 where the part is missed
    depth: Float[np.ndarray, "h w"]  # z [mm], 0 where the part is missed
    normal: Float[np.ndarray, "h w 3"]  # camera frame, 0 where the part is missed

    @property
    def hit(self) -> Bool[np.ndarray, "h w"]:
        return self.face >= 0

    @property
    def window(self) -> tuple[slice, slice]:
        """Rows and columns of the magnified image."""
        height, width = self.face.shape
        return slice(self.top, self.top + height), slice(self.left, self.left + width)


def render_pose(
    mesh: RayMesh,
    R_cam_obj: Float[np.ndarray, "3 3"],
    t_cam_obj: Float[np.ndarray, "3"],
    camera: Camera,
    scale: float = 1.0,
) -> RenderedPose | None:
    """Casts the part at a pose [mm] as `camera` sees it, magnified by `scale`; None when it is not in the image."""
    X_cam = mesh.vertices.astype(float) @ np.asarray(R_cam_obj, float).T + t_cam_obj
    if X_cam[:, 2].min() <= 0.0:
        return None
    uv = (camera.project(X_cam) + 0.5) * scale - 0.5
    size = np.round(np.array([camera.width, camera.height]) * scale)
    low = np.maximum(np.floor(uv.min(axis=0)) - MARGIN, 0).astype(int)
    high = np.minimum(np.ceil(uv.max(axis=0)) + MARGIN + 1, size).astype(int)
    width, height = (high - low).tolist()
    if width <= 0 or height <= 0:
        return None
    u0, v0 = (low + 0.5) / scale - 0.5
    window = camera.cropped(float(u0), float(v0), width, height, 1.0 / scale)
    pose = np.asarray(R_cam_obj)[None], np.asarray(t_cam_obj)[None]
    shapes = cast_apparent_shapes(mesh, *pose, window, NO_LIGHT, np.pi / 2)
    rendered = RenderedPose(
        int(low[0]), int(low[1]), scale, shapes.face[0].astype(np.int32), shapes.depth[0], shapes.normal[0]
    )
    return rendered if rendered.hit.any() else None
