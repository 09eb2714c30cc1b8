"""Ours on the peers' scenes, timed as `peers.recognise` times them -> a BOP csv, and a JSON file with what it cost.

    PYTHONPATH=experiments python -m peers.ours TREE ... [--dataset DATASET] [--out DIR] [--scenes ID ...]

Preparation is what a fresh process does to a tree before its first scene; compiling the tree is timed by
`experiments/benchmarks/compile_scaling.py`. Each scene is recognised once before it is timed, unless --cold is given:
then the first scene's seconds hold the start of the program's functions too.
"""

import argparse
import json
import os
import time
from dataclasses import dataclass
from pathlib import Path

from itree_jax.cli.runtime import start_jax
from itree_jax.cli.scene_answer import load_with_trees, recognize_scene, with_depth_from
from itree_jax.prepared import Prepared, prepare
from itree_jax.results import write_bop_csv
from itree_jax.sensing.scene_folder import scene_folders
from itree_jax.tree.tree_file import load_tree


@dataclass(frozen=True)
class Config:
    trees: tuple[Path, ...]
    dataset: Path = Path(os.environ.get("ITREE_DATA", Path(__file__).parents[3] / "shared" / "data")) / "scenes"
    out: Path = Path("out/peers")
    scenes: tuple[int, ...] = ()  # all if none is named
    cold: bool = False


def main(config: Config) -> None:
    """Writes `itree.csv` and `itree.json` into `config.out`. Scenes must hold the trees' objects alone."""
    start_jax()
    config.out.mkdir(parents=True, exist_ok=True)
    prepared: list[Prepared] = []
    cost: dict[str, dict[int, float]] = {"preparation_s": {}, "scene_cpu_s": {}}
    for path in config.trees:
        start = time.process_time()
        prepared.append(prepare(load_tree(path)))
        cost["preparation_s"][prepared[-1].tree.obj_id] = time.process_time() - start
    found = []
    for folder in scene_folders(config.dataset):
        if config.scenes and int(folder.name) not in config.scenes:
            continue
        for timed in (True,) if config.cold else (False, True):
            start = time.process_time()
            scene, fitting = load_with_trees(folder, prepared)
            scene, second = with_depth_from("file", scene, fitting[0].tree.sensor)
            answer = recognize_scene(scene, fitting, second)
            if timed:
                cost["scene_cpu_s"][scene.scene_id] = time.process_time() - start
                found.append(answer)
        print(f"{folder.name}: {len(found[-1])} answers, {cost['scene_cpu_s'][scene.scene_id]:.1f} CPU s", flush=True)
    write_bop_csv(found, config.out / "itree.csv")
    (config.out / "itree.json").write_text(json.dumps(cost, indent=1) + "\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trees", type=Path, nargs="+", metavar="TREE")
    parser.add_argument("--dataset", type=Path, default=Config.dataset)
    parser.add_argument("--out", type=Path, default=Config.out)
    parser.add_argument("--scenes", type=int, nargs="*", default=[])
    parser.add_argument("--cold", action="store_true")
    words = parser.parse_args()
    main(Config(tuple(words.trees), words.dataset, words.out, tuple(words.scenes), words.cold))
