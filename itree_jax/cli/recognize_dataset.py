"""`itree evaluate --recognize`: a dataset of scenes recognised, one unit of work per scene."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, NamedTuple

from itree_kernels.errors import ItreeError
from itree_kernels.whole_files import write_whole

from itree_jax.cli.recognize import check_numbered
from itree_jax.cli.runtime import start_jax
from itree_jax.cli.scene_answer import forest_of, load_with_trees, recognize_scene, with_depth_from
from itree_jax.cluster import Product, Ran, Unit, digest_of_file, digest_of_listing, key_of

if TYPE_CHECKING:
    from itree_jax.cli.scene_answer import Forests
    from itree_jax.prepared import Prepared

CSV = "results.csv"
READ = ("scene_*.json", "lit/*", "depth/*")  # of a scene's folder: what recognition depends on
TRUTH = ("scene_gt.json", "scene_gt_info.json")  # what it must not depend on
NOT_TIMED = -1.0  # BOP's word for it


@dataclass(frozen=True)
class TreeFile:
    """A tree on a disk that all workers see."""

    path: str
    digest: str  # sha256


@dataclass(frozen=True)
class SceneTask:
    """One scene to recognise."""

    folder: str
    trees: tuple[TreeFile, ...]
    depth: str


class Trees(NamedTuple):
    """Trees that are prepared, and the forests made of them so far."""

    prepared: "tuple[Prepared, ...]"
    forests: "Forests"


def recognize_folder(task: SceneTask) -> Product:
    """The answers for a scene, as the file that `itree recognize --json` would write of it, without the time.

    A scene under other lights than any tree knows is refused: what is evaluated are the trees that were given.
    """
    start_jax()
    from itree_jax.results import results_document

    trees = prepared_trees(task.trees)
    scene, fitting = load_with_trees(Path(task.folder), trees.prepared)
    scene, second = with_depth_from(task.depth, scene, fitting[0].tree.sensor)
    found = replace(recognize_scene(scene, forest_of(fitting, trees.forests), second), time=NOT_TIMED)
    text = json.dumps(results_document([found]), indent=1, allow_nan=False) + "\n"
    return Product({answer_file(Path(task.folder)): text.encode()}, {"answers": len(found)})


@lru_cache(maxsize=1)
def prepared_trees(files: tuple[TreeFile, ...]) -> Trees:
    """The trees of a dataset, prepared once per process. Raises ItreeError when a file isn't the one that is meant."""
    from itree_jax.prepared import prepare
    from itree_jax.tree.tree_file import load_tree

    for file in files:
        if digest_of_file(file.path) != file.digest:
            raise ItreeError(f"{file.path} is not the same file here as where the command was given")
    return Trees(tuple(prepare(load_tree(file.path)) for file in files), {})


def scene_units(dataset: Path, trees: Sequence[Path], depth: str) -> list[Unit]:
    """A unit per scene of a dataset.

    Raises ItreeError when a tree can't be read, two parts have one object number, or a scene has no number.
    """
    from itree_jax.sensing.scene_folder import scene_folders
    from itree_jax.tree.forest import check_objects
    from itree_jax.tree.tree_file import load_tree

    check_objects([load_tree(path) for path in trees])
    folders = scene_folders(dataset)
    check_numbered(folders)
    files = tuple(TreeFile(str(path.absolute()), digest_of_file(path)) for path in trees)
    same = {"trees": [file.digest for file in files], "depth": depth, "version": version("itree-jax")}
    return [
        Unit(
            folder.name, key_of(scene=digest_of_listing(files_read(folder)), **same),
            SceneTask(str(folder.absolute()), files, depth),
        )
        for folder in folders
    ]  # fmt: skip


def files_read(folder: Path) -> list[Path]:
    """The files of a scene that its answers depend on."""
    return [path for pattern in READ for path in folder.glob(pattern) if path.name not in TRUTH]


def answer_file(folder: Path) -> str:
    return f"scenes/{folder.name}.json"


def write_csv(ran: Ran, folder: Path) -> Path:
    """`results.csv` of all scenes that are done, by scene; the time of a scene is none of its columns' business."""
    from itree_jax.results import CSV_COLUMNS, csv_lines

    lines = [",".join(CSV_COLUMNS)]
    for one in ran.done:
        lines += csv_lines(json.loads((folder / answer_file(Path(one.name))).read_text(encoding="utf-8")))
    write_whole(folder / CSV, ("\n".join(lines) + "\n").encode())
    return folder / CSV


def dataset_line(ran: Ran, folder: Path) -> str:
    """What a run did, in one line."""
    earlier = f"{ran.resumed} of them by an earlier run, " if ran.resumed else ""
    middle = f", median {median(one.seconds for one in ran.done):.2f} s per scene" if ran.done else ""
    return f"{folder / CSV}: {len(ran.done)} scenes, {earlier}{ran.seconds:.0f} s of work{middle}"
