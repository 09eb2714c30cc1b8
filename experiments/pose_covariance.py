"""Whether poses are off by what they state: refines true poses on simulated bins, and normalises the errors.

    python experiments/pose_covariance.py DATASET [--scenes N] [--depth file stereo none] [--parts NAME ...]

DATASET is what `validation_bins.py` writes. Every part that is visible by half is refined from its true pose with the
last stage of recognition. Its error e (a twist) and the stated covariance C give e^T C^-1 e over the directions that
are not called unobservable; divided by their number it is 1 on average if the covariance is right: its median is then
0.9, its 90 % quantile 1.8. "Stated / true" is the factor by which deviations are too large (the root of 0.9 / median).
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from forest_parts import PART_NAMES, forest_part
from itree_cad.part import Part
from itree_cad.symmetry import Symmetries, symmetries
from itree_kernels.mesh import ray_mesh
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from validation_bins import CYCLE

from itree_jax.evaluation.truth import SceneTruth, load_truth
from itree_jax.refinement.bending import smooth_surface
from itree_jax.refinement.optimise import Hypotheses, RefineModel, padded_normals, padded_surface, refine
from itree_jax.refinement.pose_information import equations_at
from itree_jax.refinement.uncertainty import LOST, rim_motions, rim_uncertainty, without_free_turns
from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.scene_folder import load_scene
from itree_jax.sight import Sight, look
from itree_jax.stereo.second_file import load_second
from itree_jax.tree.appearances import mesh_reach

VISIBLE = 0.5
SPACING = np.radians(12.0)  # of the dome, about; the last stage's first gates follow it


@dataclass(frozen=True)
class Config:
    dataset: Path
    parts: tuple[str, ...] = PART_NAMES[:5]
    scenes: int = 1  # of each part and level
    depth: tuple[str, ...] = ("file",)


@dataclass(frozen=True)
class Errors:
    """Of one refined instance."""

    squared: float  # e^T H e over the number of observable directions
    observable: int
    rotation: float  # [rad]
    rotation_stated: float  # root of the trace of the covariance over observable directions
    position: float  # [mm] of the part's middle
    position_stated: float
    rim: float  # [diameters]


def main(config: Config) -> None:
    """Prints a table for each source of depth."""
    truths = {truth.scene_id: truth for truth in load_truth(config.dataset)}
    for source in config.depth:
        rows: dict[str, list[Errors]] = {}
        for name in config.parts:
            part = forest_part(name)
            model, known = model_of(part), symmetries(part)
            for level, truth in chosen(truths, 1 + PART_NAMES.index(name), config.scenes):
                found = errors_in(config.dataset / "test" / f"{truth.scene_id:06d}", truth, source, part, model, known)
                for key in (f"level {level}", f"part {name}", f"part {name}, level {level}"):
                    rows.setdefault(key, []).extend(found)
        print(f"\ndepth {source}\n\n{as_table(rows)}", flush=True)


def chosen(truths: dict[int, SceneTruth], obj_id: int, each: int) -> Iterator[tuple[str, SceneTruth]]:
    """The first scenes of a part, so many of each level."""
    left = dict.fromkeys("ABC", each)
    for scene_id in sorted(truths):
        level = CYCLE[(scene_id % 100 - 1) % len(CYCLE)][0]
        if scene_id // 100 == obj_id and left[level]:
            left[level] -= 1
            yield level, truths[scene_id]


def model_of(part: Part) -> RefineModel:
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle)
    surface = padded_surface(smooth_surface(mesh))
    return RefineModel(mesh, padded_normals(mesh.triangle_normals), mesh_reach(mesh), part.diameter, surface)


def seen(folder: Path, source: str) -> Sight:
    scene = load_scene(folder)
    scene = replace(scene, sensor=replace(scene.sensor, noise=bundled_sensor("bench").noise))
    if source == "file":
        return look(scene.images, scene.sensor, scene.depth, scene.R_w2c)
    second = load_second(replace(scene, depth=None), scene.sensor) if source == "stereo" else None
    return look(scene.images, scene.sensor, None, scene.R_w2c, second)


def errors_in(
    folder: Path, truth: SceneTruth, source: str, part: Part, model: RefineModel, known: Symmetries
) -> list[Errors]:
    """Of the instances that are visible enough."""
    sight = seen(folder, source)
    plan = sight.plan(part.diameter, SPACING)
    shown = truth.visible >= VISIBLE
    if not shown.any():
        return []
    true = Hypotheses(truth.pose.R[shown].astype(np.float32), truth.pose.t[shown].astype(np.float32))
    last = plan.rounds[-1].stage
    told = (sight.sensor.camera, plan.deviations)
    poses = refine(true, model, sight.observed, *told, [last], plan.jump, sight.others, sight.crease)
    equations = equations_at(poses, model, sight.observed, *told, last, plan.jump, sight.others, sight.crease)
    return [
        error_of(part, known, R, t, R_true, t_true, np.asarray(H, float), np.asarray(B, float))
        for R, t, R_true, t_true, H, B in zip(
            *(np.asarray(a, float) for a in poses), truth.pose.R[shown], truth.pose.t[shown], equations.information,
            equations.spread, strict=True,
        )
    ]  # fmt: skip


def error_of(
    part: Part, known: Symmetries, R: np.ndarray, t: np.ndarray, R_true: np.ndarray, t_true: np.ndarray, H: np.ndarray,
    B: np.ndarray,
) -> Errors:
    rim = rim_motions(part.vertices, part.diameter, R)
    H, B = (without_free_turns(a, known.continuous, R) for a in (H, B))
    found = rim_uncertainty(H, B, rim)
    vectors = found.vectors[:, ~found.lost]
    covariance = vectors.T @ found.covariance @ vectors
    error = np.concatenate([Rotation.from_matrix(R_true @ R.T).as_rotvec(), t_true - t])
    along = vectors.T @ rim.from_twist @ error
    motion = vectors @ along
    stated = np.diag(vectors @ covariance @ vectors.T)
    to_turn = 2.0 / part.diameter
    return Errors(
        float(along @ np.linalg.solve(covariance, along)) / max(1, len(along)), len(along),
        float(np.linalg.norm(motion[:3])) * to_turn, float(np.sqrt(stated[:3].sum())) * to_turn,
        float(np.linalg.norm(motion[3:])), float(np.sqrt(stated[3:].sum())),
        float(np.linalg.norm(motion)) / part.diameter,
    )  # fmt: skip


def as_table(rows: dict[str, list[Errors]]) -> str:
    head = ("", "poses", "left", "median", "90 %", "stated / true", "rotation: error, stated [deg]",
            "position: error, stated [mm]", "directions")  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for key in sorted(rows):
        there = [e for e in rows[key] if e.rim < LOST and e.observable]
        if not there:
            continue
        get: Any = lambda name, there=there: np.array([getattr(e, name) for e in there])  # noqa: E731
        median, most = np.quantile(get("squared"), [0.5, 0.9])
        usual = chi2.median(6) / 6
        turn, said = np.degrees(np.median(get("rotation"))), np.degrees(np.median(get("rotation_stated")))
        shift, stated = np.median(get("position")), np.median(get("position_stated"))
        lines.append(
            f"| {key} | {len(there)} | {len(rows[key]) - len(there)} | {median:.2f} | {most:.2f} | "
            f"{np.sqrt(usual / median):.2f} | {turn:.3f}, {said:.3f} | {shift:.3f}, {stated:.3f} | "
            f"{np.mean(get('observable')):.2f} |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--parts", nargs="+", choices=PART_NAMES, default=Config.parts)
    parser.add_argument("--scenes", type=int, default=Config.scenes)
    parser.add_argument("--depth", nargs="+", choices=("file", "stereo", "none"), default=Config.depth)
    given: dict[str, Any] = vars(parser.parse_args())
    given |= {name: tuple(given[name]) for name in ("parts", "depth")}
    main(Config(**given))
