"""Whether a scene gives the same bytes whatever else goes on: alone and in a batch, on one core and on two, in another
order of scenes and of trees, each in a process of its own.

    python experiments/determinism.py DATASET TREE [TREE ...] [--scenes N]

Takes the first scenes whose sensor is the same (a batch has one). Prints a table: of how many scenes the JSON results
are those of the first row, times left out.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path


@dataclass(frozen=True)
class Way:
    """How scenes are recognised."""

    name: str
    cores: int = 2
    batch: bool = False
    scenes_reversed: bool = False
    trees_reversed: bool = False


WAYS = (
    Way("two cores, one scene after the other"),
    Way("the same again"),
    Way("one core", cores=1),
    Way("one batch", batch=True),
    Way("one batch on one core, scenes in reverse", cores=1, batch=True, scenes_reversed=True),
    Way("trees in reverse", trees_reversed=True),
)


def main(dataset: Path, trees: Sequence[Path], scenes: int) -> None:
    """Prints the table."""
    reference: dict[str, str] = {}
    print("| recognised | same bytes |\n|---|---|", flush=True)
    for k, way in enumerate(WAYS):
        if way.trees_reversed and len(trees) < 2:
            continue
        with tempfile.NamedTemporaryFile("w", suffix=".json") as task:
            json.dump([k, str(dataset), [str(t) for t in trees], scenes], task)
            task.flush()
            words = [sys.executable, __file__, "--task", task.name]
            done = subprocess.run(words, capture_output=True, text=True, check=True)
        found = json.loads(done.stdout.splitlines()[-1])
        reference = reference or found
        same = [name for name in reference if found.get(name) == reference[name]]
        print(f"| {way.name} | {len(same)} of {len(reference)} |", flush=True)


def answer(k: int, dataset: str, trees: list[str], scenes: int) -> dict[str, str]:
    """A digest of every scene's results, under `WAYS[k]`."""
    way = WAYS[k]
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: way.cores])
    os.cpu_count = lambda: way.cores
    import numpy as np
    from soaking.digest import digest

    from itree_jax.prepared import prepare, prepare_forest
    from itree_jax.recognition import recognize
    from itree_jax.sensing.scene_folder import load_scene, scene_folders
    from itree_jax.tree.tree_file import load_tree

    prepared = [prepare(load_tree(path)) for path in trees]
    if len({one.tree.obj_id for one in prepared}) < len(prepared):
        prepared = [replace(one, tree=replace(one.tree, obj_id=k + 1)) for k, one in enumerate(prepared)]
    forest = prepare_forest(prepared[::-1] if way.trees_reversed else prepared)
    chosen, first = [], None
    for folder in scene_folders(Path(dataset)):
        scene = load_scene(folder)
        first = first or scene.sensor
        lights = (first.light_directions, scene.sensor.light_directions)
        same = lights[0].shape == lights[1].shape and np.allclose(*lights)
        if same and np.allclose(first.light_intensities, scene.sensor.light_intensities):
            chosen.append((folder.name, scene))
        if len(chosen) == scenes:
            break
    chosen = chosen[::-1] if way.scenes_reversed else chosen
    sensor = prepared[0].tree.sensor
    if way.batch:
        depth = np.stack([scene.depth for _, scene in chosen])
        images = np.stack([scene.images for _, scene in chosen])
        found = recognize(forest, images, sensor, depth, chosen[0][1].R_w2c)
    else:
        found = [recognize(forest, s.images, sensor, s.depth, chosen[0][1].R_w2c) for _, s in chosen]
    return {name: digest(one) for (name, _), one in zip(chosen, found, strict=True)}


if __name__ == "__main__":
    if sys.argv[1] == "--task":
        print(json.dumps(answer(*json.loads(Path(sys.argv[2]).read_text()))))
    else:
        parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
        parser.add_argument("dataset", type=Path)
        parser.add_argument("trees", type=Path, nargs="+")
        parser.add_argument("--scenes", type=int, default=3)
        given = parser.parse_args()
        main(given.dataset, given.trees, given.scenes)
