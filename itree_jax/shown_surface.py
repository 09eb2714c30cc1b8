"""What each view of the dome shows of a part: points of its surface, and which way they face.

A region is part of what a pose shows: the pose has to show a surface that faces as the region does and is no smaller.
The mean normal and the middle of that surface are those of the region, so that what an attitude of the dome leaves open
is a turn about the normal.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.correspond import correspondences
from jaxtyping import Bool, Float, Int

from itree_jax.open_attitudes import ROLLS, rolls, views
from itree_jax.refinement.optimise import RefineModel, window_origins, window_stride

SIZE = 24  # pixels across the window that samples a view
POINTS = 96  # of each view, to glance at a scene by
SAME_WAY = float(np.cos(np.radians(30.0)))  # an attitude is off by up to 15 degrees, and a curved region turns by more


@dataclass(frozen=True)
class ShownSurface:
    """Of every view of the dome, samples that each stand for the same area of the image; as many as the view needs that
    shows most, the last of the others' meet nothing.
    """

    X_ray: Float[np.ndarray, "views 3 samples"]  # from the part's origin [mm], in the ray's frame
    normal_ray: Float[np.ndarray, "views 3 samples"]  # 0 where a sample meets nothing
    sample_mm2: float  # across the line of sight

    @property
    def there(self) -> Bool[np.ndarray, "views samples"]:
        """Which samples meet the part."""
        return (self.normal_ray != 0.0).any(axis=1)


class DomePoints(NamedTuple):
    """Of every view of the dome, points of the surface that it shows, each for the same share of it."""

    X_obj: Float[np.ndarray, "views points 3"]  # [mm]
    normal_obj: Float[np.ndarray, "views points 3"]
    point_mm2: Float[np.ndarray, "views"]  # across the line of sight


def dome_points(shown: ShownSurface, count: int = POINTS) -> DomePoints:
    """Some of each view's samples, evenly over the image; fewer samples are taken more than once."""
    X_obj, normal_obj = (
        np.einsum("vba,vbs->vsa", views(), of).astype(np.float32) for of in (shown.X_ray, shown.normal_ray)
    )
    there = shown.there
    picked = np.stack([
        np.flatnonzero(one)[np.linspace(0, one.sum() - 1, count).round().astype(int)] if one.any() else np.zeros(
            count, int) for one in there
    ])  # fmt: skip
    return DomePoints(
        np.take_along_axis(X_obj, picked[..., None], axis=1), np.take_along_axis(normal_obj, picked[..., None], axis=1),
        there.sum(axis=1) * shown.sample_mm2 / count,
    )


def shown_surface(model: RefineModel, camera: Camera, distance: float) -> ShownSurface:
    """What the part shows at this distance [mm], in the middle of the image."""
    R = views().astype(np.float32)
    t = np.tile(np.array([0.0, 0.0, distance], np.float32), (len(R), 1))
    stride = window_stride(camera, model.reach, distance, SIZE)
    origin = window_origins(camera, t, SIZE, stride)
    seen = correspondences(model.mesh, R, t, camera, origin, SIZE, stride, model.reach)
    hit = (seen.triangle >= 0).reshape(len(R), -1)
    j, i = np.meshgrid(np.arange(SIZE), np.arange(SIZE))
    uv = origin[:, None, None] + stride * np.stack([j, i], axis=-1)
    X_cam = camera.unproject(uv, np.asarray(seen.depth, float)).reshape(len(R), -1, 3)
    normal_obj = model.mesh.triangle_normals[seen.triangle.reshape(len(R), -1)]
    normal_cam = np.einsum("vab,vsb->vsa", R, normal_obj)
    first = np.argsort(~hit, axis=1, kind="stable")[:, : hit.sum(axis=1).max()]

    def of_samples(values: np.ndarray) -> Float[np.ndarray, "views 3 samples"]:
        met = np.where(hit[..., None], values, 0.0).astype(np.float32)
        return np.ascontiguousarray(np.take_along_axis(met, first[..., None], axis=1).swapaxes(1, 2))

    return ShownSurface(
        of_samples(X_cam - t[:, None]), of_samples(normal_cam), (stride * camera.mm_per_px(distance)) ** 2
    )


def middle_of_all(shown: ShownSurface) -> Float[np.ndarray, "views_rolls 3"]:
    """Of each of `all_attitudes`, the middle of what it shows, from the part's origin [mm], in the ray's frame."""
    mean = _mean(shown.X_ray, shown.there[:, None])
    return np.einsum("kab,vkb->vka", rolls(), np.broadcast_to(mean, (len(mean), len(rolls()), 3))).reshape(-1, 3)


class Facing(NamedTuple):
    """Of each of `all_attitudes`, what it shows that faces one way; in the ray's frame."""

    middle: Float[np.ndarray, "views_rolls 3"]  # from the part's origin [mm]
    normal: Float[np.ndarray, "views_rolls 3"]  # unit, the mean; the way itself where it shows none
    area: Float[np.ndarray, "views_rolls"]  # across the line of sight [mm^2]


def facing(shown: ShownSurface, way_ray: Float[np.ndarray, "3"]) -> Facing:
    """What faces this way, to `SAME_WAY`."""
    before_roll = (way_ray @ rolls()).astype(np.float32)  # the way that it has to face before the attitude is rolled
    this_way = before_roll @ shown.normal_ray > SAME_WAY
    middle, normal = (np.einsum("kab,vkb->vka", rolls(), _mean(of, this_way)) for of in (shown.X_ray, shown.normal_ray))
    area = this_way.sum(axis=-1) * shown.sample_mm2
    normal = np.where(area[..., None] > 0.0, normal, way_ray)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return Facing(middle.reshape(-1, 3), normal.reshape(-1, 3), area.reshape(-1))


def ends(
    shown: ShownSurface, way_ray: Float[np.ndarray, "3"], kept: Int[np.ndarray, "kept"],
    R: Float[np.ndarray, "kept 3 3"],
) -> Float[np.ndarray, "kept 2 2"]:
    """Where what faces this way ends: the least and the greatest x and y [mm] from the part's origin, in the ray's
    frame, for some of `all_attitudes` turned by R. NaN where nothing does.
    """
    view, roll = np.divmod(kept, ROLLS)
    way = (way_ray @ rolls()).astype(np.float32)[roll]
    this_way = way[:, None] @ shown.normal_ray[view] > SAME_WAY
    xy = (R @ rolls()[roll])[:, :2].astype(np.float32) @ shown.X_ray[view]
    found = np.stack([
        np.where(this_way, xy, np.inf).min(axis=-1), np.where(this_way, xy, -np.inf).max(axis=-1),
    ], axis=1)  # fmt: skip
    return np.where(this_way.any(axis=-1, keepdims=True), found, np.nan)


def turns_onto(
    normal: Float[np.ndarray, "n 3"], way: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "n 3 3"]:
    """The least rotations that carry unit vectors onto another one, less than a half turn away."""
    axis = np.cross(normal, way)
    K = np.zeros((len(normal), 3, 3))
    K[:, [2, 0, 1], [1, 2, 0]] = axis
    K[:, [1, 2, 0], [2, 0, 1]] = -axis
    return np.eye(3) + K + K @ K / (1.0 + normal @ way)[:, None, None]


def _mean(
    values: Float[np.ndarray, "views 3 samples"], taken: Bool[np.ndarray, "views k samples"]
) -> Float[np.ndarray, "views k 3"]:
    total = taken.astype(np.float32) @ values.swapaxes(1, 2)
    return total / np.maximum(taken.sum(axis=-1), 1)[..., None]
