"""A scene looked at again as recognition did, for what its answers' JSON does not keep: regions, and where they lie."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from itree_cad.load import load_part
from itree_kernels.errors import ItreeError
from itree_kernels.mesh import RayMesh, ray_mesh
from jaxtyping import Float, Int

from itree_jax.cli.scene_answer import load_with_trees, with_depth_from
from itree_jax.evaluation.judged import JudgedScene
from itree_jax.prepared import Prepared, prepare
from itree_jax.report.pose_render import render_pose
from itree_jax.report.scene_pictures import Picture, displayed, white_level
from itree_jax.report.scene_view import head_light
from itree_jax.sensing.scene_folder import Scene, load_scene
from itree_jax.sight import Sight, look
from itree_jax.tree.tree_file import load_tree
from quality.failure_pictures import failure_picture
from quality.failures import Shape, failures_of, part_shape
from quality.gallery import Card
from quality.true_view import TrueView, pieces_on, region_owners, shares_on_instances, true_view

SAME_HEIGHT = 0.1  # [mm] between a region here and in the JSON: else they are not the same region
Said = Mapping[str, Any]  # of one image, as in `results.schema.json`; empty where there is none


@dataclass(frozen=True)
class Parts:
    """The models of a data set by obj_id, and trees by the names of their files."""

    meshes: Mapping[int, RayMesh]
    shapes: Mapping[int, Shape]
    trees: Mapping[str, Prepared] = field(default_factory=dict)


@dataclass(frozen=True)
class SeenScene:
    """One scene with its truth, its answers, and what there was to see."""

    judged: JudgedScene
    said: Said
    scene: Scene
    sight: Sight
    parts: Parts
    trees: Mapping[str, Prepared]  # of its objects and lights, by file name

    @cached_property
    def view(self) -> TrueView:
        return true_view(self.judged.truth, self.parts.meshes)

    @cached_property
    def owner(self) -> Int[np.ndarray, "regions"]:
        """Instance that each region lies on, -1 none."""
        return region_owners(self.sight.found.labels, self.view.instance)

    @property
    def background(self) -> Picture:
        images = self.scene.images if len(self.scene.images) else head_light(self.sight.needle)[None]
        return displayed(images.mean(axis=0), white_level(images))


def load_parts(dataset: Path, trees: tuple[Path, ...]) -> Parts:
    """Every model of the data set, and the trees."""
    models = sorted((dataset / "models").glob("obj_*.ply"))
    parts = {int(path.stem.removeprefix("obj_")): load_part(path) for path in models}
    meshes = {k: ray_mesh(p.vertices, p.triangles, p.face_of_triangle) for k, p in parts.items()}
    shapes = {k: part_shape(part) for k, part in parts.items()}
    return Parts(meshes, shapes, {path.stem: prepare(load_tree(path)) for path in trees})


def look_again(dataset: Path, judged: JudgedScene, said: Said, parts: Parts, depth: str) -> SeenScene:
    """`depth` says where depth came from, as `itree recognize --depth` does.

    Without a tree for a scene's objects and number of lights, the limits and the noise that a scene folder can't tell
    are the defaults.
    """
    folder = dataset / "test" / f"{judged.truth.scene_id:06d}"
    scene, used = load_scene(folder), []
    there = {
        name: p for name, p in parts.trees.items()
        if p.tree.obj_id in judged.truth.obj_id and p.tree.sensor.light_count == scene.sensor.light_count
    }
    if there:
        scene, used = load_with_trees(folder, list(there.values()))
    scene, second = with_depth_from(depth, scene, used[0].tree.sensor if used else scene.sensor)
    sight = look(scene.images, scene.sensor, scene.depth, scene.R_w2c, second)
    fitting = {name: p for name, p in there.items() if any(p is u for u in used)}
    return SeenScene(judged, said, scene, sight, parts, fitting)


def failure_cards(seen: SeenScene) -> list[Card]:
    """The failures of the scene with their pictures and reasons."""
    judged, meshes, background = seen.judged, seen.parts.meshes, seen.background
    poses = zip(judged.answers.obj_id.tolist(), judged.answers.R, judged.answers.t, strict=True)
    answered = [render_pose(meshes[o], R, t, judged.truth.camera) for o, R, t in poses]
    failures = failures_of(judged, seen.parts.shapes, shares_on_instances(answered, seen.view), seen.owner)
    return [
        Card(
            failure=f, judged=judged, picture=failure_picture(background, f, judged, seen.view, meshes),
            answer=None if f.answer is None else answer_said(seen.said, judged, f.answer),
            reasons=reasons_of(seen, f.instance) if f.answer is None and f.instance is not None else (),
        )
        for f in failures
    ]  # fmt: skip


def answer_said(said: Said, judged: JudgedScene, k: int) -> Said | None:
    """What the JSON says of answer `k` (both files are by falling score); None without it.

    Raises ItreeError when the two files are not of one run.
    """
    if not said:
        return None
    rows = said["detections"]
    if len(rows) != len(judged.answers) or abs(rows[k]["score"] - judged.answers.score[k]) > 1e-9:
        raise ItreeError(
            f"scene {judged.truth.scene_id}: the csv has {len(judged.answers)} answers, the JSON {len(rows)}, or their "
            "scores differ: they are not of one run. Recognise again with -o and --json together."
        )
    return rows[k]


def reasons_of(seen: SeenScene, instance: int) -> list[str]:
    """Why the regions on a missed instance gave no answer, and how much of it there was to see."""
    found, on = seen.sight.found, seen.view.instance == instance
    lines = [
        f"Region {p.region} ({p.on_instance} of its {p.whole} px): {reason_said(seen.said, p.region, found.height)}."
        for p in pieces_on(found.labels, seen.view.instance, instance)
    ]
    if not on.any():
        return ["No pixel of it is in the image."]
    needles, regions = np.asarray(seen.sight.needle.interpretable)[on].mean(), (found.labels[on] >= 0).mean()
    return [*lines, f"Of its pixels {100 * needles:.0f} % have needles and {100 * regions:.0f} % lie in regions."]


def reason_said(said: Said, region: int, height: Float[np.ndarray, "regions"]) -> str:
    """Why a region gave no answer, as the JSON tells it. The region must be as high here as there."""
    if not said:
        return "the JSON has no such scene"
    for entry in said["not_recognised"]:
        if entry.get("region") == region:
            told = entry.get("height_mm")
            same = told is None or abs(told - height[region]) < SAME_HEIGHT
            return entry["reason"] if same else "the JSON numbers the regions in another way"
    return "it gave an answer of its own"
