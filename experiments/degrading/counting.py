"""What came of a scene, and its sums along a curve."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from itree_cad.part import Part
from scipy.spatial import ConvexHull, KDTree

from degrading.conditions import Condition
from itree_jax.detections import Detections
from itree_jax.evaluation.judged import JudgedScene
from itree_jax.evaluation.matching import match
from itree_jax.evaluation.pose_errors import Pose
from itree_jax.evaluation.report import Rate
from itree_jax.evaluation.score import STRICT, pose_error_table
from itree_jax.evaluation.symmetry import symmetry_set
from itree_jax.evaluation.truth import Model, SceneTruth
from itree_jax.results import BopResults
from itree_jax.sensing.scene_folder import Scene
from itree_jax.sensing.scene_writer import TrueObject
from itree_jax.simulate.dataset import model_info

SAMPLES = 1000  # of the surface, which only ADD-S asks for


def model_of(part: Part) -> Model:
    """What errors need to know of a part."""
    mesh = trimesh.Trimesh(part.vertices, part.triangles, process=False)
    points = np.asarray(trimesh.sample.sample_surface(mesh, SAMPLES, seed=1)[0], float)
    hull = part.vertices[ConvexHull(part.vertices).vertices]
    return Model(part.diameter, hull, points, KDTree(points), symmetry_set(model_info(part)))


def judged(found: Detections, scene: Scene, truth: Sequence[TrueObject], hidden: float, model: Model) -> JudgedScene:
    """The answers beside the truth, as `evaluate` judges them; visibility is that of what the plates leave."""
    rows = found.by_score
    answers = BopResults(
        *(np.full(len(rows), k) for k in (scene.scene_id, 0, 1)), np.array([d.score for d in rows], float),
        np.array([d.R_cam_obj for d in rows], float).reshape(-1, 3, 3),
        np.array([d.t_cam_obj for d in rows], float).reshape(-1, 3), np.full(len(rows), -1.0),
    )  # fmt: skip
    pose = Pose(np.array([t.R_cam_obj for t in truth]), np.array([t.t_cam_obj for t in truth]))
    visible = np.array([t.visib_fract for t in truth]) / (1.0 - hidden)
    true = SceneTruth(scene.scene_id, np.ones(len(truth), int), pose, visible, scene.sensor.camera, ("all",))
    errors = pose_error_table(answers, true, {1: model})
    return JudgedScene(true, answers, errors, match(errors.mssd, answers.score, STRICT))


def record_of(scene: JudgedScene, found: Detections, warned: Sequence[str], refused: bool) -> dict[str, Any]:
    """What is kept of a scene, as plain JSON data; answers by falling score."""
    nearest = scene.errors.mssd.min(axis=1, initial=np.inf)
    return {
        "visible": int(scene.visible.sum()), "found": int(scene.found_visible.sum()), "warned": list(warned),
        "refused": refused,
        "answers": [
            {"score": round(d.score, 4), "ambiguous": d.ambiguous, "right": bool(right), "mssd": round(float(near), 4)}
            for d, right, near in zip(found.by_score, scene.right, nearest, strict=True)
        ],
    }  # fmt: skip


@dataclass(frozen=True)
class Step:
    """A condition's scenes taken together."""

    condition: Condition
    scenes: int
    top_pick: Rate  # scenes whose best-scored answer is right
    recall: Rate  # of the parts whose uncovered pixels are visible by 70 % or more
    precision: Rate  # of the answers that are not called ambiguous
    precision_all: Rate  # of all answers
    silent: int  # scenes without an answer
    warned: int  # scenes of which something was said to be wrong
    refused: int  # scenes whose images `itree recognize` refuses; counted here as they are recognised all the same


def step_of(condition: Condition, records: Sequence[dict[str, Any]]) -> Step:
    """Sums of the records of one condition."""
    answers = [a for r in records for a in r["answers"]]
    relied = [a for a in answers if not a["ambiguous"]]
    best = [r["answers"][0] for r in records if r["answers"]]
    return Step(
        condition, len(records), Rate(sum(a["right"] for a in best), len(records)),
        Rate(sum(r["found"] for r in records), sum(r["visible"] for r in records)),
        Rate(sum(a["right"] for a in relied), len(relied)), Rate(sum(a["right"] for a in answers), len(answers)),
        sum(not r["answers"] for r in records), sum(bool(r["warned"]) for r in records),
        sum(r["refused"] for r in records),
    )  # fmt: skip


def rate_json(rate: Rate) -> dict[str, Any]:
    """Count, total, fraction and its 95 % interval."""
    low, high = rate.interval
    return {"count": rate.count, "total": rate.total, "fraction": rate.fraction, "low": low, "high": high}


def step_json(step: Step) -> dict[str, Any]:
    rates = {name: rate_json(getattr(step, name)) for name in ("top_pick", "recall", "precision", "precision_all")}
    said = {"scenes": step.scenes, "silent": step.silent, "warned": step.warned, "refused": step.refused}
    return {"curve": step.condition.curve, "step": step.condition.step, **said, **rates}


def as_markdown(steps: Sequence[Step]) -> str:
    """The table; intervals in brackets."""
    lines = [
        "| what is wrong | | scenes | top pick | recall | precision | of all answers | no answer | warned | refused |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for s in steps:
        rates = " | ".join(_cell(rate) for rate in (s.top_pick, s.recall, s.precision, s.precision_all))
        counts = f"{s.silent} | {s.warned} | {s.refused}"
        lines.append(f"| {s.condition.curve} | {s.condition.step} | {s.scenes} | {rates} | {counts} |")
    return "\n".join(lines) + "\n"


def _cell(rate: Rate) -> str:
    if rate.fraction is None:
        return "-"
    low, high = rate.interval
    return f"{100 * rate.fraction:.0f} % ({100 * low:.0f}-{100 * high:.0f})"
