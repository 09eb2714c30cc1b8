"""The evaluation in one readable function: data set + results -> report."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Float

from itree_jax.evaluation.matching import match
from itree_jax.evaluation.pose_errors import Pose, PoseErrors, add_s, mspd, pose_errors
from itree_jax.evaluation.report import Report, SceneCounts, summarise
from itree_jax.evaluation.truth import Model, SceneTruth, known_objects, load_models, load_truth
from itree_jax.results import BopResults, read_bop_csv

VISIBLE = 0.7  # instances that recall counts
TARGET_VISIBLE = 0.1  # instances that BOP's average recall counts
STRICT, LOOSE = 0.05, 0.10  # of the diameter
ADD_S_LIMIT = 0.10  # of the diameter
BOP_MSSD = np.arange(1, 11) * 0.05  # of the diameter
BOP_MSPD = np.arange(1, 11) * 5.0  # [px] in an image 640 px wide
BOP_WIDTH = 640  # [px]


class _Table(NamedTuple):
    """Errors of every estimate against every instance; inf between different objects."""

    mssd: Float[np.ndarray, "estimates instances"]  # of the diameter
    mspd: Float[np.ndarray, "estimates instances"]  # [px] in an image 640 px wide
    add_s: Float[np.ndarray, "estimates instances"]  # of the diameter
    rotation: Float[np.ndarray, "estimates instances"]  # [rad]
    translation: Float[np.ndarray, "estimates instances"]  # [mm]


def evaluate(dataset: str | Path, csv: str | Path) -> Report:
    """Scores a BOP csv against the true poses of a data set in the BOP layout.

    Image 0 of each scene, the reference camera, is scored; a scene without a row is missed. "Right" is an MSSD under
    5 % (or 10 %) of the diameter, least over the symmetries of models_info.json, to an instance that no answer with a
    better score has taken. Recall counts instances visible by 70 % or more. The average recalls are BOP's (Hodan et al.
    2020) without VSD: thresholds 5..50 % and 5..50 px, instances visible by 10 % or more, as many answers as there are.

    Raises ItreeError when a file is missing or malformed, or no row of the csv belongs to a scene of the data set.
    """
    dataset = Path(dataset)
    models, truth, results = load_models(dataset), load_truth(dataset), read_bop_csv(csv)
    known = np.isin(results.scene_id, [scene.scene_id for scene in truth]) & (results.im_id == 0)
    if len(results) and not known.any():
        raise ItreeError(f"{csv}: none of its {len(results)} rows is for image 0 of a scene of {dataset}.")
    groups: dict[str, list[SceneCounts]] = {}
    for scene in truth:
        counts = score_scene(results[known & (results.scene_id == scene.scene_id)], scene, models)
        for name in scene.groups:
            groups.setdefault(name, []).append(counts)
    return Report({name: summarise(groups[name]) for name in sorted(groups, key=_order)}, int((~known).sum()))


def score_scene(results: BopResults, scene: SceneTruth, models: Mapping[int, Model]) -> SceneCounts:
    """The counts of one scene; `results` are its rows."""
    table = _error_table(results, scene, models)
    strict, loose = (match(table.mssd, results.score, limit) for limit in (STRICT, LOOSE))
    near = match(table.add_s, results.score, ADD_S_LIMIT)
    visible = scene.visible >= VISIBLE
    right = np.flatnonzero(strict >= 0)[np.argsort(-results.score[strict >= 0], kind="stable")]
    best = np.argsort(-results.score, kind="stable")[:1]
    return SceneCounts(
        estimates=len(results),
        visible=int(visible.sum()),
        top=bool((strict[best] >= 0).any()),
        found_5=int(visible[strict[strict >= 0]].sum()),
        found_10=int(visible[loose[loose >= 0]].sum()),
        right_5=int((strict >= 0).sum()),
        right_10=int((loose >= 0).sum()),
        found_add_s=int(visible[near[near >= 0]].sum()),
        targets=int((scene.visible >= TARGET_VISIBLE).sum()),
        found_mssd=_bop_found(table.mssd, results, scene, BOP_MSSD),
        found_mspd=_bop_found(table.mspd, results, scene, BOP_MSPD),
        rotation=tuple(table.rotation[right, strict[right]].tolist()),
        translation=tuple(table.translation[right, strict[right]].tolist()),
        time=float(results.time.max()) if len(results) else None,
    )


def pose_error_table(results: BopResults, scene: SceneTruth, models: Mapping[int, Model]) -> PoseErrors:
    """Errors of every answer of a scene against every instance, [answers, instances]; inf between different objects.

    The MSSD is one of the diameter, the rotation in [rad], the translation in [mm]. Raises ItreeError when
    models_info.json lacks an object.
    """
    if not known_objects(scene, dict(models)).all():
        raise ItreeError(f"scene {scene.scene_id}: scene_gt.json has an object that models_info.json has not.")
    table = PoseErrors(*(np.full((len(results), len(scene.obj_id)), np.inf) for _ in PoseErrors._fields))
    for obj_id, cells, estimate, truth in _pairs(results, scene):
        model = models[obj_id]
        errors = pose_errors(estimate, truth, model.hull, model.symmetries)
        table.mssd[cells] = errors.mssd / model.diameter
        table.rotation[cells], table.translation[cells] = errors.rotation, errors.translation
    return table


def _error_table(results: BopResults, scene: SceneTruth, models: Mapping[int, Model]) -> _Table:
    poses = pose_error_table(results, scene, models)
    pixels, nearest = np.full(poses.mssd.shape, np.inf), np.full(poses.mssd.shape, np.inf)
    for obj_id, cells, estimate, truth in _pairs(results, scene):
        model = models[obj_id]
        pixels[cells] = mspd(estimate, truth, model.hull, model.symmetries, scene.camera)
        far = ADD_S_LIMIT * model.diameter
        nearest[cells] = add_s(estimate, truth, model.samples, model.surface, far) / model.diameter
    return _Table(poses.mssd, pixels * BOP_WIDTH / scene.camera.width, nearest, poses.rotation, poses.translation)


def _pairs(results: BopResults, scene: SceneTruth) -> Iterator[tuple[int, Any, Pose, Pose]]:
    """Of every object that is answered and there: cells of the table, estimates [rows, 1], true poses [1, columns]."""
    for obj_id in np.intersect1d(results.obj_id, scene.obj_id).tolist():
        rows, columns = np.flatnonzero(results.obj_id == obj_id), np.flatnonzero(scene.obj_id == obj_id)
        estimate = Pose(results.R[rows, None], results.t[rows, None])
        truth = Pose(scene.pose.R[None, columns], scene.pose.t[None, columns])
        yield obj_id, np.ix_(rows, columns), estimate, truth


def _bop_found(
    errors: Float[np.ndarray, "estimates instances"], results: BopResults, scene: SceneTruth, limits: np.ndarray
) -> tuple[int, ...]:
    """Targets found at each limit when only as many answers are taken, the best first, as there are targets."""
    targets = scene.visible >= TARGET_VISIBLE
    kept = np.concatenate([np.zeros(0, dtype=np.int64), *(
        rows[np.argsort(-results.score[rows], kind="stable")][: int((targets & (scene.obj_id == obj_id)).sum())]
        for obj_id in np.unique(results.obj_id)
        for rows in [np.flatnonzero(results.obj_id == obj_id)]
    )])  # fmt: skip
    return tuple(int((match(errors[kept], results.score[kept], limit, targets) >= 0).sum()) for limit in limits)


def _order(name: str) -> tuple[int, str]:
    heads = ("all", "level", "kind", "lights", "part")
    return (heads.index(name.split()[0]) if name.split()[0] in heads and "," not in name else len(heads), name)
