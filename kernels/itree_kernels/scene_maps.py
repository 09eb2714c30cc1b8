"""What a camera saw, as the kernels read it."""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from jaxtyping import Float

from itree_kernels.camera import Camera


@wp.struct
class SceneMaps:
    """Maps of one image. Depth is 0 where there is none, a needle's weight where it is uninterpretable; less than 0
    where what is seen is told to be no part's.
    """

    depth: wp.array2d(dtype=float)  # z [mm]
    normals: wp.array2d(dtype=wp.vec3)  # camera frame
    needle_weight: wp.array2d(dtype=float)  # 0..1
    edge_label: wp.array2d(dtype=int)  # nearest observed edge point of each half pixel
    edge_uv: wp.array(dtype=wp.vec2)  # [px]
    edge_normal: wp.array(dtype=wp.vec2)  # unit, from the near to the far side
    edge_depth: wp.array(dtype=float)  # z of the near side [mm], 0 where unknown
    shading: wp.array3d(dtype=float)  # [row, column, light]: n . l on a lit Lambertian surface; may have no lights
    lights: wp.array(dtype=wp.vec3)  # directions, camera frame


@dataclass(frozen=True, eq=False)
class SeenBy:
    """A camera with its maps. X_camera = R X_first + t [mm] leads to it from the frame that poses are told in."""

    maps: Any  # SceneMaps
    camera: Camera
    R_camera_first: Float[np.ndarray, "3 3"]
    t_camera_first: Float[np.ndarray, "3"]


def scene_maps(
    depth: np.ndarray, normals: np.ndarray, needle_weight: np.ndarray, edge_label: np.ndarray, edge_uv: np.ndarray,
    edge_normal: np.ndarray, edge_depth: np.ndarray, shading: np.ndarray, lights: np.ndarray, device: str,
) -> Any:
    """The maps on `device`. On the CPU nothing is copied: keep the arrays alive."""
    maps = SceneMaps()
    for name, array, kind in (
        ("depth", depth, wp.float32), ("normals", normals, wp.vec3), ("needle_weight", needle_weight, wp.float32),
        ("edge_label", edge_label, wp.int32), ("edge_uv", edge_uv, wp.vec2), ("edge_normal", edge_normal, wp.vec2),
        ("edge_depth", edge_depth, wp.float32), ("shading", shading, wp.float32), ("lights", lights, wp.vec3),
    ):  # fmt: skip
        setattr(maps, name, on_device(array, kind, device))
    return maps


def on_device(array: np.ndarray, kind: Any, device: str) -> wp.array:
    """A NumPy array whose last axis holds the components of `kind`."""
    scalar = np.int32 if kind is wp.int32 else np.float32
    return wp.array(np.ascontiguousarray(array, scalar), dtype=kind, device=device, copy=False)
