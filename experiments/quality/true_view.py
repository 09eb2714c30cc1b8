"""Where the instances of a scene truly lie: which one each pixel, each region and each answer belongs to."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.mesh import RayMesh
from jaxtyping import Float, Int

from itree_jax.evaluation.truth import SceneTruth
from itree_jax.report.pose_render import RenderedPose, render_pose

BEHIND = 1.5  # [mm] that something must be nearer by to hide a pose: depth's noise, and a pose a little off
ON_INSTANCE = 0.5  # of a region's pixels: more than half of it lies on the instance that it belongs to
LEAST_PIECE = 0.03  # of an instance's pixels: less is the rim of a neighbour's region


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


def shares_on_instances(
    poses: Sequence[RenderedPose | None], view: TrueView
) -> Float[np.ndarray, "poses instances"]:
    """Of what each pose would show in front of the true ones, the share that lies on each instance."""
    count = len(view.rendered)
    shares = np.zeros((len(poses), count))
    for k, pose in enumerate(poses):
        if pose is not None:
            shown = pose.hit & (pose.depth - BEHIND < view.depth[pose.window])
            on = view.instance[pose.window][shown]
            shares[k] = np.bincount(on[on >= 0], minlength=count) / max(1, len(on))
    return shares


class Piece(NamedTuple):
    """What of a region lies on one instance [px]."""

    region: int
    on_instance: int
    whole: int  # the region


def pieces_on(
    labels: Int[np.ndarray, "height width"], instance: Int[np.ndarray, "height width"], j: int
) -> list[Piece]:
    """The regions on instance `j`, the largest piece first."""
    on = labels[instance == j]
    pieces = [Piece(int(r), int((on == r).sum()), int((labels == r).sum())) for r in np.unique(on[on >= 0])]
    return sorted((p for p in pieces if p.on_instance > LEAST_PIECE * len(on)), key=lambda p: -p.on_instance)


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
