"""Wrong answers and missed instances by kind: what each of them is about, and how it is wrong."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np
from itree_cad.part import Part
from jaxtyping import Float, Int
from scipy.spatial import ConvexHull

from itree_jax.evaluation.judged import JudgedScene
from itree_jax.evaluation.pose_errors import Pose
from itree_jax.evaluation.score import LOOSE, STRICT
from itree_jax.refinement.hypotheses import turns_about_axes

# A pose turned by a near symmetry slides until most of what it shows fits, by up to about a wall's thickness.
TURNED_WITHIN = 0.15  # of the diameter, MSSD to a true pose under the turn
SAME_PLACE = 0.5  # of what an answer shows: more than half of it lies on the true part that it is about
NO_INSTANCE = -1


class Kind(Enum):
    """How a failure is wrong; the value is what a reader sees."""

    TURNED = "turned by a near symmetry"
    OFF = "off by 5 to 10 % of the diameter"
    ATTITUDE = "right place, wrong attitude"
    SECOND = "a second answer for an instance that is found"
    NOTHING = "nothing there"
    MISSED_WITH_REGION = "missed, with a region of its own"
    MISSED_WITHOUT_REGION = "missed, without a region"


@dataclass(frozen=True)
class Shape:
    """What telling the kinds apart needs to know of a part."""

    diameter: float  # [mm]
    hull: Float[np.ndarray, "points 3"]  # vertices of the convex hull [mm]
    turns: Float[np.ndarray, "turns 4 4"]  # about its main axes, model -> model [mm]


@dataclass(frozen=True)
class Failure:
    """One wrong answer, or one missed instance that no wrong answer is about."""

    scene_id: int
    kind: Kind
    answer: int | None  # row among the scene's answers
    instance: int | None  # the true pose that it is about; None where nothing is there


def part_shape(part: Part) -> Shape:
    vertices = np.asarray(part.vertices, float)
    hull = vertices[ConvexHull(vertices).vertices]
    turns = turns_about_axes(part.vertices, part.triangles).reshape(-1, 4, 4)
    return Shape(float(part.diameter), hull, turns)


def failures_of(
    judged: JudgedScene, shapes: Mapping[int, Shape], lies_on: Float[np.ndarray, "answers instances"],
    owner: Int[np.ndarray, "regions"],
) -> list[Failure]:
    """Every wrong answer of a scene by falling score, and every missed instance that none of them is about.

    Args:
        lies_on: share of what each answer shows that lies on each instance.
        owner: instance that each region of the scene lies on, -1 none.
    """
    wrong = np.flatnonzero(~judged.right)
    wrong = wrong[np.argsort(-judged.answers.score[wrong], kind="stable")]
    found = [wrong_answer(judged, int(k), shapes[int(judged.answers.obj_id[k])], lies_on[k]) for k in wrong]
    told = {f.instance for f in found if f.kind is not Kind.SECOND}
    return found + [missed_instance(judged, int(j), owner) for j in judged.missed if j not in told]


def wrong_answer(
    judged: JudgedScene, k: int, shape: Shape, lies_on: Float[np.ndarray, "instances"]
) -> Failure:
    """Which kind of wrong answer `k` is; of the nearest true poses those that nothing found come first."""
    scene = judged.truth.scene_id
    mine = np.flatnonzero(judged.truth.obj_id == judged.answers.obj_id[k])
    free = np.isin(mine, judged.found, invert=True)
    if not len(mine):
        return Failure(scene, Kind.NOTHING, k, None)

    def nearest(distance: Float[np.ndarray, "mine"], limit: float) -> int:
        """Instance within a limit, a free one if there is one; -1 none."""
        for among in (distance[free & (distance < limit)], distance[distance < limit]):
            if len(among):
                return int(mine[np.flatnonzero(distance == among.min())[0]])
        return NO_INSTANCE

    R, t = judged.answers.R[k], judged.answers.t[k]
    true = Pose(judged.truth.pose.R[mine], judged.truth.pose.t[mine])
    tries = (
        (Kind.SECOND, judged.errors.mssd[k, mine], STRICT),
        (Kind.OFF, judged.errors.mssd[k, mine], LOOSE),
        (Kind.TURNED, turned_distance(R, t, true, shape), TURNED_WITHIN),
        (Kind.ATTITUDE, 1.0 - lies_on[mine], 1.0 - SAME_PLACE),
    )
    for kind, distance, limit in tries:
        instance = nearest(distance, limit)
        if instance != NO_INSTANCE:
            return Failure(scene, kind, k, instance)
    return Failure(scene, Kind.NOTHING, k, None)


def turned_distance(
    R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"], true: Pose, shape: Shape
) -> Float[np.ndarray, "instances"]:
    """MSSD to each true pose turned by a near symmetry, least over the turns, as one of the diameter."""
    if not len(shape.turns):
        return np.full(len(true.t), np.inf)
    answered = shape.hull @ R.T + t
    turned = np.einsum("kij,pj->kpi", shape.turns[:, :3, :3], shape.hull) + shape.turns[:, None, :3, 3]
    in_camera = np.einsum("nij,kpj->nkpi", true.R, turned) + true.t[:, None, None]
    return np.linalg.norm(in_camera - answered, axis=-1).max(axis=-1).min(axis=-1) / shape.diameter


def missed_instance(judged: JudgedScene, j: int, owner: Int[np.ndarray, "regions"]) -> Failure:
    """With a region that lies on it, or without."""
    kind = Kind.MISSED_WITH_REGION if (owner == j).any() else Kind.MISSED_WITHOUT_REGION
    return Failure(judged.truth.scene_id, kind, None, j)
