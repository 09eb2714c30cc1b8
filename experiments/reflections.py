"""What light between the parts costs, and what is left of it once it is predicted from their poses and subtracted.

    python experiments/reflections.py [--dataset DATASET] [--out DIR] [--scenes NUMBER ...] [--levels A B C]
                                      [--ways stereo depth]

Needles against truth within the parts' pixels, and poses against truth, by two ways of seeing: two cameras, and a depth
map. Each is read as it is, and again without reflected light; this is predicted from the true poses (the upper bound),
from those of the parts that are visible by half, and from these same parts' poses as refined on the first reading.
Poses start at the truth and go through the last round of refinement, so that their errors are those of what is seen.
The material's response is fitted as recognition does it: to the depth map, or to poses as refined on the first reading.

Made for the simulated bins of `validation_bins.py`. A scene that is measured already is not measured again.
"""

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import trimesh
from itree_kernels.instances import Material
from itree_kernels.lit_scene import render_scene
from itree_kernels.mesh import RayMesh, ray_mesh

from itree_jax.evaluation.pose_errors import Pose, pose_errors
from itree_jax.evaluation.truth import Model, load_models
from itree_jax.recognised_reflections import subtract_reflections
from itree_jax.recognised_response import responses_of_parts
from itree_jax.refinement.optimise import Hypotheses, RefineModel, padded_normals, refine
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.scene_folder import Scene, load_scene
from itree_jax.sight import Sight, look
from itree_jax.stereo.second_camera import SecondCamera
from itree_jax.stereo.second_file import load_second

LEAST_VISIBLE = 0.5  # what recognition finds, roughly
HIDDEN = 3.0  # [mm]: where the depth map is so far off the parts, the bin's wall hides them
FAR_OFF = 10.0  # [deg]
SPACING = np.radians(13.0)  # of the appearances' viewer directions, as a tree has it
WAYS = ("stereo", "depth")
READINGS = ("as read", "true poses", "true poses, visible", "refined poses")


@dataclass(frozen=True)
class Config:
    dataset: Path = Path("out/validation_bins")
    out: Path = Path("out/reflections")
    scenes: tuple[int, ...] = ()  # none: all
    levels: tuple[str, ...] = ("B", "C")
    ways: tuple[str, ...] = WAYS


@dataclass(frozen=True)
class Case:
    """A scene with what is true of it."""

    group: str
    scene: Scene
    second: SecondCamera
    mesh: RayMesh
    model: Model
    poses: Hypotheses
    visible: np.ndarray  # [parts] bool
    normals: np.ndarray  # [h, w, 3]
    part: np.ndarray  # [h, w] bool


def main(config: Config) -> None:
    """Writes a file per scene and way, and `table.md` into `config.out`, and prints the tables."""
    config.out.mkdir(parents=True, exist_ok=True)
    records = json.loads((config.dataset / "scenes.json").read_text())
    models, rows = load_models(config.dataset), []
    for name, record in records.items():
        if record["level"] not in config.levels or (config.scenes and int(name) not in config.scenes):
            continue
        for way in config.ways:
            path = config.out / f"{name}_{way}.json"
            if not path.is_file():
                path.write_text(json.dumps(measured(case_of(config.dataset, name, record, models), way)) + "\n")
            rows.append(json.loads(path.read_text()))
    text = needle_table(rows) + "\n" + pose_table(rows)
    (config.out / "table.md").write_text(text)
    print(text)


def case_of(dataset: Path, name: str, record: dict[str, Any], models: dict[int, Model]) -> Case:
    folder, obj_id = dataset / "test" / name, record["obj_id"]
    scene = load_scene(folder)
    second = load_second(scene)
    assert second is not None
    entries, shares = (json.loads((folder / f"scene_{what}.json").read_text())["0"] for what in ("gt", "gt_info"))
    R = np.array([e["cam_R_m2c"] for e in entries], float).reshape(-1, 3, 3)
    t = np.array([e["cam_t_m2c"] for e in entries], float)
    loaded = trimesh.load_mesh(dataset / "models" / f"obj_{obj_id:06d}.ply", process=False)
    mesh = ray_mesh(loaded.vertices, loaded.faces, np.zeros(len(loaded.faces), np.int32))
    straight_on = np.array([[0.0, 0.0, -1.0]])
    shown = render_scene([mesh], [0] * len(R), R, t, scene.sensor.camera, straight_on, np.ones(1), Material())
    part = (shown.instance >= 0) & (np.abs(shown.depth - scene.depth) < HIDDEN)
    visible = np.array([share["visib_fract"] >= LEAST_VISIBLE for share in shares])
    group = f"{record['level']}, {record['lights']} lights"
    return Case(group, scene, second, mesh, models[obj_id], Hypotheses(R, t), visible, shown.normal, part)


def measured(case: Case, way: str) -> dict[str, Any]:
    """Needle and pose errors of one scene seen one way, by reading."""
    needles, poses = {}, {}
    for reading, sight, refined in readings(case, way):
        needles[reading] = needle_errors(case, sight.needle)
        poses[reading] = [e.tolist() for e in errors_of(case, refined)]
    return {"group": case.group, "way": way, "needles": needles, "poses": poses}


