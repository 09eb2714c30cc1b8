"""Compiles every model of a data set for its lights, recognises every scene, and prints the table per level and part.

    python experiments/evaluate_scenes.py [--dataset DATASET] [--out DIR] [--depth file|stereo|none] [--trees DIR]
        [--picks N]

The data set defaults to `scenes` in the folder that ITREE_DATA names. With `--picks` no more than the highest regions
are read: recall then says how many parts that gave. Uses the command line, as a user would.
"""

import argparse
import json
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from quality.comparison import group_table

from itree_jax.cli.main import main as itree
from itree_jax.evaluation import evaluate
from itree_jax.results import read_bop_csv
from itree_jax.sensing.scene_folder import scene_folders


@dataclass(frozen=True)
class Config:
    dataset: Path = Path(os.environ.get("ITREE_DATA", Path(__file__).parents[2] / "shared" / "data")) / "scenes"
    out: Path = Path("out/evaluate_scenes")
    depth: str = "file"
    trees: Path | None = None  # of an earlier run: they are used instead of compiling
    picks: int | None = None


def main(config: Config) -> None:
    config.out.mkdir(parents=True, exist_ok=True)
    results = [recognise_part(config, obj_id, folders) for obj_id, folders in scenes_of_parts(config.dataset)]
    csv = config.out / "results.csv"
    csv.write_text("".join(joined(results)))
    read_bop_csv(csv)
    report = evaluate(config.dataset, csv)
    (config.out / "report.json").write_text(json.dumps(report.to_json(), indent=1))
    table = group_table(report.to_json()["groups"])
    (config.out / "table.md").write_text(table)
    print(table)


def scenes_of_parts(dataset: Path) -> Iterable[tuple[int, list[Path]]]:
    """The scenes in which each object lies, by its true poses."""
    of: dict[int, list[Path]] = {}
    for folder in scene_folders(dataset):
        truth = json.loads((folder / "scene_gt.json").read_text())["0"]
        for obj_id in sorted({int(t["obj_id"]) for t in truth}):
            of.setdefault(obj_id, []).append(folder)
    return sorted(of.items())


def light_count(folder: Path) -> int:
    """Of a scene folder's reference camera, by its images."""
    return len(list((folder / "lit").glob("000000_*")))


def recognise_part(config: Config, obj_id: int, folders: list[Path]) -> Path:
    """A tree for each number of lights, compiled for the first such scene, and the csv of all the part's scenes."""
    csv = config.out / f"obj_{obj_id:06d}.csv"
    first = {light_count(folder): folder for folder in reversed(folders)}
    trees = [tree_of(config, obj_id, lights, folder) for lights, folder in sorted(first.items())]
    scenes = config.out / f"scenes_{obj_id:06d}"
    scenes.mkdir(exist_ok=True)
    for folder in folders:
        link = scenes / folder.name
        link.unlink(missing_ok=True)
        link.symlink_to(folder.resolve(), target_is_directory=True)
    picks = [] if config.picks is None else ["--picks", config.picks]
    run("recognize", scenes, *trees, "-o", csv, "--depth", config.depth, *picks)
    return csv


def tree_of(config: Config, obj_id: int, lights: int, folder: Path) -> Path:
    """The tree of a part for a scene's lights: compiled, or that of an earlier run."""
    name = f"obj_{obj_id:06d}_{lights}.tree"
    if config.trees is not None and (config.trees / name).is_file():
        return config.trees / name
    model = config.dataset / "models" / f"obj_{obj_id:06d}.ply"
    run("compile", model, "--sensor", folder, "-o", config.out / name, "--obj-id", obj_id)
    return config.out / name


def run(*words: object) -> None:
    code = itree([str(w) for w in words])
    if code != 0:
        raise SystemExit(code)


def joined(results: Iterable[Path]) -> Iterable[str]:
    """The lines of several csv files under one head."""
    for k, path in enumerate(results):
        with path.open() as lines:
            yield from (line for number, line in enumerate(lines) if number > 0 or k == 0)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dataset", type=Path, default=Config.dataset)
    parser.add_argument("--out", type=Path, default=Config.out)
    parser.add_argument("--depth", choices=("file", "stereo", "none"), default=Config.depth)
    parser.add_argument("--trees", type=Path, default=None)
    parser.add_argument("--picks", type=int, default=None)
    main(Config(**vars(parser.parse_args())))
