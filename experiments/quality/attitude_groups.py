"""Which attitude group a part truly shows, and which one its region was taken for.

Two readings of the confusion: of right answers, the group that the decision path named; of every region on an instance
visible by 70 % or more, the group that the classification part says first, and those that determination's candidates
left. A group is named by what is detectable at a view and roll; a bin cuts regions by shadows and other parts besides.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from itree_kernels.apparent import cast_apparent_shapes
from itree_kernels.camera import Camera
from itree_kernels.mesh import RayMesh
from jaxtyping import Bool, Float, Int

from itree_jax.evaluation.pose_errors import Pose
from itree_jax.evaluation.report import Rate
from itree_jax.features.window import smallest_rotation_to_z
from itree_jax.interpreting import attitudes_of
from itree_jax.prepared import Prepared
from itree_jax.region_measures import features_of, in_batches, measure_regions
from itree_jax.sight import Sight
from itree_jax.tree.appearances import face_areas, mesh_reach, window_camera
from itree_jax.tree.draws import BESIDE_REACH
from itree_jax.tree.groups import group_of_label
from itree_jax.tree.tree import InterpretationTree


class GroupPair(NamedTuple):
    """One region or answer."""

    true: int  # group of the true pose
    named: int  # group that it was taken for
    left: bool  # whether the true group was still there after the tree
    left_count: int  # groups that were


@dataclass(frozen=True)
class GroupConfusion:
    """How often each true group was taken for each."""

    counts: Int[np.ndarray, "groups groups"]  # rows: true; columns: named
    first: Rate  # pairs whose true group is the one named
    left: Rate  # pairs whose true group is among those left
    left_count: float | None  # mean number of groups left; None without a pair

    @property
    def used(self) -> Int[np.ndarray, "used"]:
        """Groups that are true or named anywhere."""
        return np.flatnonzero(self.counts.sum(axis=0) + self.counts.sum(axis=1))


class RegionGroups(NamedTuple):
    """What the tree says of every region of a scene."""

    first: Int[np.ndarray, "regions"]  # the likeliest group that is not pruned
    left: Bool[np.ndarray, "regions groups"]  # groups of the candidate attitudes that go on to refinement


def group_confusion(pairs: Iterable[GroupPair], group_count: int) -> GroupConfusion:
    pairs = list(pairs)
    counts = np.zeros((group_count, group_count), np.int64)
    np.add.at(counts, ([p.true for p in pairs], [p.named for p in pairs]), 1)
    first, left = (Rate(int(sum(hits)), len(pairs)) for hits in (
        [p.true == p.named for p in pairs], [p.left for p in pairs],
    ))  # fmt: skip
    return GroupConfusion(counts, first, left, float(np.mean([p.left_count for p in pairs])) if pairs else None)


def true_groups(tree: InterpretationTree, mesh: RayMesh, poses: Pose, camera: Camera) -> Int[np.ndarray, "poses"]:
    """The attitude group that each pose shows, alone and whole, in the frame of its own viewing ray.

    As the compiler names the group of an appearance: by the detectable area of each face, up to the part's symmetries.
    """
    middle = np.einsum("nij,j->ni", poses.R, tree.part.vertices.mean(axis=0)) + poses.t
    R_ray_cam = smallest_rotation_to_z(camera.viewing_ray(camera.project(middle)))
    view, pitch = window_camera(mesh_reach(mesh))
    sensor = tree.sensor
    shapes = cast_apparent_shapes(
        mesh, R_ray_cam @ poses.R, np.zeros((len(poses.t), 3)), view, sensor.light_directions, sensor.slant_limit
    )
    return group_of_label(tree.groups, face_areas(shapes, mesh, pitch))


def region_groups(
    prepared: Prepared, images: Float[np.ndarray, "lights height width"], sight: Sight
) -> RegionGroups:
    """Reads all regions of a scene with one tree, as recognition does up to its candidate attitudes."""
    tree, found, sensor = prepared.tree, sight.found, sight.sensor
    if not found.count:
        return RegionGroups(np.zeros(0, np.int64), np.zeros((0, tree.groups.group_count), bool))
    measured = measure_regions(found, sight.needle, images, sensor, prepared.pitch)
    every = np.arange(found.count)
    features = features_of(measured, every, found, sensor, BESIDE_REACH * prepared.model.reach)
    classification, candidates = in_batches(partial(attitudes_of, prepared), features)
    kept = np.where(tree.groups.pruned, -np.inf, classification.group_log_probability)
    row, likelihood = candidates.row, candidates.log_likelihood
    group = tree.appearances.group[tree.appearances.attitude[row]]
    left = np.zeros(kept.shape, bool)
    region, place = np.nonzero(np.isfinite(likelihood))
    left[region, group[region, place]] = True
    return RegionGroups(kept.argmax(axis=1), left)
