"""How well bins were recognised: reliability of the scores, confusion of attitude groups, and a gallery of failures.

    python experiments/recognition_quality.py DATASET RESULTS.csv ANSWERS.json [--trees TREE...] [--out DIR] [--depth D]

RESULTS.csv and ANSWERS.json are what `itree recognize DATASET TREE... -o RESULTS.csv --json ANSWERS.json` wrote. Writes
`reliability.md`, `.svg` and `.json`, `failures.html`, and with the trees `groups.md` and an SVG file for each tree's
confusion. Scenes with failures, with trees all scenes, are looked at again: one or two seconds each.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from itree_cad.load import load_part
from itree_cad.part import Part
from itree_kernels.errors import ItreeError
from itree_kernels.mesh import RayMesh, ray_mesh
from quality.attitude_groups import GroupPair, group_confusion, region_groups, true_groups
from quality.confusion_figure import confusion_picture, confusion_table, confusion_words
from quality.failure_pictures import failure_picture
from quality.failures import Failure, Shape, failures_of, part_shape
from quality.gallery import Card, write_gallery
from quality.reliability_figure import reliability_diagram
from quality.reliability_tables import reliability_report
from quality.seen_scene import region_owners, true_view

from itree_jax.cli.recognize import load_with_trees, with_depth_from
from itree_jax.detections import Step
from itree_jax.evaluation.judged import JudgedScene, judge_answers, scored_answers
from itree_jax.evaluation.pose_errors import Pose
from itree_jax.evaluation.reliability import equal_bins, equal_count_bins
from itree_jax.prepared import Prepared, prepare
from itree_jax.report.scene_pictures import displayed, white_level
from itree_jax.report.scene_view import head_light
from itree_jax.report.svg_file import standalone
from itree_jax.report.tree_path import group_reached
from itree_jax.sensing.scene_folder import Scene, load_scene
from itree_jax.sight import Sight, look
from itree_jax.tree.drawing import leaf_names
from itree_jax.tree.tree_file import load_tree

SAME_HEIGHT = 0.1  # [mm] between a region here and in the JSON: else they are not the same region
Answers = Mapping[int, Mapping[str, Any]]  # of the JSON, by scene


@dataclass(frozen=True)
class Config:
    dataset: Path
    results: Path
    answers: Path
    trees: tuple[Path, ...] = ()
    out: Path = Path("out/recognition_quality")
    depth: str = "auto"  # as the scenes were recognised


@dataclass(frozen=True)
class Parts:
    """The models of the data set by obj_id, and the trees by file name."""

    meshes: Mapping[int, RayMesh]
    shapes: Mapping[int, Shape]
    trees: Mapping[str, Prepared] = field(default_factory=dict)


def main(config: Config) -> None:
    """Writes everything into `config.out`."""
    config.out.mkdir(parents=True, exist_ok=True)
    judged = judge_answers(config.dataset, config.results)
    print(write_reliability(config.out, judged))
    answers = read_answers(config.answers)
    parts = load_parts(config)
    cards: list[Card] = []
    of_answers: dict[str, list[GroupPair]] = {name: [] for name in parts.trees}
    of_regions: dict[str, list[GroupPair]] = {name: [] for name in parts.trees}
    for scene in judged:
        if parts.trees or not scene.right.all() or len(scene.missed):
            seen = see_scene(config, scene, parts)
            cards += scene_cards(seen, answers.get(scene.truth.scene_id, {}))
            for name, prepared in seen.fitting.items():
                truths = groups_of_truth(prepared, scene)
                of_answers[name] += answer_pairs(prepared, scene, answers.get(scene.truth.scene_id, {}), truths)
                of_regions[name] += region_pairs(prepared, seen, truths)
    write_gallery(config.out / "failures.html", f"Failures of {config.results.name}", judged, cards)
    if parts.trees:
        print(write_groups(config.out, parts, of_answers, of_regions))


def write_reliability(out: Path, judged: Sequence[JudgedScene]) -> str:
    """Tables, diagram and the scores themselves; returns the tables."""
    scored = scored_answers(judged)
    report = reliability_report(scored)
    (out / "reliability.md").write_text(report)
    bins = equal_bins(scored.score, scored.right), equal_count_bins(scored.score, scored.right)
    (out / "reliability.svg").write_text(standalone(reliability_diagram(*bins, "Reliability of the score")))
    data = {"score": scored.score.tolist(), "right": scored.right.tolist(),
            "found_visible": scored.found_visible.tolist(), "visible": scored.visible}  # fmt: skip
    (out / "reliability.json").write_text(json.dumps(data) + "\n")
    return report


def read_answers(path: Path) -> Answers:
    """What the JSON says of image 0 of each scene."""
    return {image["scene_id"]: image for image in json.loads(path.read_text())["images"] if image["im_id"] == 0}


def load_parts(config: Config) -> Parts:
    models = sorted((config.dataset / "models").glob("obj_*.ply"))
    parts = {int(path.stem.removeprefix("obj_")): load_part(path) for path in models}
    return Parts(
        {k: part_mesh(part) for k, part in parts.items()}, {k: part_shape(part) for k, part in parts.items()},
        {path.stem: prepare(load_tree(path)) for path in config.trees},
    )  # fmt: skip


def part_mesh(part: Part) -> RayMesh:
    return ray_mesh(part.vertices, part.triangles, part.face_of_triangle)


@dataclass(frozen=True)
class SeenScene:
    """A scene looked at again, as recognition did."""

    judged: JudgedScene
    scene: Scene
    sight: Sight
    parts: Parts
    fitting: Mapping[str, Prepared]  # the trees of its objects and lights, by file name


def see_scene(config: Config, judged: JudgedScene, parts: Parts) -> SeenScene:
    folder = config.dataset / "test" / f"{judged.truth.scene_id:06d}"
    there = {name: p for name, p in parts.trees.items() if p.tree.obj_id in judged.truth.obj_id}
    if there:
        scene, used = load_with_trees(folder, list(there.values()))
    else:
        scene, used = load_scene(folder), []
    scene, second = with_depth_from(config.depth, scene, used[0].tree.sensor if used else scene.sensor)
    sight = look(scene.images, scene.sensor, scene.depth, scene.R_w2c, second)
    fitting = {name: p for name, p in there.items() if any(p is u for u in used)}
    return SeenScene(judged, scene, sight, parts, fitting)


def scene_cards(seen: SeenScene, said: Mapping[str, Any]) -> list[Card]:
    """The failures of one scene with their pictures and reasons."""
    judged, parts = seen.judged, seen.parts
    view = true_view(judged.truth, parts.meshes)
    owner = region_owners(seen.sight.found.labels, view.instance)
    images = seen.scene.images if len(seen.scene.images) else head_light(seen.sight.needle)[None]
    background = displayed(images.mean(axis=0), white_level(images))
    return [
        Card(
            f, judged, failure_picture(background, f, judged, view, parts.meshes),
            answer_of(said, judged, f), [reason_of(said, r, seen.sight.found.height) for r in f.regions],
        )
        for f in failures_of(judged, parts.shapes, owner)
    ]  # fmt: skip


def answer_of(said: Mapping[str, Any], judged: JudgedScene, failure: Failure) -> Mapping[str, Any] | None:
    """What the JSON says of a wrong answer: both files are by falling score. Raises ItreeError when they differ."""
    if failure.answer is None or not said:
        return None
    return json_row(said, judged, failure.answer)


def json_row(said: Mapping[str, Any], judged: JudgedScene, k: int) -> Mapping[str, Any]:
    rows = said["detections"]
    if len(rows) != len(judged.answers) or abs(rows[k]["score"] - judged.answers.score[k]) > 1e-9:
        raise ItreeError(f"scene {judged.truth.scene_id}: the JSON and the csv are not of one run; recognise again.")
    return rows[k]


def reason_of(said: Mapping[str, Any], region: int, height: np.ndarray) -> str:
    """Why a region on a missed instance gave no answer. The region must be as high here as the JSON says."""
    for entry in said.get("not_recognised", ()):
        if entry.get("region") == region:
            told = entry.get("height_mm")
            if told is None or abs(told - height[region]) < SAME_HEIGHT:
                return f"Region {region}: {entry['reason']}."
            return f"Region {region} is not the one that the JSON numbers so."
    return f"Region {region} gave an answer of its own." if said else f"Region {region}: the JSON has no such scene."


def groups_of_truth(prepared: Prepared, judged: JudgedScene) -> np.ndarray:
    """Attitude group of every instance; of another object's -1."""
    mine = judged.truth.obj_id == prepared.tree.obj_id
    groups = np.full(len(mine), -1)
    if mine.any():
        poses = Pose(judged.truth.pose.R[mine], judged.truth.pose.t[mine])
        groups[mine] = true_groups(prepared.tree, prepared.model.mesh, poses, judged.truth.camera)
    return groups


