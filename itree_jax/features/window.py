"""A region as the features see it: a small square at a fixed metric pitch, seen along the region's viewing ray.

A rendered model view is an image like any other, so model and image regions pass through the same function.
"""

from typing import NamedTuple

import numpy as np
from itree_kernels.camera import Camera
from jax.typing import ArrayLike
from jaxtyping import Float, Int


class Window(NamedTuple):
    """One region (or, with a leading axis on every field, a batch of them)."""

    mask: ArrayLike  # bool [s, s], True on the region
    normals: ArrayLike  # float32 [s, s, 3], unit, toward the viewer (z < 0), viewing-ray frame; 0 where mask is False
    pitch: ArrayLike  # float32 [], size of a pixel [mm] on the plane that faces the viewer


def extract_windows(
    labels: Int[np.ndarray, "h w"],
    normals: Float[np.ndarray, "h w 3"],
    region_ids: Int[np.ndarray, "r"],
    centre_uv: Float[np.ndarray, "r 2"],
    mean_depth: Float[np.ndarray, "r"],
    camera: Camera,
    pitch_mm: float,
    size: int,
) -> tuple[Window, Float[np.ndarray, "r 3 3"]]:
    """Resample regions (nearest pixel) into windows of `size` x `size` pixels of `pitch_mm`, centred on `centre_uv`.

    The window is what a camera turned to look along the region's viewing ray would see, at the region's distance; with
    an orthographic camera it is a plain rescaling of the image.

    Args:
        labels: region id per pixel.
        normals: camera frame, unit, toward the camera.
        region_ids: the regions wanted.
        centre_uv: their centroids (u, v) [px].
        mean_depth: their mean depth z [mm]; ignored by an orthographic camera.
        camera: the camera of `labels`.
        pitch_mm: size of a window pixel [mm].
        size: side of the window [px]; what falls outside the window or the image is cut off.

    Returns:
        The windows (leading axis r) and `R_ray_cam` [r, 3, 3], the smallest rotation that takes each viewing ray to +z.
    """
    R_ray_cam = smallest_rotation_to_z(camera.viewing_ray(np.asarray(centre_uv, dtype=float)))
    u, v = _sample_points(centre_uv, mean_depth, camera, R_ray_cam, pitch_mm, size)
    height, width = labels.shape
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    u, v = np.where(inside, u, 0), np.where(inside, v, 0)
    mask = inside & (labels[v, u] == np.asarray(region_ids)[:, None, None])
    rotated = np.einsum("rij,rabj->rabi", R_ray_cam, normals[v, u])
    window_normals = np.where(mask[..., None], rotated, 0.0).astype(np.float32)
    pitch = np.full(len(mask), pitch_mm, dtype=np.float32)
    return Window(mask, window_normals, pitch), R_ray_cam


def extract_images(
    images: Float[np.ndarray, "lights h w"],
    centre_uv: Float[np.ndarray, "r 2"],
    mean_depth: Float[np.ndarray, "r"],
    camera: Camera,
    pitch_mm: float,
    size: int,
) -> Float[np.ndarray, "r lights size size"]:
    """Lit images in the windows of `extract_windows`, whatever lies there; dark outside of the image."""
    R_ray_cam = smallest_rotation_to_z(camera.viewing_ray(np.asarray(centre_uv, dtype=float)))
    u, v = _sample_points(centre_uv, mean_depth, camera, R_ray_cam, pitch_mm, size)
    height, width = images.shape[-2:]
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    seen = images[:, np.where(inside, v, 0), np.where(inside, u, 0)]
    return np.moveaxis(np.where(inside, seen, 0.0), 0, 1).astype(np.float32)


def smallest_rotation_to_z(ray: Float[np.ndarray, "*r 3"]) -> Float[np.ndarray, "*r 3 3"]:
    """The rotation of smallest angle that takes unit vector `ray` (z > 0) to +z; exactly the identity for +z."""
    x, y, z = np.moveaxis(np.asarray(ray, dtype=float), -1, 0)
    k = 1.0 / (1.0 + z)
    rows = [[1.0 - k * x * x, -k * x * y, -x], [-k * x * y, 1.0 - k * y * y, -y], [x, y, z]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _sample_points(
    centre_uv: Float[np.ndarray, "r 2"],
    mean_depth: Float[np.ndarray, "r"],
    camera: Camera,
    R_ray_cam: Float[np.ndarray, "r 3 3"],
    pitch_mm: float,
    size: int,
) -> tuple[Int[np.ndarray, "r s s"], Int[np.ndarray, "r s s"]]:
    """Image pixel (u, v) of every window pixel."""
    offset = (np.arange(size) - (size - 1) / 2.0) * pitch_mm
    y, x = np.meshgrid(offset, offset, indexing="ij")
    if camera.is_orthographic:
        u = centre_uv[:, 0, None, None] + camera.fx * x
        v = centre_uv[:, 1, None, None] + camera.fy * y
    else:
        distance = np.asarray(mean_depth, dtype=float) / R_ray_cam[:, 2, 2]  # along the ray, from depth along z
        X_ray = np.stack(np.broadcast_arrays(x, y, distance[:, None, None]), axis=-1)
        uv = camera.project(np.einsum("rji,rabj->rabi", R_ray_cam, X_ray))
        u, v = uv[..., 0], uv[..., 1]
    # Half a pixel up from a whole number belongs to the next pixel: floor(x + 1/2), not NumPy's round to even.
    return np.floor(u + 0.5).astype(np.int64), np.floor(v + 0.5).astype(np.int64)
