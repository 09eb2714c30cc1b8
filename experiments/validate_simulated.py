"""Simulates bins of every bundled part, recognises them, and prints the scores and how far a score can be believed.

    python experiments/validate_simulated.py [--scenes N] [--parts-per-scene N] [--look NAME] [--out DIR]

Needs the physics engine (extra `sim`). The scenes are rendered by the renderer that also makes the trees' appearances,
so they tell how the method does where its model of the sensor holds; `evaluate_scenes.py` has scenes of another one.
"""

import argparse
import json
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from evaluate_scenes import as_markdown, run
from itree_cad.bundled import BUNDLED_PARTS, bundled_part

from itree_jax.evaluation.matching import match
from itree_jax.evaluation.pose_errors import Pose, mssd
from itree_jax.evaluation.report import Report, SceneCounts, summarise, wilson_interval
from itree_jax.evaluation.score import STRICT, score_scene
from itree_jax.evaluation.truth import load_models, load_truth
from itree_jax.results import read_bop_csv
from itree_jax.sensing.sensor_file import load_sensor
from itree_jax.simulate import LOOKS, simulate

EDGES = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0)  # of the bins of scores; most answers are near an end


@dataclass(frozen=True)
class Config:
    out: Path = Path("out/validate_simulated")
    parts: tuple[str, ...] = BUNDLED_PARTS
    sensor: str = "bundled:bench"
    scenes: int = 2  # per part
    parts_per_scene: int = 8  # dropped
    look: str = "lambert"
    seed: int = 0


@dataclass(frozen=True)
class Answers:
    """Every answer for one part's scenes."""

    scenes: list[SceneCounts]
    score: np.ndarray
    right: np.ndarray  # MSSD under 5 % of the diameter, to an instance of its own


def main(config: Config) -> None:
    """Writes `report.json` and `table.md` into `config.out`, and prints the tables."""
    config.out.mkdir(parents=True, exist_ok=True)
    found = {name: answers_for(name, config, k) for k, name in enumerate(config.parts)}
    groups = {"all": summarise([s for answers in found.values() for s in answers.scenes])}
    groups |= {f"part {name}": summarise(answers.scenes) for name, answers in found.items()}
    report = Report(groups, 0).to_json()
    score = np.concatenate([answers.score for answers in found.values()])
    right = np.concatenate([answers.right for answers in found.values()])
    report |= {"config": asdict(config) | {"out": str(config.out)}, "reliability": reliability(score, right)}
    report["calibration_error"] = calibration_error(report["reliability"])
    (config.out / "report.json").write_text(json.dumps(report, indent=1) + "\n")
    table = as_markdown(report["groups"]) + "\n" + reliability_table(report["reliability"])
    (config.out / "table.md").write_text(table)
    print(table)


def answers_for(name: str, config: Config, number: int) -> Answers:
    """Simulates, compiles, recognises and scores one part."""
    folder = config.out / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    dataset, tree, csv = folder / "dataset", folder / "part.tree", folder / "results.csv"
    part, sensor = bundled_part(name), load_sensor(config.sensor)
    simulate(
        part, sensor, config.scenes, config.parts_per_scene, dataset, seed=config.seed + number,
        look=LOOKS[config.look],
    )  # fmt: skip
    run("compile", f"bundled:{name}", "--sensor", config.sensor, "-o", tree, "--quiet")
    run("recognize", dataset, tree, "-o", csv, "--quiet")
    return score_answers(dataset, csv)


def score_answers(dataset: Path, csv: Path) -> Answers:
    """The counts of every scene, and every answer's score with whether it is right."""
    models, results = load_models(dataset), read_bop_csv(csv)
    counts, score, right = [], [], []
    for scene in load_truth(dataset):
        rows = results[results.scene_id == scene.scene_id]
        counts.append(score_scene(rows, scene, models))
        model = models[int(scene.obj_id[0])]
        truth = Pose(scene.pose.R[None], scene.pose.t[None])
        error = mssd(Pose(rows.R[:, None], rows.t[:, None]), truth, model.hull, model.symmetries) / model.diameter
        score.append(rows.score)
        right.append(match(error, rows.score, STRICT) >= 0)
    return Answers(counts, np.concatenate(score), np.concatenate(right))


def reliability(score: np.ndarray, right: np.ndarray) -> list[dict[str, Any]]:
    """Bins of scores: answers, their mean score, the share of them that is right with its 95 % interval."""
    rows = []
    for low, high in pairwise(EDGES):
        inside = (score >= low) & ((score < high) | (high == EDGES[-1]))
        count = int(inside.sum())
        interval = wilson_interval(int(right[inside].sum()), count)
        rows.append({
            "from": low, "to": high, "answers": count,
            "mean_score": float(score[inside].mean()) if count else None,
            "right": float(right[inside].mean()) if count else None, "low": interval[0], "high": interval[1],
        })  # fmt: skip
    return rows


def calibration_error(rows: Sequence[dict[str, Any]]) -> float | None:
    """Mean distance between score and share right over the answers; 0 when a fraction s of answers with score s is
    right."""
    total = sum(row["answers"] for row in rows)
    gaps = [row["answers"] * abs(row["mean_score"] - row["right"]) for row in rows if row["answers"]]
    return sum(gaps) / total if total else None


def reliability_table(rows: Sequence[dict[str, Any]]) -> str:
    lines = ["| score | answers | mean score | right (95 %) |", "|---|---|---|---|"]
    for row in rows:
        if row["answers"]:
            share = f"{100 * row['right']:.0f} % ({100 * row['low']:.0f}-{100 * row['high']:.0f})"
            scores = f"{row['from']:.1f}-{row['to']:.1f} | {row['answers']} | {row['mean_score']:.2f}"
            lines.append(f"| {scores} | {share} |")
    error = calibration_error(rows)
    return "\n".join(lines) + ("\n" if error is None else f"\n\ncalibration error {error:.3f}\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Config.out)
    parser.add_argument("--parts", nargs="+", choices=BUNDLED_PARTS, default=BUNDLED_PARTS)
    parser.add_argument("--sensor", default=Config.sensor)
    parser.add_argument("--scenes", type=int, default=Config.scenes)
    parser.add_argument("--parts-per-scene", type=int, default=Config.parts_per_scene)
    parser.add_argument("--look", choices=sorted(LOOKS), default=Config.look)
    parser.add_argument("--seed", type=int, default=Config.seed)
    given = vars(parser.parse_args())
    main(replace(Config(), **given | {"parts": tuple(given["parts"])}))
