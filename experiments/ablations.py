"""What each step of recognition is worth: the same scenes without it.

    python experiments/ablations.py [--dataset DIR] [--depth file|stereo|none] [--out DIR] [--trees DIR] [--every N]

Configurations: everything; no backtracking (the first reading alone); no challenge (accepted poses meet no turned ones,
and are not polished); no very last step; no refinement (the attitudes as the tree gives them, ranked and verified all
the same); no verification (of every region the pose that the tree finds likeliest among the refined ones); no
reflectance (needles by Lambert's law); reflected light left in (that between the parts found is not taken out of the
images); and the tree of policy `paper`. The data set defaults to `scenes` in the folder that ITREE_DATA names.
"""

import argparse
import json
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from evaluate_scenes import Config as Evaluation
from evaluate_scenes import run, scenes_of_parts
from quality.comparison import compare_configurations
from true_scenes import prepared_scenes

from itree_jax import competition, interpreting, narrowing, recognition, settling
from itree_jax.answers import Interpretation
from itree_jax.cli.scene_answer import load_with_trees, recognize_scene, with_depth_from
from itree_jax.refinement.hypotheses import RegionHypotheses
from itree_jax.refinement.optimise import Hypotheses
from itree_jax.refinement.select import Judged, Selection, measures_alone
from itree_jax.results import write_bop_csv
from itree_jax.sensing import reading
from itree_jax.sensing.material_response import MaterialResponse


@dataclass(frozen=True)
class Config:
    dataset: Path = Evaluation.dataset
    depth: str = "file"
    out: Path = Path("out/ablations")
    trees: Path | None = None
    every: int = 1
    only: tuple[str, ...] = ()


@contextmanager
def everything() -> Iterator[None]:
    yield


@contextmanager
def no_backtracking() -> Iterator[None]:
    with patch.object(recognition, "search_deeper", lambda forest, images, sight, answers: answers):
        yield


@contextmanager
def no_refinement() -> Iterator[None]:
    def stay(hypotheses: Hypotheses, *_: Any) -> Hypotheses:
        return hypotheses

    with patch.object(narrowing, "refine", stay), patch.object(settling, "refine", stay):
        yield


@contextmanager
def no_challenge() -> Iterator[None]:
    """Accepted poses meet no turned ones, and are not polished."""
    with (
        patch.object(interpreting, "challenged", lambda answer, sight: answer),
        patch.object(recognition, "settled", lambda answers, sight: answers),
    ):
        yield


@contextmanager
def no_very_last_step() -> Iterator[None]:
    with patch.object(recognition, "exact", lambda answers, sight: answers):
        yield


@contextmanager
def no_verification() -> Iterator[None]:
    """Every region answers with its likeliest attitude: nothing competes."""

    def taken(judged: Judged, hypotheses: RegionHypotheses) -> Selection:
        log_p = hypotheses.log_likelihood
        best = [
            int(mine[np.argmax(log_p[mine])])
            for region in np.unique(hypotheses.region)
            for mine in [np.flatnonzero(hypotheses.region == region)]
        ]
        accepted = np.array([h for h in best if np.isfinite(log_p[h])], int)
        alone = measures_alone(judged)
        measures = type(alone)(*(np.asarray(m)[accepted] for m in alone))
        nobody = (np.zeros(0, int), np.zeros(0))
        return Selection(accepted, np.full(len(log_p), 0.5), ("",) * len(log_p), measures, (nobody,) * len(accepted))

    def of_all(answers: list[Interpretation], *_: Any) -> list[Selection]:
        return [taken(a.judged, a.hypotheses) for a in answers]

    with ExitStack() as stack:
        stack.enter_context(patch.object(competition, "select", lambda judged, _, given, __: taken(judged, given)))
        stack.enter_context(patch.object(competition, "selections", of_all))
        stack.enter_context(patch.object(Selection, "from_score", lambda selection, least: selection))
        stack.enter_context(no_backtracking())
        stack.enter_context(no_challenge())
        yield


