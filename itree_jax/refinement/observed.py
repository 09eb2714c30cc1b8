"""What the scene measured, laid out for refinement and verification: needles, depth, and the occluding edges."""

from typing import NamedTuple

import cv2
import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.scene_maps import SeenBy, scene_maps
from itree_kernels.warp_start import warp_device
from jaxtyping import Float, Int

from itree_jax.batches import multiple_above
from itree_jax.kept_functions import on_device
from itree_jax.sensing.edges import EdgeLabel, SceneEdges
from itree_jax.sensing.needle import Array

NO_PART = -1.0
EDGE_TABLE = 8192  # edge points are padded to a multiple of this, so that few shapes are compiled
STEP = 512  # [px]: maps are filled up to multiples of it, so that images of all sizes are compiled for few
EDGE_DEPTH_REACH = 3  # [px]: an edge's own pixels mix two surfaces, and needles end there
EDGE_NORMAL_SMOOTHING = 2.0  # [px] a contour's direction is averaged over so much (pixel steps are 90 degrees)


class ObservedMaps(NamedTuple):
    """Arrays of one image. Depth is 0 where there is none; normals are 0 where uninterpretable."""

    depth: Float[Array, "height width"]  # z [mm]
    normals: Float[Array, "height width 3"]  # camera frame
    needle_weight: Float[Array, "height width"]  # 0..1, 0 where uninterpretable; `NO_PART`: told to be no part's
    edge_label: Int[Array, "height2 width2"]  # nearest occluding edge point of each half pixel
    edge_uv: Float[Array, "edges 2"]  # [px]
    edge_normal: Float[Array, "edges 2"]  # unit, from the near to the far side
    edge_depth: Float[Array, "edges"]  # z of the near side [mm], 0 where unknown
    # Intensity over the strength of the light and the parts' albedo: n . l on a lit Lambertian surface. No lights until
    # they are put in: a depth camera has none.
    shading: Float[Array, "height width lights"]
    light_directions: Float[Array, "lights 3"]  # camera frame


class CameraArrays(NamedTuple):
    """A camera as numbers that a compiled function takes, so that another camera compiles nothing anew."""

    fx: Float[Array, ""]
    fy: Float[Array, ""]
    cx: Float[Array, ""]
    cy: Float[Array, ""]
    pinhole: Float[Array, ""]  # 1 pinhole, 0 orthographic


def camera_arrays(camera: Camera) -> CameraArrays:
    values = (camera.fx, camera.fy, camera.cx, camera.cy, 0.0 if camera.is_orthographic else 1.0)
    return CameraArrays(*(np.asarray(v, np.float32) for v in values))


def seen_by(
    observed: ObservedMaps | SeenBy, camera: Camera, R_camera_first: Float[np.ndarray, "3 3"] | None = None,
    t_camera_first: Float[np.ndarray, "3"] | None = None,
) -> SeenBy:
    """The maps as the kernels read them. The rotation and the translation [mm] lead from the frame that poses are told
    in to the camera's; None: it is the same one. Maps that were laid out so before are taken as they are.
    """
    if isinstance(observed, SeenBy):
        return observed
    arrays = (np.asarray(a) for a in observed)
    R = np.eye(3) if R_camera_first is None else np.asarray(R_camera_first, float)
    t = np.zeros(3) if t_camera_first is None else np.asarray(t_camera_first, float)
    return SeenBy(scene_maps(*arrays, device=warp_device()), camera, R, t)


def filled_up(observed: ObservedMaps) -> ObservedMaps:
    """The maps with nothing below them and to their right; without shading, which is not asked for."""
    height, width = observed.depth.shape
    below, beside = multiple_above(height, STEP) - height, multiple_above(width, STEP) - width
    if not (below or beside or observed.shading.size):
        return observed

    def with_nothing(values: Array) -> np.ndarray:
        return np.pad(np.asarray(values), [(0, below), (0, beside), *[(0, 0)] * (values.ndim - 2)])

    nowhere = len(observed.edge_uv) - 1  # the table is filled up with edges far away
    label = np.pad(np.asarray(observed.edge_label), [(0, 2 * below), (0, 2 * beside)], constant_values=nowhere)
    depth, normals, weight = map(with_nothing, (observed.depth, observed.normals, observed.needle_weight))
    return observed._replace(
        depth=on_device(depth), normals=on_device(normals), needle_weight=on_device(weight),
        edge_label=on_device(label), shading=on_device(np.zeros((0, 0, 0), np.float32)),
    )  # fmt: skip


