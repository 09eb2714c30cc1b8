"""`itree recognize`: scenes + trees -> poses."""

import shutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro
from itree_kernels.errors import ItreeError

from itree_jax.cli.grasps import GraspPlanner, check_grasp_options, grasp_planner
from itree_jax.cli.kept_scenes import DoneScene, KeptScenes, digest_of, kept_scenes
from itree_jax.cli.outputs import check_file, check_folder, staged_folder
from itree_jax.cli.runtime import start_jax
from itree_jax.cli.terminal import Tell, output, progress, say

if TYPE_CHECKING:
    from itree_jax.detections import Detections
    from itree_jax.grasp import Grasps
    from itree_jax.prepared import Prepared, PreparedForest
    from itree_jax.refinement.self_calibration import SelfCalibration
    from itree_jax.report import IndexEntry
    from itree_jax.sensing.scene_folder import Scene
    from itree_jax.sensor import Sensor
    from itree_jax.stereo.second_camera import SecondCamera

    Forests = dict[tuple[int, ...], PreparedForest]


@dataclass(frozen=True)
class Recognize:
    """Find the poses of compiled parts in scenes.

    Several trees look for several objects. Trees of the same object, compiled for different lights, are alternatives:
    every scene takes the one that fits its lights.
    """

    scenes: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="SCENES")]
    """Dataset, folder of scenes, or one scene folder."""
    trees: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="TREE...")]
    """One or more tree files."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="results.csv")]
    """BOP csv to write."""
    json: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Write everything about every answer, decision paths included, as JSON."""
    report: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Write a page per scene, and an index."""
    world: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Write the world model of every scene as GLB and PLY: parts, prisms for what is not recognised, bin."""
    depth: Literal["auto", "file", "stereo", "none"] = "auto"
    """Where depth comes from: the folder's depth map; the second camera (two needle maps); nowhere, so that a part's
    size alone tells how far it is; auto takes the first of these that there is."""
    self_calibrate: bool = False
    """Correct the lights by the parts found and recognise again with them; writes results.lights.json beside the
    csv."""
    gripper: Annotated[str | None, tyro.conf.arg(metavar="GRIPPER")] = None
    """TOML file of a gripper, or bundled:jaw, bundled:cup; with --grasps."""
    grasps: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Write the grasps that collide with nothing, and the reasons where there is none, as JSON."""
    hand_eye: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Camera -> robot as JSON, {"R": [9], "t": [3, mm]}: grasps are given in the robot's frame too."""
    resume: bool = False
    """Keep every scene when it is done, in a folder results.csv.progress. A run that was stopped goes on where it was
    when the same command is given again; the outputs are written, and the folder goes, when all scenes are done."""
    quiet: bool = False
    """Show nothing but warnings and errors."""

    def run(self) -> None:
        """Raises ItreeError about a tree or a scene, before anything is written."""
        self._check()
        with progress(self.quiet) as tell, kept_scenes(self.output, self.resume) as kept:
            tell("loading", 0.0)
            start_jax()
            done = self._recognized(kept, tell)
            tell("writing", 1.0)
            answers = self._write(done, kept)
        if not self.quiet:
            output().print(answer_table(answers["images"]))
            say_lights({one.name: one.lights for one in done if one.lights is not None})

    def _recognized(self, kept: KeptScenes, tell: Tell) -> list[DoneScene]:
        """All scenes, one after the other; those that a stopped run has kept are not recognised again."""
        from itree_jax.prepared import prepare
        from itree_jax.sensing.scene_folder import scene_folders
        from itree_jax.tree.tree_file import load_tree

        planner = None if self.gripper is None else grasp_planner(self.gripper, self.hand_eye)
        prepared = [prepare(load_tree(path)) for path in self.trees]
        check_objects(prepared)
        folders = scene_folders(self.scenes)
        check_numbered(folders)
        kept.check_run(**self._inputs())
        known = {folder: kept.find(folder) for folder in folders}
        forests: Forests = {}
        done = []
        for k, folder in enumerate(folders):
            tell(f"scene {folder.name}", k / len(folders))
            one = known[folder]
            if one is None:
                one = self._recognize(folder, prepared, forests, planner, kept)
                kept.keep(folder, one)
            elif None in known.values():  # a tree that was compiled for this scene is needed by later ones
                prepared += trees_for_more_lights(folder, prepared, self.quiet)
            done.append(one)
        return done

    def _recognize(
        self, folder: Path, prepared: "list[Prepared]", forests: "Forests", planner: GraspPlanner | None,
        kept: KeptScenes,
    ) -> DoneScene:
        from itree_jax.results import results_document

        lights: dict[str, SelfCalibration] | None = {} if self.self_calibrate else None
        try:
            scene, fitting, found = answer(folder, prepared, forests, self.quiet, self.depth, lights)
        except ItreeError as error:
            if not self.resume:
                raise
            raise ItreeError(f"{error} The scenes before it are kept for --resume in {kept.folder}.") from error
        grasps = None if planner is None else planner.plan(scene, found, fitting)
        card = None if self.report is None else _write_page(kept.pages, scene, found, fitting, grasps)
        if self.world is not None:
            _write_model(kept.models, scene, found, fitting)
        told = None if grasps is None else _grasps_told(found, grasps)
        return DoneScene(folder.name, results_document([found]), told, card, next(iter((lights or {}).values()), None))

    def _write(self, done: list[DoneScene], kept: KeptScenes) -> dict[str, Any]:
        """All outputs, and the results of all scenes."""
        from itree_jax.refinement.light_corrections import joined_corrections
        from itree_jax.results import joined_documents, write_csv_document, write_json_document

        answers = joined_documents(one.answers for one in done)
        if self.report is not None:
            _write_index(kept.pages, [one.card for one in done if one.card is not None])
            _publish(kept.pages, self.report)
        if self.world is not None:
            _publish(kept.models, self.world)
        write_csv_document(answers, self.output)
        if self.json is not None:
            write_json_document(answers, self.json)
        if self.grasps is not None:
            from itree_jax.grasp import grasps_document

            write_json_document(grasps_document([one.grasps for one in done if one.grasps is not None]), self.grasps)
        if self.self_calibrate:
            corrected = [one for one in done if one.lights is not None]
            scenes = {one.name: one.answers["images"][0]["lights"] for one in corrected}
            found = [one.lights for one in corrected if one.lights is not None]
            write_json_document(joined_corrections(scenes, found), self.lights_file)
        return answers

    def _inputs(self) -> dict[str, Any]:
        """What the answers depend on beside the scenes, and what is kept of them."""
        gripper = self.gripper if self.gripper is None or self.gripper.startswith("bundled:") else Path(self.gripper)
        return {
            "trees": [digest_of(path) for path in self.trees],
            "gripper": digest_of(gripper) if isinstance(gripper, Path) else gripper,
            "hand-eye": None if self.hand_eye is None else digest_of(self.hand_eye),
            "options": [self.depth, self.self_calibrate, self.report is not None, self.world is not None],
        }

    @property
    def lights_file(self) -> Path:
        return self.output.with_name(f"{self.output.stem}.lights.json")

    def _check(self) -> None:
        if not self.trees:
            raise ItreeError("no TREE is given; make one with `itree compile MODEL --sensor SENSOR -o TREE`")
        check_file(self.output)
        check_file(self.json)
        check_file(self.lights_file if self.self_calibrate else None)
        check_file(self.grasps)
        check_grasp_options(self.gripper, self.hand_eye, self.grasps)
        check_folder(self.report)
        check_folder(self.world)