@contextmanager
def no_reflectance() -> Iterator[None]:
    with (
        patch.object(recognition, "responses_of_parts", lambda *_: None),
        patch.object(reading, "response_of_depth", lambda *_: MaterialResponse(1.0, {}, 0)),
    ):
        yield


@contextmanager
def reflected_light_left_in() -> Iterator[None]:
    """Without a depth map the images are read as they are, unless parts tell the material's response. With one that
    light stays in anyway.
    """
    with patch.object(recognition, "subtract_reflections", lambda *_: None):
        yield


CONFIGURATIONS: dict[str, Callable[[], Any]] = {
    "everything": everything,
    "no backtracking": no_backtracking,
    "no challenge": no_challenge,
    "no very last step": no_very_last_step,
    "no refinement": no_refinement,
    "no verification": no_verification,
    "no reflectance": no_reflectance,
    "reflected light left in": reflected_light_left_in,
    "policy paper": everything,
}


def main(config: Config) -> None:
    """Recognises every scene in every configuration, and prints one table."""
    config.out.mkdir(parents=True, exist_ok=True)
    config = replace(config, dataset=some_scenes(config))
    csv_of = {}
    for name, configured in CONFIGURATIONS.items():
        if config.only and name not in config.only:
            continue
        csv = config.out / f"{name.replace(' ', '_')}.csv"
        with configured():
            answers = list(answers_of(config, "paper" if name == "policy paper" else "measured"))
        write_bop_csv(answers, csv)
        csv_of[name] = csv
        print(compare_configurations(config.dataset, csv_of), flush=True)
    (config.out / "table.md").write_text(compare_configurations(config.dataset, csv_of))


def some_scenes(config: Config) -> Path:
    """A data set of links to every n-th scene of each part."""
    dataset = config.out / "dataset"
    shutil.rmtree(dataset, ignore_errors=True)
    (dataset / "test").mkdir(parents=True)
    (dataset / "models").symlink_to((config.dataset / "models").resolve())
    records = json.loads((config.dataset / "scenes.json").read_text())
    taken = [folder for _, folders in scenes_of_parts(config.dataset) for folder in folders[:: config.every]]
    for folder in taken:
        (dataset / "test" / folder.name).symlink_to(folder.resolve())
    (dataset / "scenes.json").write_text(json.dumps({folder.name: records[folder.name] for folder in taken}))
    return dataset


def answers_of(config: Config, policy: str) -> Iterator[Any]:
    trees = partial(tree_file, config, policy)
    for _, folder, prepared in prepared_scenes(config.dataset, trees):
        scene, fitting = load_with_trees(folder, [prepared])
        scene, second = with_depth_from(config.depth, scene, fitting[0].tree.sensor)
        yield replace(recognize_scene(scene, fitting, second), labels=None)


def tree_file(config: Config, policy: str, obj_id: int, lights: int, folder: Path) -> Path:
    """That of an earlier run, or compiled here."""
    name = f"obj_{obj_id:06d}_{lights}.tree"
    if policy == "measured" and config.trees is not None and (config.trees / name).is_file():
        return config.trees / name
    path = config.out / f"{policy}_{name}"
    if not path.is_file():
        model = config.dataset / "models" / f"obj_{obj_id:06d}.ply"
        run("compile", model, "--sensor", folder, "-o", path, "--obj-id", obj_id, "--policy", policy)
    return path


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dataset", type=Path, default=Config.dataset)
    parser.add_argument("--depth", choices=("file", "stereo", "none"), default=Config.depth)
    parser.add_argument("--out", type=Path, default=Config.out)
    parser.add_argument("--trees", type=Path, default=None)
    parser.add_argument("--every", type=int, default=1, help="takes every n-th scene of each part")
    parser.add_argument("--only", nargs="+", choices=list(CONFIGURATIONS), default=())
    given = vars(parser.parse_args())
    main(Config(**given | {"only": tuple(given["only"])}))
