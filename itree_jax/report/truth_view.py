"""Poses beside the truth, where it is known: how far each lies from the nearest true pose of its part."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from itree_cad.symmetry import Symmetries
from jaxtyping import Float
from scipy.spatial import ConvexHull

from itree_jax.detections import Detection
from itree_jax.evaluation.matching import match
from itree_jax.evaluation.pose_errors import Pose, mssd
from itree_jax.evaluation.symmetry import SymmetrySet, symmetry_set
from itree_jax.tree.tree import InterpretationTree

RIGHT = 0.10  # of the diameter: a pose nearer than this (MSSD) to a true one is right

TruePose = tuple[int, Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]  # obj_id, R, t [mm], model -> camera


@dataclass(frozen=True)
class Comparison:
    """MSSD [mm] of each detection to the nearest true pose (inf without one), and the true pose that it found."""

    error: Float[np.ndarray, "detections"]
    found: tuple[int, ...]  # index of the true pose within 10 % of the diameter, one to one by score; -1 none


def compare(
    detections: Sequence[Detection], truth: Sequence[TruePose], trees: Mapping[int, InterpretationTree]
) -> Comparison:
    """Symmetry-aware distances, and the one-to-one matching that `evaluate` uses."""
    errors = np.full((len(detections), len(truth)), np.inf)
    for obj_id, tree in trees.items():
        mine = [i for i, d in enumerate(detections) if d.obj_id == obj_id]
        true = [j for j, (o, _, _) in enumerate(truth) if o == obj_id]
        if mine and true:
            errors[np.ix_(mine, true)] = distances([detections[i] for i in mine], [truth[j] for j in true], tree)
    diameter = np.array([trees[d.obj_id].part.diameter for d in detections], float)
    score = np.array([d.score for d in detections], float)
    found = match(errors / diameter[:, None], score, RIGHT)
    return Comparison(errors.min(axis=1, initial=np.inf), tuple(int(k) for k in found))


def distances(
    detections: Sequence[Detection], truth: Sequence[TruePose], tree: InterpretationTree
) -> Float[np.ndarray, "detections truths"]:
    """MSSD [mm] of every pair of one part."""
    vertices = np.asarray(tree.part.vertices, float)
    points = vertices[ConvexHull(vertices).vertices]
    R, t = stacked([(d.R_cam_obj, d.t_cam_obj) for d in detections])
    R_true, t_true = stacked([(R, t) for _, R, t in truth])
    return mssd(Pose(R[:, None], t[:, None]), Pose(R_true[None], t_true[None]), points, finite_set(tree.symmetries))


def stacked(poses: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    return np.array([R for R, _ in poses], float), np.array([t for _, t in poses], float)


def finite_set(symmetries: Symmetries) -> SymmetrySet:
    """A part's symmetries as the finite set that errors are taken over."""
    return symmetry_set({
        "symmetries_discrete": [np.asarray(T).ravel() for T in symmetries.discrete[1:]],
        "symmetries_continuous": [{"axis": axis, "offset": offset} for axis, offset in symmetries.continuous],
    })  # fmt: skip
