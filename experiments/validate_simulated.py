"""Simulates bins of every bundled part, recognises them, and prints the scores and how far a score can be believed.

    python experiments/validate_simulated.py [--scenes N] [--parts-per-scene N] [--look NAME] [--out DIR]

Needs the physics engine (extra `sim`). The scenes are rendered by the renderer that also makes the trees' appearances,
so they tell how the method does where its model of the sensor holds; `evaluate_scenes.py` has scenes of another one.
"""

import argparse
import json
import shutil
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from evaluate_scenes import run
from itree_cad.bundled import BUNDLED_PARTS, bundled_part
from quality.comparison import group_table
from quality.reliability_tables import reliability_report

from itree_jax.evaluation.judged import JudgedScene, judge_answers, scored_answers
from itree_jax.evaluation.reliability import calibration_error, equal_bins
from itree_jax.evaluation.report import Report, SceneCounts, summarise
from itree_jax.evaluation.score import score_scene
from itree_jax.evaluation.truth import load_models
from itree_jax.sensing.sensor_file import load_sensor
from itree_jax.simulate import LOOKS, simulate


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
class Scored:
    """One part's scenes: every answer, and what each scene adds to the rates."""

    judged: list[JudgedScene]
    counts: list[SceneCounts]


def main(config: Config) -> None:
    """Writes `report.json` and `table.md` into `config.out`, and prints the tables."""
    config.out.mkdir(parents=True, exist_ok=True)
    found = {name: scenes_of(name, config, k) for k, name in enumerate(config.parts)}
    groups = {"all": summarise([counts for one in found.values() for counts in one.counts])}
    groups |= {f"part {name}": summarise(one.counts) for name, one in found.items()}
    scored = scored_answers([scene for one in found.values() for scene in one.judged])
    report = Report(groups, 0).to_json() | {
        "config": asdict(config) | {"out": str(config.out)},
        "calibration_error": calibration_error(equal_bins(scored.score, scored.right)),
    }
    (config.out / "report.json").write_text(json.dumps(report, indent=1) + "\n")
    table = group_table(report["groups"]) + "\n" + reliability_report(scored)
    (config.out / "table.md").write_text(table)
    print(table)


def scenes_of(name: str, config: Config, number: int) -> Scored:
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
    models, judged = load_models(dataset), judge_answers(dataset, csv)
    return Scored(judged, [score_scene(scene.answers, scene.truth, models) for scene in judged])


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
