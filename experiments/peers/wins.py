"""The cases where a peer is right and we are not: which instance, how visible, and what we said instead."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Float

from itree_jax.evaluation.matching import match
from itree_jax.evaluation.pose_errors import Pose, pose_errors
from itree_jax.evaluation.score import STRICT
from itree_jax.evaluation.truth import Model, SceneTruth, load_models, load_truth
from itree_jax.results import BopResults, read_bop_csv

NEAR = 0.25  # diameters between centres: an answer for this instance, in another attitude


@dataclass(frozen=True)
class Fate:
    """What became of one instance in one csv."""

    right: bool
    mssd: float  # of the diameter, of the nearest answer; inf = the scene has none
    rotation: float  # [rad] of it
    distance: float  # of the diameter, between its centre and the instance's


@dataclass(frozen=True)
class Case:
    scene: int
    instance: int  # entry of scene_gt.json
    obj_id: int
    level: str
    visible: float
    right: tuple[str, ...]  # who has it right
    ours: Fate
    said: str  # what we said of the regions of this scene without an answer


def peer_wins(
    dataset: Path, ours: Path, peers: Mapping[str, Path], reasons: Path | None = None, visible: float = 0.0
) -> list[Case]:
    """The instances, visible by `visible` or more, that a peer's csv has right at 5 % and ours has not.

    `reasons` is the JSON file that `itree recognize` wrote with our csv.
    """
    models, truth, said = load_models(dataset), load_truth(dataset), reasons_of_scenes(reasons)
    results = {name: read_bop_csv(path) for name, path in peers.items()}
    own = read_bop_csv(ours)
    cases = []
    for scene in truth:
        fates, theirs = fates_in(scene, own, models), {name: fates_in(scene, r, models) for name, r in results.items()}
        for k, fate in enumerate(fates):
            right = tuple(name for name, f in theirs.items() if f[k].right)
            if right and not fate.right and scene.visible[k] >= visible:
                where = scene.scene_id, k, int(scene.obj_id[k]), level_of(scene.groups), float(scene.visible[k])
                cases.append(Case(*where, right, fate, said.get(scene.scene_id, "")))
    return cases


def fates_in(scene: SceneTruth, results: BopResults, models: Mapping[int, Model]) -> list[Fate]:
    """What became of every instance of a scene; the same matching as `evaluate`, at 5 %."""
    rows = results[(results.scene_id == scene.scene_id) & (results.im_id == 0)]
    n, m = len(rows), len(scene.obj_id)
    mssd, rotation, distance = (np.full((n, m), np.inf) for _ in range(3))
    for obj_id in np.intersect1d(rows.obj_id, scene.obj_id).tolist():
        model = models[obj_id]
        cells = np.ix_(np.flatnonzero(rows.obj_id == obj_id), np.flatnonzero(scene.obj_id == obj_id))
        i, j = cells
        estimate, true = Pose(rows.R[i], rows.t[i]), Pose(scene.pose.R[j], scene.pose.t[j])
        errors = pose_errors(estimate, true, model.hull, model.symmetries)
        mssd[cells], rotation[cells] = errors.mssd / model.diameter, errors.rotation
        centre = model.hull.mean(axis=0)
        distance[cells] = np.linalg.norm(moved(estimate, centre) - moved(true, centre), axis=-1) / model.diameter
    found = set(match(mssd, rows.score, STRICT).tolist())
    if n == 0:
        return [Fate(False, np.inf, np.inf, np.inf)] * m
    nearest = mssd.argmin(axis=0)
    return [Fate(k in found, *(float(table[nearest[k], k]) for table in (mssd, rotation, distance))) for k in range(m)]


def moved(pose: Pose, x: Float[np.ndarray, "3"]) -> Float[np.ndarray, "*n 3"]:
    return pose.R @ x + pose.t


def why(case: Case) -> str:
    """In words what we said instead."""
    fate = case.ours
    if fate.mssd < STRICT:
        words = "a better scored answer took it: ours is a second one there"
    elif fate.distance < NEAR:
        words = f"answered {np.degrees(fate.rotation):.0f} deg off ({100 * fate.mssd:.0f} % of the diameter)"
    else:
        words = "no answer there"
    return words + (f"; regions without an answer: {case.said}" if case.said else "")


def level_of(groups: Sequence[str]) -> str:
    return next((name.removeprefix("level ") for name in groups if name.startswith("level ") and "," not in name), "-")


def reasons_of_scenes(path: Path | None) -> dict[int, str]:
    """How often each reason was given for a region without an answer, per scene."""
    if path is None:
        return {}
    try:
        images = json.loads(path.read_text(encoding="utf-8"))["images"]
        counts = {int(i["scene_id"]): Counter(str(e["reason"]) for e in i["not_recognised"]) for i in images}
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise ItreeError(f"{path}: the JSON file of `itree recognize --json` is expected ({error!r}).") from error
    return {scene: ", ".join(f"{n} x {reason}" for reason, n in c.most_common()) for scene, c in counts.items()}