def occluding_edges(
    depth: Float[np.ndarray, "height width"], jump: float
) -> tuple[Float[np.ndarray, "edges 2"], Float[np.ndarray, "edges 2"], Float[np.ndarray, "edges"]]:
    """Half-pixel points (u, v) [px] where depth steps by more than `jump` [mm], their directions and near depths.

    The direction points from the near to the far side, in the image.
    """
    height, width = depth.shape
    known = depth > 0
    toward = np.zeros((height, width, 2), np.float32)
    points = []
    for axis in (1, 0):
        a, b = (depth[:, :-1], depth[:, 1:]) if axis == 1 else (depth[:-1], depth[1:])
        both = (known[:, :-1] & known[:, 1:]) if axis == 1 else (known[:-1] & known[1:])
        step = b - a
        i, j = np.nonzero(both & (np.abs(step) > jump))
        sign = np.sign(step[i, j])
        component = 0 if axis == 1 else 1
        np.add.at(toward[..., component], (i, j), sign)
        offset = np.array([0.5, 0.0]) if axis == 1 else np.array([0.0, 0.5])
        points.append((np.stack([j, i], axis=-1) + offset, np.minimum(a[i, j], b[i, j]), i, j))
    smooth = cv2.GaussianBlur(toward, (0, 0), EDGE_NORMAL_SMOOTHING)
    uv = np.concatenate([p[0] for p in points])
    near = np.concatenate([p[1] for p in points])
    direction = np.concatenate([smooth[p[2], p[3]] for p in points])
    length = np.linalg.norm(direction, axis=-1, keepdims=True)
    keep = length[:, 0] > 1e-6
    return uv[keep], (direction / np.maximum(length, 1e-6))[keep], near[keep]


def observe(
    normals: Float[np.ndarray, "height width 3"],
    needle_weight: Float[np.ndarray, "height width"],
    depth: Float[np.ndarray, "height width"],
    jump: float,
) -> ObservedMaps:
    """Prepares one image. `jump` [mm]: the least depth step that counts as an occluding edge."""
    return _with_edges(normals, needle_weight, depth, *occluding_edges(depth, jump))


def observe_with_edges(
    normals: Float[np.ndarray, "height width 3"],
    needle_weight: Float[np.ndarray, "height width"],
    depth: Float[np.ndarray, "height width"],
    edges: SceneEdges,
) -> ObservedMaps:
    """Prepares one image whose edges come from its intensities: outlines and creases, no shadows.

    The depth of an edge is that of what is known nearest around it; 0, unknown, where
    nothing is.
    """
    edges = edges.of(EdgeLabel.OUTLINE, EdgeLabel.CREASE, EdgeLabel.GEOMETRIC)
    height, width = depth.shape
    u, v = np.clip(np.round(edges.uv).astype(int), 0, (width - 1, height - 1)).T
    side = 2 * EDGE_DEPTH_REACH + 1
    near = cv2.erode(np.where(depth > 0, depth, np.float32(np.inf)).astype(np.float32), np.ones((side, side)))[v, u]
    return _with_edges(normals, needle_weight, depth, edges.uv, edges.direction, np.where(np.isfinite(near), near, 0.0))


def _with_edges(
    normals: np.ndarray, needle_weight: np.ndarray, depth: np.ndarray, uv: Float[np.ndarray, "edges 2"],
    direction: Float[np.ndarray, "edges 2"], near: Float[np.ndarray, "edges"],
) -> ObservedMaps:
    height, width = depth.shape
    grid = np.full((2 * height, 2 * width), 255, np.uint8)
    half = np.clip(np.round(2 * uv).astype(int), 0, (2 * width - 1, 2 * height - 1))
    grid[half[:, 1], half[:, 0]] = 0
    count = len(uv)
    size = max(1, -(-count // EDGE_TABLE)) * EDGE_TABLE
    table = np.full((size, 5), 1e6, np.float32)
    label = np.zeros(grid.shape, np.int32)
    if count:
        labels = cv2.distanceTransformWithLabels(grid, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)[1]
        nearest = np.asarray(labels, np.int32)
        index_of = np.zeros(nearest.max() + 1, np.int32)
        index_of[nearest[half[:, 1], half[:, 0]]] = np.arange(count)
        label = index_of[nearest]
        table[:count] = np.concatenate([uv, direction, near[:, None]], axis=1)
    no_shading = np.zeros((height, width, 0)), np.zeros((0, 3))
    host = (depth, normals, needle_weight, label, table[:, :2], table[:, 2:4], table[:, 4], *no_shading)
    return ObservedMaps(*(on_device(one, np.int32 if one is label else np.float32) for one in host))
