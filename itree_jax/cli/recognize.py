"""`itree recognize`: scenes + trees -> poses."""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro
from itree_kernels.errors import ItreeError

from itree_jax.cli.grasps import GraspPlanner, check_grasp_options, grasp_planner
from itree_jax.cli.kept_scenes import DoneScene, KeptScenes, digest_of, kept_scenes
from itree_jax.cli.outputs import check_file, check_folder, staged_folder
from itree_jax.cli.runtime import start_jax
from itree_jax.cli.scene_answer import answer, trees_for_more_lights
from itree_jax.cli.terminal import Tell, output, progress, say
from itree_jax.input_check import check_picks

if TYPE_CHECKING:
    from itree_jax.cli.scene_answer import Forests
    from itree_jax.detections import Detections
    from itree_jax.grasp import Grasps
    from itree_jax.prepared import Prepared
    from itree_jax.refinement.self_calibration import SelfCalibration
    from itree_jax.report import IndexEntry
    from itree_jax.sensing.scene_folder import Scene


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
    picks: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Read the highest regions first, and no more once N poses are sure: enough for a robot that takes one part at a
    time. Otherwise every region is read."""
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
            scene, fitting, found = answer(folder, prepared, forests, self.quiet, self.depth, lights, self.picks)
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
            "options": [
                self.depth, self.picks, self.self_calibrate, self.report is not None, self.world is not None
            ],
        }

    @property
    def lights_file(self) -> Path:
        return self.output.with_name(f"{self.output.stem}.lights.json")

    def _check(self) -> None:
        if not self.trees:
            raise ItreeError("no TREE is given; make one with `itree compile MODEL --sensor SENSOR -o TREE`")
        check_picks(self.picks)
        check_file(self.output)
        check_file(self.json)
        check_file(self.lights_file if self.self_calibrate else None)
        check_file(self.grasps)
        check_grasp_options(self.gripper, self.hand_eye, self.grasps)
        check_folder(self.report)
        check_folder(self.world)


def say_lights(lights: "dict[str, SelfCalibration]") -> None:
    """How the lights were corrected, a line per scene."""
    from itree_jax.refinement.light_corrections import corrections_in_words

    for name, correction in lights.items():
        say(f"lights by scene {name}: {corrections_in_words(correction)}", quiet=False)


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
