"""The scenes of a data set of bins one by one, each with its part's prepared tree and with what is true in it."""

import argparse
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

from evaluate_scenes import Config as Evaluation
from evaluate_scenes import light_count, scenes_of_parts, tree_of

from itree_jax.evaluation.truth import Model, SceneTruth, load_models, load_truth
from itree_jax.prepared import Prepared, prepare
from itree_jax.tree.tree_file import load_tree

TreeFile = Callable[[int, int, Path], Path]  # object, number of lights, a scene with them -> its tree


class TrueScene(NamedTuple):
    """A scene of one part."""

    folder: Path
    prepared: Prepared  # the part's tree for as many lights as the scene has
    truth: SceneTruth
    model: Model


def true_scenes(bins: Path, out: Path, trees: Path | None, every: int) -> Iterator[TrueScene]:
    """Every n-th scene of each part; trees are those of an earlier run, or compiled into `out`."""
    models, truths = load_models(bins), {t.scene_id: t for t in load_truth(bins)}
    evaluation = Evaluation(dataset=bins, out=out, trees=trees)
    out.mkdir(parents=True, exist_ok=True)
    for obj_id, folder, prepared in prepared_scenes(bins, partial(tree_of, evaluation), every):
        yield TrueScene(folder, prepared, truths[int(folder.name)], models[obj_id])


def prepared_scenes(dataset: Path, tree_file: TreeFile, every: int = 1) -> Iterator[tuple[int, Path, Prepared]]:
    """Object, scene and tree, part after part; a tree is prepared once and kept as long as its part lasts."""
    for obj_id, folders in scenes_of_parts(dataset):
        prepared: dict[int, Prepared] = {}
        for folder in folders[::every]:
            lights = light_count(folder)
            if lights not in prepared:
                prepared[lights] = prepare(load_tree(tree_file(obj_id, lights, folder)))
            yield obj_id, folder, prepared[lights]


def bins_parser(told: str | None, every: int) -> argparse.ArgumentParser:
    """Options that tell `true_scenes` what to take; `told` is the script's docstring."""
    parser = argparse.ArgumentParser(description=told, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bins", type=Path, default=Path("out/validation_bins"))
    parser.add_argument("--trees", type=Path, default=None)
    parser.add_argument("--every", type=int, default=every, help="takes every n-th scene of each part")
    return parser
