"""How recognition fails when a scene gets worse: by silence, or by wrong poses.

    python experiments/degradation.py [--quick] [--scenes 6] [--parts NAME ...] [--out DIR]

Bundled parts settle in a bin, four at a time, and are imaged by the bench sensor at 320 x 240 px with a depth map.
Along each curve one thing gets worse (`experiments/degrading/conditions.py`), in the same bins; what the product is
told of the sensor stays. An answer is right under an MSSD of 5 % of the diameter, as `itree evaluate` judges it.
Precision is that of the answers that are not called ambiguous; of all answers it stands beside it.

Trees and the result of each scene are kept in DIR: a run that was stopped goes on where it was. Writes `report.json`,
`table.md` and `curves.png` there. Scenes of another version of the code are not told from those of this one: begin
with an empty DIR.
"""

import argparse
import json
import warnings
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from degrading.chart import draw_curves
from degrading.conditions import NOMINAL, Condition, steps
from degrading.counting import Step, as_markdown, judged, model_of, record_of, step_json, step_of
from degrading.imaging import scene_of, sensor_of, told_sensor
from itree_cad.bundled import BUNDLED_PARTS, bundled_part
from itree_cad.part import Part
from itree_kernels.errors import ItreeError, ItreeWarning
from itree_kernels.whole_files import write_whole

from itree_jax.compile import compile_tree
from itree_jax.evaluation.truth import Model
from itree_jax.prepared import Prepared, prepare
from itree_jax.recognition import recognize_one
from itree_jax.sensing.exposure import check_light
from itree_jax.sensing.scene_folder import Scene
from itree_jax.sensing.scene_writer import TrueObject
from itree_jax.simulate import bin_for, settle
from itree_jax.tree.tree_file import load_tree, save_tree

QUICK_DRAWS = 20


@dataclass(frozen=True)
class Config:
    parts: tuple[str, ...] = ("ikeuchi-1987", "bracket", "clevis")
    scenes: int = 6  # of each part
    parts_per_scene: int = 4
    seed: int = 0
    quick: bool = False  # one scene of one part, the last step of each curve, trees of few draws
    out: Path = Path("out/degradation")


def main(config: Config) -> list[Step]:
    """Runs what is not yet done, and writes the table and the figure after every part."""
    names, scenes = (config.parts[:1], 1) if config.quick else (config.parts, config.scenes)
    conditions = steps(config.quick)
    records: dict[str, list[dict[str, Any]]] = {c.name: [] for c in conditions}
    found: list[Step] = []
    for name in names:
        for condition, record in results_of(name, conditions, scenes, config):
            records[condition.name].append(record)
        found = [step_of(c, records[c.name]) for c in conditions]
        write(found, config)
    print(as_markdown(found))
    return found


def results_of(
    name: str, conditions: list[Condition], scenes: int, config: Config
) -> Iterator[tuple[Condition, dict[str, Any]]]:
    """The records of one part, scene by scene."""
    part = bundled_part(name)
    model, bin_, trees = model_of(part), bin_for(sensor_of(NOMINAL), part.diameter), {}
    for k in range(scenes):
        seed = int(np.random.SeedSequence([config.seed, BUNDLED_PARTS.index(name), k]).generate_state(1)[0])
        T_bin_obj = None
        for condition in conditions:
            path = config.out / "scenes" / f"{name}, {k}, {condition.name}.json"
            if not path.is_file():
                T_bin_obj = settle(part, config.parts_per_scene, bin_, seed) if T_bin_obj is None else T_bin_obj
                key = (condition.lights, condition.missing)
                trees[key] = trees.get(key) or tree_for(part, condition, config)
                scene, truth = scene_of(part, T_bin_obj, bin_, condition, seed)
                record = recognised(trees[key], model, scene, truth, condition)
                path.parent.mkdir(parents=True, exist_ok=True)
                write_whole(path, json.dumps(record) + "\n")
            yield condition, json.loads(path.read_text(encoding="utf-8"))


def recognised(
    prepared: Prepared, model: Model, scene: Scene, truth: list[TrueObject], condition: Condition
) -> dict[str, Any]:
    """The record of one scene."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ItreeWarning)
        found = recognize_one([prepared], scene.images, scene.sensor, scene.depth, scene.R_w2c)
    warned = [str(one.message) for one in caught if issubclass(one.category, ItreeWarning)]
    return record_of(judged(found, scene, truth, condition.hidden, model), found, warned, refused(scene))


def refused(scene: Scene) -> bool:
    """Whether `itree recognize` would refuse these images when it loads them."""
    names = [f"image {k}" for k in range(len(scene.images))]
    try:
        check_light(scene.images, scene.sensor.noise, names)
    except ItreeError:
        return True
    return False


def tree_for(part: Part, condition: Condition, config: Config) -> Prepared:
    """Compiled for the nominal image size with the lights of the condition, and kept."""
    left = condition.lights - condition.missing
    path = config.out / f"{part.name}-{left}-of-{condition.lights}.tree"
    if not path.is_file():
        sensor = told_sensor(Condition(lights=condition.lights, missing=condition.missing))
        path.parent.mkdir(parents=True, exist_ok=True)
        options = {"draws": QUICK_DRAWS} if config.quick else {}
        save_tree(compile_tree(part, sensor, **options), path)
    return prepare(load_tree(path))


def write(found: list[Step], config: Config) -> None:
    report = {
        "config": asdict(config) | {"out": str(config.out)}, "steps": [step_json(step) for step in found],
    }  # fmt: skip
    write_whole(config.out / "report.json", json.dumps(report, indent=1) + "\n")
    write_whole(config.out / "table.md", as_markdown(found))
    draw_curves(found, config.out / "curves.png")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--parts", nargs="+", choices=BUNDLED_PARTS, default=Config.parts)
    parser.add_argument("--scenes", type=int, default=Config.scenes)
    parser.add_argument("--parts-per-scene", type=int, default=Config.parts_per_scene)
    parser.add_argument("--seed", type=int, default=Config.seed)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--out", type=Path, default=Config.out)
    given = vars(parser.parse_args())
    main(Config(**given | {"parts": tuple(given["parts"])}))
