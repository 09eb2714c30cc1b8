"""What a scene shows where its instances truly lie: which instance each pixel and each region belongs to."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.mesh import RayMesh
from jaxtyping import Float, Int

from itree_jax.evaluation.truth import SceneTruth
from itree_jax.report.pose_render import RenderedPose, render_pose

ON_INSTANCE = 0.5  # of a region's pixels: more than half of it lies on the instance that it belongs to


@dataclass(frozen=True)
class TrueView:
    """The true poses of a scene as its camera sees them."""

    rendered: tuple[RenderedPose | None, ...]  # at scale 1; None outside of the image
    instance: Int[np.ndarray, "height width"]  # in front at each pixel, -1 none
    depth: Float[np.ndarray, "height width"]  # z [mm] of it, inf where there is none


def true_view(truth: SceneTruth, meshes: Mapping[int, RayMesh]) -> TrueView:
    """Casts every instance at its true pose; the nearest one is seen. `meshes` by obj_id."""
    rendered = tuple(
        render_pose(meshes[int(o)], R, t, truth.camera) for o, R, t in zip(truth.obj_id, *truth.pose, strict=True)
    )
    return TrueView(rendered, *in_front(rendered, truth.camera))


def in_front(
    poses: Sequence[RenderedPose | None], camera: Camera
) -> tuple[Int[np.ndarray, "height width"], Float[np.ndarray, "height width"]]:
    """Index of the nearest pose at each pixel, -1 none, and its z [mm], inf where there is none."""
    index = np.full((camera.height, camera.width), -1)
    depth = np.full((camera.height, camera.width), np.inf)
    for k, pose in enumerate(poses):
        if pose is not None:
            nearer = pose.hit & (pose.depth < depth[pose.window])
            index[pose.window][nearer] = k
            depth[pose.window][nearer] = pose.depth[nearer]
    return index, depth


def region_owners(
    labels: Int[np.ndarray, "height width"], instance: Int[np.ndarray, "height width"]
) -> Int[np.ndarray, "regions"]:
    """The instance that more than half of each region's pixels lie on, -1 none (of a region over two parts, say)."""
    count, instances = int(labels.max(initial=-1)) + 1, int(instance.max(initial=-1)) + 1
    if not count:
        return np.zeros(0, np.int64)
    inside = labels >= 0
    pairs = labels[inside] * (instances + 1) + instance[inside] + 1
    on = np.bincount(pairs, minlength=count * (instances + 1)).reshape(count, instances + 1)
    best = on[:, 1:].argmax(axis=1) if instances else np.zeros(count, np.int64)
    share = on[np.arange(count), best + 1] / on.sum(axis=1) if instances else np.zeros(count)
    return np.where(share > ON_INSTANCE, best, -1)
