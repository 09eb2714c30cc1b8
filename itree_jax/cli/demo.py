"""`itree demo`: the whole way once, on the paper's part in a bin whose settled poses come with the package."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from itree_jax.cli.outputs import check_folder, staged_folder
from itree_jax.cli.runtime import start_jax
from itree_jax.cli.terminal import output, part_of, progress, say

if TYPE_CHECKING:
    from itree_cad.part import Part
    from rich.table import Table

    from itree_jax.detections import Detections
    from itree_jax.sensing.scene_writer import TrueObject

SENSOR = "bench"
SEED = 0
RIGHT = 0.05  # of the diameter, by MSSD: as `itree evaluate` counts
WORTH_FINDING = 0.7  # visible share of a part that should be found: as `itree evaluate` counts
PAGE = "index.html"


@dataclass(frozen=True)
class Demo:
    """Compile the paper's part, image a bin of eight of them, recognise, and write one page."""

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="DIR")] = Path("itree-demo")
    """Folder for the page, the tree, the scene and the results."""
    quiet: bool = False
    """Show nothing but warnings and errors."""

    def run(self) -> None:
        """Raises ItreeError when the folder cannot be written."""
        check_folder(self.output)
        start = time.perf_counter()
        with progress(self.quiet) as tell, staged_folder(self.output) as stage:
            tell("loading", 0.0)
            start_jax()
            from itree_cad.bundled import bundled_part

            from itree_jax.cli.scene_answer import recognize_scene
            from itree_jax.compile import compile_tree
            from itree_jax.prepared import prepare
            from itree_jax.sensing.bundled import bundled_sensor
            from itree_jax.simulate import bundled_poses, demo_bin

            sensor = bundled_sensor(SENSOR)
            part = bundled_part(bundled_poses().part)
            tree = compile_tree(part, sensor, report=part_of(tell, 0.0, 0.6))
            tell("imaging the bin", 0.6)
            scene, truth = demo_bin(sensor, SEED)
            tell("recognising", 0.7)
            found = recognize_scene(scene, [prepare(tree)])
            tell("writing", 0.95)
            write_outputs(stage, tree, scene, truth, found)
        if not self.quiet:
            output().print(comparison(part, found, truth))
        where = (self.output / PAGE).absolute()
        say(f"{time.perf_counter() - start:.0f} s. The page is {where.as_uri()}", self.quiet)


def write_outputs(folder: Path, tree, scene, truth: "Sequence[TrueObject]", found: "Detections") -> None:
    """Page, tree, scene and results. `itree recognize DIR/scene DIR/*.tree -o results.csv` recognises again."""
    from itree_jax.report import write_scene_report, write_tree_page
    from itree_jax.results import write_bop_csv, write_json
    from itree_jax.sensing.scene_writer import write_scene
    from itree_jax.tree.tree_file import save_tree

    save_tree(tree, folder / f"{tree.part.name}.tree")
    write_scene(folder / "scene" / f"{scene.scene_id:06d}", scene, truth)
    write_bop_csv([found], folder / "results.csv")
    write_json([found], folder / "results.json")
    write_tree_page(folder / "tree.html", tree)
    poses = [(o.obj_id, o.R_cam_obj, o.t_cam_obj, o.visib_fract) for o in truth]
    write_scene_report(folder / PAGE, scene, found, [tree], poses)


def comparison(part: "Part", found: "Detections", truth: "Sequence[TrueObject]") -> "Table":
    """The answers in the order for picking, each with its distance from the true pose it matches."""
    import numpy as np
    from rich.table import Table

    from itree_jax.evaluation import Pose, match, symmetry_set
    from itree_jax.evaluation.pose_errors import pose_errors
    from itree_jax.simulate.dataset import model_info

    poses = found.poses
    true = Pose(np.stack([o.R_cam_obj for o in truth])[None], np.stack([o.t_cam_obj for o in truth])[None])
    symmetry = symmetry_set(model_info(part))

    def errors_of(R, t):
        return pose_errors(Pose(R[:, None], t[:, None]), true, np.asarray(part.vertices), symmetry)

    errors = errors_of(poses.R, poses.t)
    instance = match(errors.mssd, poses.score, RIGHT * part.diameter)
    heads = ("pick", "score", "x y z, mm", "truth", "surface, mm", "rotation, deg", "position, mm")
    worth = [k for k, o in enumerate(truth) if o.visib_fract >= WORTH_FINDING]
    counted = f"{len(set(worth) & set(instance.tolist()))} of {len(worth)} parts visible by {100 * WORTH_FINDING:.0f} %"
    other_right = [
        k for k, d in enumerate(found)
        if instance[k] < 0 and d.ambiguous
        and errors_of(*split(np.stack([a.T_cam_obj for a in d.alternatives]))).mssd.min() < RIGHT * part.diameter
    ]  # fmt: skip
    wrong = int((instance < 0).sum()) - len(other_right)
    title = f"{counted} found, {wrong} of {len(found)} answers wrong"
    if other_right:
        title += f", {len(other_right)} ambiguous (the scene does not tell two poses apart, the other one is right)"
    table = Table(*heads, title=title)
    for k, d in sorted(enumerate(found), key=lambda item: item[1].offer_rank):
        row = (str(d.offer_rank + 1), f"{d.score:.2f}", " ".join(f"{x:.1f}" for x in d.t_cam_obj))
        j = int(instance[k])
        if j < 0:
            verdict = "ambiguous" if k in other_right else "wrong"
            table.add_row(*row, verdict, f"{errors.mssd[k].min():.1f}", "", "")
        else:
            off = (errors.mssd[k, j], np.degrees(errors.rotation[k, j]), errors.translation[k, j])
            table.add_row(*row, f"part {j}", *(f"{value:.2f}" for value in off))
    return table


def split(T_cam_obj):
    """Rotations and translations [mm] of 4 x 4 matrices."""
    return T_cam_obj[:, :3, :3], T_cam_obj[:, :3, 3]