def answer(
    folder: Path, prepared: "list[Prepared]", forests: "Forests", quiet: bool, depth: str = "auto",
    lights: "dict[str, SelfCalibration] | None" = None,
) -> "tuple[Scene, list[Prepared], Detections]":
    """A scene, the trees that fit its lights, and what they found in it; errors name the scene.

    Trees that had to be compiled for the scene's number of lights are added to `prepared`, and a forest that is not
    known yet to `forests`. With `lights`, the lights are corrected by the parts found, the scene recognised again where
    that is kept, and the correction added to `lights` under the folder's name.
    """
    try:
        prepared += trees_for_more_lights(folder, prepared, quiet)
        scene, fitting = load_with_trees(folder, prepared)
        scene, second = with_depth_from(depth, scene, fitting[0].tree.sensor)
        found = recognize_scene(scene, forest_of(fitting, forests), second)
        if lights is not None:
            scene, found = recalibrated(scene, fitting, found, forests, lights, second)
        return scene, fitting, found
    except ItreeError as error:
        raise ItreeError(f"scene {folder}: {error} Nothing was written.") from error


def with_depth_from(source: str, scene: "Scene", sensor: "Sensor") -> "tuple[Scene, SecondCamera | None]":
    """The scene with its depth map or without, and what its second camera saw if depth is to come from there."""
    from itree_jax.stereo.second_file import load_second

    if source == "file" and scene.depth is None:
        raise ItreeError("there is no depth map (depth/) in the scene; try --depth stereo or --depth none.")
    if source in ("auto", "file") and scene.depth is not None:
        return scene, None
    second = None if source == "none" else load_second(scene, sensor)
    if source == "stereo" and second is None:
        raise ItreeError("there is no second camera (scene_stereo.json) in the scene; try --depth none.")
    return replace(scene, depth=None), second