def answer_pairs(
    prepared: Prepared, judged: JudgedScene, said: Mapping[str, Any], truths: np.ndarray
) -> list[GroupPair]:
    """Right answers: the group at the end of the decision path against that of the true pose."""
    pairs = []
    for k in np.flatnonzero(judged.right) if said else ():
        true = int(truths[judged.found[k]])
        steps = [Step(**step) for step in json_row(said, judged, int(k))["decision_path"]]
        named = group_reached(prepared.tree, steps) if true >= 0 else None
        if named is not None:
            pairs.append(GroupPair(true, named, true == named, 1))
    return pairs


def region_pairs(prepared: Prepared, seen: SeenScene, truths: np.ndarray) -> list[GroupPair]:
    """Regions on instances visible by 70 % or more: what the tree says against the group of the true pose."""
    said = region_groups(prepared, seen.scene.images, seen.sight)
    owner = region_owners(seen.sight.found.labels, true_view(seen.judged.truth, seen.parts.meshes).instance)
    return [
        GroupPair(int(truths[j]), int(said.first[r]), bool(said.left[r, truths[j]]), int(said.left[r].sum()))
        for r, j in enumerate(owner) if j >= 0 and truths[j] >= 0 and seen.judged.visible[j]
    ]  # fmt: skip


def write_groups(
    out: Path, parts: Parts, of_answers: Mapping[str, list[GroupPair]], of_regions: Mapping[str, list[GroupPair]]
) -> str:
    """Tables and pictures of every tree; returns the lines with the shares."""
    lines, tables = [], []
    for name, prepared in parts.trees.items():
        tree = prepared.tree
        leaf = leaf_names(tree)
        labels = [f"{leaf.get(g, '-')} {digits}" for g, digits in enumerate(tree.groups.label_strings)]
        for what, pairs in (("regions", of_regions[name]), ("right answers", of_answers[name])):
            confusion = group_confusion(pairs, tree.groups.group_count)
            title = f"{tree.part.name} ({name}), {what}"
            words = confusion_words(confusion, with_left=what == "regions")
            lines.append(f"{title}: {words}")
            if pairs:
                tables.append(f"## {title}\n\n{words}\n\n{confusion_table(confusion, labels)}")
                picture = standalone(confusion_picture(confusion, labels, title))
                (out / f"groups_{name}_{what.replace(' ', '_')}.svg").write_text(picture)
    (out / "groups.md").write_text("\n".join(tables))
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("results", type=Path)
    parser.add_argument("answers", type=Path)
    parser.add_argument("--trees", type=Path, nargs="*", default=[])
    parser.add_argument("--out", type=Path, default=Config.out)
    parser.add_argument("--depth", choices=("auto", "file", "stereo", "none"), default=Config.depth)
    given = vars(parser.parse_args())
    main(Config(**given | {"trees": tuple(given["trees"])}))
