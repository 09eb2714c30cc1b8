"""Poses beside the truth, where it is known: how far each lies from the nearest true pose of its part."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from itree_cad.symmetry import Symmetries
from itree_kernels.errors import ItreeError
from itree_kernels.json_file import read_json_object
from jaxtyping import Float
from scipy.spatial import ConvexHull

from itree_jax.detections import Detection
from itree_jax.evaluation.matching import match
from itree_jax.evaluation.pose_errors import Pose, mssd
from itree_jax.evaluation.symmetry import SymmetrySet, symmetry_set
from itree_jax.sensing.scene_folder import Scene
from itree_jax.tree.tree import InterpretationTree

RIGHT = 0.05  # of the diameter: a pose nearer than this (MSSD) to a true one is right, as `itree evaluate` counts

WORTH_FINDING = 0.7  # visible share of a part that should be found: as `itree evaluate` counts


class TruePose(NamedTuple):
    """Where an instance truly is; model -> camera."""

    obj_id: int
    R: Float[np.ndarray, "3 3"]
    t: Float[np.ndarray, "3"]  # [mm]
    visible: float = 1.0  # share of its pixels that nothing hides



@dataclass(frozen=True)
class Comparison:
    """MSSD [mm] of each detection to the nearest true pose (inf without one), and the true pose that it found."""

    error: Float[np.ndarray, "detections"]
    found: tuple[int, ...]  # index of the true pose within 5 % of the diameter, one to one by score; -1 none
    other_right: tuple[bool, ...]  # the answer is ambiguous and none of these, but one of its alternatives is right

    @property
    def wrong(self) -> int:
        """Answers that are neither right nor ambiguous with a right alternative."""
        return sum(k < 0 and not other for k, other in zip(self.found, self.other_right, strict=True))


def compare(
    detections: Sequence[Detection], truth: Sequence[TruePose], trees: Mapping[int, InterpretationTree]
) -> Comparison:
    """Symmetry-aware distances, and the one-to-one matching that `evaluate` uses."""
    errors = np.full((len(detections), len(truth)), np.inf)
    for obj_id, tree in trees.items():
        mine = [i for i, d in enumerate(detections) if d.obj_id == obj_id]
        true = [j for j, pose in enumerate(truth) if pose.obj_id == obj_id]
        if mine and true:
            errors[np.ix_(mine, true)] = distances([detections[i] for i in mine], [truth[j] for j in true], tree)
    diameter = np.array([trees[d.obj_id].part.diameter for d in detections], float)
    score = np.array([d.score for d in detections], float)
    found = match(errors / diameter[:, None], score, RIGHT)
    other = [k < 0 and alternative_right(d, truth, trees) for k, d in zip(found, detections, strict=True)]
    return Comparison(errors.min(axis=1, initial=np.inf), tuple(int(k) for k in found), tuple(other))


def alternative_right(
    detection: Detection, truth: Sequence[TruePose], trees: Mapping[int, InterpretationTree]
) -> bool:
    """Whether an answer that the scene doesn't tell from others has a right one among these."""
    true = [pose for pose in truth if pose.obj_id == detection.obj_id]
    if not detection.ambiguous or not true:
        return False
    tree = trees[detection.obj_id]
    others = [
        replace(detection, R_cam_obj=a.T_cam_obj[:3, :3], t_cam_obj=a.T_cam_obj[:3, 3])
        for a in detection.alternatives
    ]  # fmt: skip
    return bool(distances(others, true, tree).min() < RIGHT * tree.part.diameter)


def distances(
    detections: Sequence[Detection], truth: Sequence[TruePose], tree: InterpretationTree
) -> Float[np.ndarray, "detections truths"]:
    """MSSD [mm] of every pair of one part."""
    vertices = np.asarray(tree.part.vertices, float)
    points = vertices[ConvexHull(vertices).vertices]
    R, t = stacked([(d.R_cam_obj, d.t_cam_obj) for d in detections])
    R_true, t_true = stacked([(pose.R, pose.t) for pose in truth])
    return mssd(Pose(R[:, None], t[:, None]), Pose(R_true[None], t_true[None]), points, finite_set(tree.symmetries))


TruePoses = Sequence[TruePose | tuple[Any, ...]]  # a plain tuple of its fields will do


def as_true_pose(pose: TruePose | tuple[Any, ...]) -> TruePose:
    return pose if isinstance(pose, TruePose) else TruePose(pose[0], pose[1], pose[2], *pose[3:])


def true_poses(scene: Scene) -> list[TruePose] | None:
    """What `scene_gt.json` in a scene's folder tells of its image, in the BOP layout; None when it tells nothing.

    Raises ItreeError when it is there and cannot be understood.
    """
    path = None if scene.folder is None else scene.folder / "scene_gt.json"
    if path is None or not path.is_file():
        return None
    info = path.with_name("scene_gt_info.json")
    try:
        entries = read_json_object(path).get(str(scene.im_id), [])
        told = read_json_object(info).get(str(scene.im_id), []) if info.is_file() else []
        visible = [float(one.get("visib_fract", 1.0)) for one in told] or [1.0] * len(entries)
        return [
            TruePose(int(e["obj_id"]), np.reshape(e["cam_R_m2c"], (3, 3)), np.reshape(e["cam_t_m2c"], 3), v)
            for e, v in zip(entries, visible, strict=True)
        ]
    except (ItreeError, ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise ItreeError(
            f"{path}: true poses as obj_id, cam_R_m2c and cam_t_m2c of each instance are expected, and in "
            f"scene_gt_info.json a visib_fract of each ({error!r}). Correct the file, or take it away."
        ) from error


def stacked(poses: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    return np.array([R for R, _ in poses], float), np.array([t for _, t in poses], float)


def finite_set(symmetries: Symmetries) -> SymmetrySet:
    """A part's symmetries as the finite set that errors are taken over."""
    return symmetry_set({
        "symmetries_discrete": [np.asarray(T).ravel() for T in symmetries.discrete[1:]],
        "symmetries_continuous": [{"axis": axis, "offset": offset} for axis, offset in symmetries.continuous],
    })  # fmt: skip