def recalibrated(
    scene: "Scene", fitting: "list[Prepared]", found: "Detections", forests: "Forests",
    lights: "dict[str, SelfCalibration]", second: "SecondCamera | None" = None,
) -> "tuple[Scene, Detections]":
    """The scene with corrected lights and what is found under them, if the correction is kept; else as they are.
    A depth camera has no lights to correct.
    """
    from itree_jax.refinement.light_corrections import corrections_to_json
    from itree_jax.refinement.self_calibration import calibrated_by_answers

    if scene.sensor.is_depth_camera:
        return scene, found
    correction = calibrated_by_answers(found, fitting, scene.images, scene.sensor, scene.depth)
    if correction is None:
        return scene, found
    lights[scene.folder.name if scene.folder else ""] = correction
    if correction.kept:
        scene = replace(scene, sensor=correction.sensor)
        if second is not None:
            second = second.with_lights_of(scene.sensor)
        again = recognize_scene(scene, forest_of(fitting, forests), second)
        found = replace(again, time=found.time + again.time)
    return scene, replace(found, lights=corrections_to_json(correction))


def say_lights(lights: "dict[str, SelfCalibration]") -> None:
    """How the lights were corrected, a line per scene."""
    from itree_jax.refinement.light_corrections import corrections_in_words

    for name, correction in lights.items():
        say(f"lights by scene {name}: {corrections_in_words(correction)}", quiet=False)


def load_with_trees(folder: Path, prepared: "Sequence[Prepared]") -> "tuple[Scene, list[Prepared]]":
    """A scene, and one tree per object that fits its lights. What a scene folder can't tell (noise, response, limits)
    is taken from the sensor that the trees were compiled for."""
    from itree_jax.sensing.scene_folder import load_scene

    scene = load_scene(folder, sensor=prepared[0].tree.sensor)
    fitting = fitting_trees(prepared, scene.sensor)
    if fitting[0] is not prepared[0]:
        scene = load_scene(folder, sensor=fitting[0].tree.sensor)
    return scene, fitting


def trees_for_more_lights(folder: Path, prepared: "Sequence[Prepared]", quiet: bool) -> "list[Prepared]":
    """Trees compiled here for a scene taken under another number of lights than any tree of an object knows.

    Another number of lights is another rig, and a tree holds all it takes to compile its part for it. Lights that have
    only moved are refused instead (`check_sensor`): that is more likely a mistake in the calibration.
    """
    from itree_jax.compile import compile_tree
    from itree_jax.prepared import prepare
    from itree_jax.sensing.scene_folder import load_scene

    made = []
    for obj_id in dict.fromkeys(one.tree.obj_id for one in prepared):
        known = [one.tree for one in prepared if one.tree.obj_id == obj_id]
        sensor = load_scene(folder, sensor=known[0].sensor).sensor
        # a depth camera is not another number of lights but another kind of sensor: `check_sensor` says what to do
        known = [tree for tree in known if tree.sensor.is_depth_camera == sensor.is_depth_camera]
        if not known or any(tree.sensor.light_count == sensor.light_count for tree in known):
            continue
        old = known[0]
        if not quiet:
            known_for = f"the tree of '{old.part.name}' was compiled for {old.sensor.light_count}"
            notice = f"scene {folder.name} has {sensor.light_count} lights, {known_for}; compiling it for these"
            print(f"itree: {notice}", file=sys.stderr)
        digits = len(old.groups.identifying_faces)
        made.append(prepare(compile_tree(
            old.part, sensor, obj_id=obj_id, policy=old.policy, dome_frequency=old.groups.frequency, label_faces=digits,
            seed=old.seed,
        )))
    return made