def readings(case: Case, way: str) -> Iterator[tuple[str, Sight, Hypotheses]]:
    """Each reading with what it shows and how it refines the visible parts' poses."""
    model, scene = refine_model(case), case.scene
    seen = Hypotheses(*(a[case.visible] for a in case.poses))
    depth, second = (scene.depth, None) if way == "depth" else (None, case.second)
    first = look(scene.images, scene.sensor, depth, scene.R_w2c, second)
    refined = refined_from(seen, model, first)
    for reading, known in zip(READINGS, (None, case.poses, seen, refined), strict=True):
        images, other = scene.images, second
        if known is not None:
            without = subtract_reflections(images, answers_of(case, known), first, second)
            images, other = (images, second) if without is None else without
        sight = first if known is None else look(images, scene.sensor, depth, scene.R_w2c, other)
        responses = responses_of_parts(answers_of(case, refined), sight) if depth is None else None
        if responses is not None:
            sight = look(images, scene.sensor, depth, scene.R_w2c, other, responses)
        yield reading, sight, refined_from(seen, model, sight)


def answers_of(case: Case, poses: Hypotheses) -> list[Any]:
    """As recognition would answer."""
    count = len(poses.t_cam_obj)
    return [
        SimpleNamespace(
            selection=SimpleNamespace(accepted=np.arange(count), score=np.ones(count)),
            hypotheses=SimpleNamespace(poses=poses), prepared=SimpleNamespace(model=SimpleNamespace(mesh=case.mesh)),
        )
    ]  # fmt: skip


def refine_model(case: Case) -> RefineModel:
    reach = float(np.linalg.norm(case.mesh.vertices, axis=1).max())
    return RefineModel(case.mesh, padded_normals(case.mesh.triangle_normals), reach, case.model.diameter)


def refined_from(start: Hypotheses, model: RefineModel, sight: Sight) -> Hypotheses:
    plan = sight.plan(model.diameter, SPACING)
    stage = plan.rounds[-1].stage
    return refine(
        start, model, sight.observed, sight.sensor.camera, plan.deviations, [stage], plan.jump, sight.others,
        sight.crease,
    )


def needle_errors(case: Case, needle: NeedleMap) -> dict[str, Any]:
    """Histogram of the angle to the true normal in hundredths of a degree, and the number of the parts' pixels."""
    answered = np.asarray(needle.interpretable) & case.part
    chord = np.linalg.norm(np.asarray(needle.normals)[answered] - case.normals[answered], axis=-1)
    angle = np.degrees(2.0 * np.arcsin(np.clip(0.5 * chord, 0.0, 1.0)))
    values, counts = np.unique(np.round(100.0 * angle).astype(int), return_counts=True)
    return {"angle": values.tolist(), "count": counts.tolist(), "pixels": int(case.part.sum())}


def errors_of(case: Case, poses: Hypotheses) -> tuple[np.ndarray, np.ndarray]:
    """Rotation [deg] and translation [mm] errors of the visible parts."""
    truth = Pose(case.poses.R_cam_obj[case.visible], case.poses.t_cam_obj[case.visible])
    estimate = Pose(np.asarray(poses.R_cam_obj, float), np.asarray(poses.t_cam_obj, float))
    found = pose_errors(estimate, truth, case.model.hull, case.model.symmetries)
    return np.degrees(found.rotation), found.translation


def needle_table(rows: Sequence[dict[str, Any]]) -> str:
    lines = ["| level | way | reflected light from | median | 90 % | over 10 deg | answered |", "|---" * 7 + "|"]
    for group, way, reading, some in cells(rows):
        found = [row["needles"][reading] for row in some]
        angle = np.concatenate([np.repeat(f["angle"], f["count"]) for f in found]) / 100.0
        lines.append(
            f"| {group} ({len(some)} scenes) | {way} | {reading} | {np.median(angle):.2f} deg "
            f"| {np.percentile(angle, 90.0):.1f} deg | {100.0 * (angle > FAR_OFF).mean():.1f} % "
            f"| {100.0 * len(angle) / sum(f['pixels'] for f in found):.1f} % |"
        )
    return "\n".join(lines) + "\n"


def pose_table(rows: Sequence[dict[str, Any]]) -> str:
    lines = ["| level | way | reflected light from | rotation | 90 % | position | 90 % | nearer than as read |"]
    lines.append("|---" * 8 + "|")
    for group, way, reading, some in cells(rows):
        turned, moved = (np.concatenate([row["poses"][reading][k] for row in some]) for k in (0, 1))
        before = np.concatenate([row["poses"][READINGS[0]][0] for row in some])
        lines.append(
            f"| {group} ({len(turned)} parts) | {way} | {reading} | {np.median(turned):.3f} deg "
            f"| {np.percentile(turned, 90.0):.2f} deg | {np.median(moved):.3f} mm "
            f"| {np.percentile(moved, 90.0):.2f} mm "
            f"| {'' if reading == READINGS[0] else f'{100.0 * (turned < before).mean():.0f} %'} |"
        )
    return "\n".join(lines) + "\n"


def cells(rows: Sequence[dict[str, Any]]) -> Iterator[tuple[str, str, str, list[dict[str, Any]]]]:
    keys = {(row["group"], row["way"]) for row in rows}
    for group, way in sorted(keys, key=lambda key: (key[0], WAYS.index(key[1]))):
        for reading in READINGS:
            yield group, way, reading, [row for row in rows if (row["group"], row["way"]) == (group, way)]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dataset", type=Path, default=Config.dataset)
    parser.add_argument("--out", type=Path, default=Config.out)
    parser.add_argument("--scenes", type=int, nargs="+", default=Config.scenes)
    parser.add_argument("--levels", nargs="+", choices=["A", "B", "C"], default=Config.levels)
    parser.add_argument("--ways", nargs="+", choices=WAYS, default=Config.ways)
    given = vars(parser.parse_args())
    main(replace(Config(), **given))