def fitting_trees(prepared: "Sequence[Prepared]", sensor: "Sensor") -> "list[Prepared]":
    """The first tree of every object that fits the lights and the camera; ItreeError when an object has none."""
    from itree_jax.tree.check_sensor import check_sensor

    found: dict[int, Prepared] = {}
    misfit: dict[int, ItreeError] = {}
    for one in prepared:
        tree = one.tree
        if tree.obj_id in found:
            continue
        try:  # the slant limit is the tree's own: a scene folder tells none
            check_sensor(tree, replace(sensor, slant_limit=tree.sensor.slant_limit))
            found[tree.obj_id] = one
        except ItreeError as error:
            misfit.setdefault(tree.obj_id, error)
    for obj_id, error in misfit.items():
        if obj_id not in found:
            raise error
    return list(found.values())


def forest_of(fitting: "list[Prepared]", forests: "Forests") -> "PreparedForest | list[Prepared]":
    """Several trees as a forest, its root made once for all scenes that they fit."""
    from itree_jax.prepared import prepare_forest

    if len(fitting) < 2:
        return fitting
    key = tuple(id(one) for one in fitting)
    if key not in forests:
        forests[key] = prepare_forest(fitting)
    return forests[key]


def recognize_scene(
    scene: "Scene", prepared: "PreparedForest | Sequence[Prepared]", second: "SecondCamera | None" = None
) -> "Detections":
    """The answers for a scene, under the scene's numbers. Depth is the scene's, or comes from a second camera."""
    from itree_jax.recognition import recognize_one

    answer = recognize_one(prepared, scene.images, scene.sensor, scene.depth, scene.R_w2c, second)
    own = {"scene_id": scene.scene_id, "im_id": scene.im_id}
    return replace(answer, **own, detections=tuple(replace(d, **own) for d in answer))


def check_objects(prepared: "Sequence[Prepared]") -> None:
    """Raises ItreeError when two different parts have one object number."""
    from itree_jax.tree import forest

    forest.check_objects([one.tree for one in prepared])


def check_numbered(folders: Sequence[Path]) -> None:
    """Raises ItreeError when scenes could not be told apart in the results."""
    wrong = [folder for folder in folders if not folder.name.isdecimal()] if len(folders) > 1 else []
    if wrong:
        raise ItreeError(f"{wrong[0]}: among several scenes, each folder's name must be its number, such as 000001")


def answer_table(images: "Sequence[dict[str, Any]]"):
    """Parts found, best score and time of every scene of a results document."""
    from rich.table import Table

    table = Table("scene", "parts", "best score", "not recognised", "s")
    for a in images:
        best = f"{a['detections'][0]['score']:.2f}" if a["detections"] else "-"
        found, lost = str(len(a["detections"])), str(len(a["not_recognised"]))
        table.add_row(f"{a['scene_id']:06d}", found, best, lost, f"{a['time']:.1f}")
    return table


def _grasps_told(found: "Detections", grasps: "Grasps") -> dict[str, Any]:
    from itree_jax.grasp import grasps_to_json  # without grasps, the collisions of grippers need not be imported
    from itree_jax.results import plain_json

    return plain_json(grasps_to_json(found, grasps))


def _publish(kept: Path, folder: Path) -> None:
    """Copies what is kept of the scenes, which may be on another disk, to where it was asked for."""
    with staged_folder(folder) as stage:
        shutil.copytree(kept, stage, dirs_exist_ok=True)


def _write_model(models: Path, scene: "Scene", found: "Detections", fitting: "Sequence[Prepared]") -> None:
    from itree_jax.report import write_world
    from itree_jax.world import load_bin, world_model

    trees = [p.tree for p in fitting]
    world = world_model(found, trees, scene.sensor, scene.depth, scene.R_w2c, load_bin(scene))
    write_world(world, models, f"scene_{found.scene_id:06d}")


def _write_page(
    pages: Path, scene: "Scene", found: "Detections", fitting: "Sequence[Prepared]", grasps: "Grasps | None"
) -> "IndexEntry":
    from itree_jax.report import report_scene, true_poses

    page, trees = pages / f"scene_{found.scene_id:06d}.html", [p.tree for p in fitting]
    return report_scene(page, scene, found, trees, true_poses(scene), grasps)


def _write_index(pages: Path, entries: "Sequence[IndexEntry]") -> None:
    from itree_jax.report import write_index

    write_index(pages, entries)
