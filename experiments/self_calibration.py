"""How much of a calibration error of the lights vanishes when they are refined with the poses of recognised parts.

    python experiments/self_calibration.py [--bins N] [--parts N] [--looks NAME ...] [--data DATASET] [--out DIR]

Simulated bins (extra `sim`) with the sensor's noise: every light told 1 degree and 2 % off. The parts' poses are true
ones, moved by 2 degrees and 1 mm and refined under the wrong lights as recognition does it; the most visible ones are
used. `--data` does the same on the scenes of a dataset that another renderer made (two interreflections, gloss), whose
lights are told rightly, or wrongly with the true ones in `scene_record.json`.
"""

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from itree_cad.bundled import bundled_part
from itree_cad.load import load_part
from itree_cad.part import Part
from itree_cad.symmetry import symmetries
from scipy.spatial.transform import Rotation

from itree_jax.refinement.lit_pixels import PlacedPart
from itree_jax.refinement.observed import observe
from itree_jax.refinement.optimise import Hypotheses, RefineModel, padded_normals, refine
from itree_jax.refinement.schedule import schedule
from itree_jax.refinement.self_calibration import SelfCalibration, self_calibrate
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.photometric import needle_map
from itree_jax.sensing.regions import depth_noise
from itree_jax.sensing.scene_folder import Scene, load_scene, scene_folders
from itree_jax.sensing.sensor_file import load_sensor
from itree_jax.sensor import Sensor
from itree_jax.sight import believed
from itree_jax.simulate import LOOKS
from itree_jax.simulate.bin import bin_for
from itree_jax.simulate.imaging import image_bin
from itree_jax.simulate.settle import settle
from itree_jax.tree.appearances import mesh_reach

DIRECTION_ERROR, INTENSITY_ERROR = float(np.radians(1.0)), 0.02  # of what is told
POSE_ERROR, PLACE_ERROR = float(np.radians(2.0)), 1.0  # [rad], [mm] before refinement
LEAST_VISIBLE = 0.6


@dataclass(frozen=True)
class Config:
    out: Path = Path("out/self_calibration")
    part: str = "ikeuchi-1987"
    sensor: str = "bundled:bench"
    bins: int = 5
    dropped: int = 6
    parts: int = 3  # recognised
    looks: tuple[str, ...] = ("lambert", "reflecting", "plastic", "metal")
    data: Path | None = None
    seed: int = 0


@dataclass(frozen=True)
class Case:
    """A scene with what is true of it."""

    group: str
    name: str
    scene: Scene  # its sensor has the true lights
    told: Sensor
    model: RefineModel
    revolution: tuple
    poses: Hypotheses  # true


def main(config: Config) -> None:
    """Writes `report.json` and `table.md` into `config.out`, and prints the table."""
    config.out.mkdir(parents=True, exist_ok=True)
    cases = simulated(config) if config.data is None else of_dataset(config.data, config)
    rows = []
    for number, case in enumerate(cases):
        rows.append(outcome(case, calibrated(case, config.parts, config.seed + number)))
        print(json.dumps({k: round(v, 3) if isinstance(v, float) else v for k, v in rows[-1].items()}), flush=True)
    report = {"config": {k: str(v) if isinstance(v, Path) else v for k, v in asdict(config).items()}, "rows": rows}
    (config.out / "report.json").write_text(json.dumps(report, indent=1) + "\n")
    (config.out / "table.md").write_text(table(rows))
    print(table(rows))


def simulated(config: Config) -> Iterator[Case]:
    part, sensor = bundled_part(config.part), load_sensor(config.sensor)
    model, revolution = model_of(part)
    bin_ = bin_for(sensor, part.diameter)
    settled = [settle(part, config.dropped, bin_, config.seed + k) for k in range(config.bins)]
    for look in config.looks:
        for k, T_bin_obj in enumerate(settled):
            scene, truth = image_bin(part, T_bin_obj, bin_, sensor, LOOKS[look], seed=config.seed + k)
            seen = [true for true in truth if true.visib_fract > LEAST_VISIBLE]
            seen = sorted(seen, key=lambda true: -true.px_count_visib)[: config.parts]
            poses = Hypotheses(np.stack([s.R_cam_obj for s in seen]), np.stack([s.t_cam_obj for s in seen]))
            told = disturbed(scene.sensor, config.seed + k)
            yield Case(look, f"bin {k}", scene, told, model, revolution, poses)


def of_dataset(folder: Path, config: Config) -> Iterator[Case]:
    """Bins of a dataset; lights that are told rightly are disturbed as in the simulated ones."""
    records = json.loads((folder / "scenes.json").read_text())
    models: dict[int, tuple[RefineModel, tuple]] = {}
    for k, path in enumerate(scene_folders(folder)):
        record = records[path.name]
        if record["kind"] != "bin":
            continue
        scene, told = load_scene(path), None
        own = json.loads((path / "scene_record.json").read_text())
        if "true_lights" in own and record["level"] == "C":
            told = scene.sensor
            L, e = (np.array(own["true_lights"][key]) for key in ("directions", "intensities"))
            scene = replace(scene, sensor=replace(told, light_directions=L, light_intensities=e))
        obj_id = record["obj_id"]
        if obj_id not in models:
            models[obj_id] = model_of(load_part(str(folder / "models" / f"obj_{obj_id:06d}.ply"), "mm"))
        entries = json.loads((path / "scene_gt.json").read_text())["0"]
        shares = json.loads((path / "scene_gt_info.json").read_text())["0"]
        order = sorted(range(len(entries)), key=lambda j: -shares[j]["px_count_visib"])
        chosen = [entries[j] for j in order if shares[j]["visib_fract"] > LEAST_VISIBLE][: config.parts]
        R = np.array([entry["cam_R_m2c"] for entry in chosen]).reshape(-1, 3, 3)
        poses = Hypotheses(R, np.array([entry["cam_t_m2c"] for entry in chosen]))
        told = told or disturbed(scene.sensor, config.seed + k)
        yield Case(f"level {record['level']}", path.name, scene, told, *models[obj_id], poses)


def model_of(part: Part) -> tuple[RefineModel, tuple]:
    from itree_kernels.mesh import ray_mesh

    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle)
    model = RefineModel(mesh, padded_normals(mesh.triangle_normals), mesh_reach(mesh), part.diameter)
    return model, tuple(symmetries(part).continuous)


def disturbed(sensor: Sensor, seed: int) -> Sensor:
    """Every light turned by 1 degree about a random axis across it, and 2 % brighter or darker."""
    rng = np.random.default_rng(seed)
    L = np.asarray(sensor.light_directions, float)
    axis = np.cross(L, rng.normal(size=L.shape))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    turned = Rotation.from_rotvec(DIRECTION_ERROR * axis).apply(L)
    e = np.asarray(sensor.light_intensities) * (1.0 + INTENSITY_ERROR * rng.choice([-1.0, 1.0], len(L)))
    return replace(sensor, light_directions=turned, light_intensities=e)


def calibrated(case: Case, count: int, seed: int) -> SelfCalibration:
    poses = recognised_poses(case, seed)
    parts = [PlacedPart(case.model, R, t, 0, case.revolution) for R, t in zip(*poses, strict=True)]
    return self_calibrate(parts[:count], case.scene.images, case.told, case.scene.depth)


def recognised_poses(case: Case, seed: int) -> Hypotheses:
    """True poses, moved and refined under the lights as told."""
    rng = np.random.default_rng(seed)
    count = len(case.poses.t_cam_obj)
    turn, shift = rng.normal(size=(count, 3)), rng.normal(size=(count, 3))
    turn *= POSE_ERROR / np.linalg.norm(turn, axis=1, keepdims=True)
    shift *= PLACE_ERROR / np.linalg.norm(shift, axis=1, keepdims=True)
    moved = Hypotheses(Rotation.from_rotvec(turn).as_matrix() @ case.poses.R_cam_obj, case.poses.t_cam_obj + shift)
    depth = case.scene.depth
    assert depth is not None
    needle = NeedleMap(*(np.asarray(a) for a in needle_map(case.scene.images, case.told)))
    plan = schedule(case.told, case.model.diameter, depth_noise(depth, depth > 0), spacing=0.1)
    observed = observe(*believed(needle), depth, plan.jump)
    stages = [plan.rounds[-1].stage]
    found = refine(moved, case.model, observed, case.told.camera, plan.deviations, stages, plan.jump)
    return Hypotheses(np.asarray(found.R_cam_obj, float), np.asarray(found.t_cam_obj, float))


def light_errors(sensor: Sensor, true: Sensor) -> tuple[np.ndarray, np.ndarray]:
    """Angles [deg] and relative intensity errors of every light, the scale (which no image tells) taken out."""
    chord = np.linalg.norm(np.asarray(sensor.light_directions) - true.light_directions, axis=1)
    ratio = np.asarray(sensor.light_intensities) / true.light_intensities
    return np.degrees(2 * np.arcsin(chord / 2)), ratio / ratio.mean() - 1.0


def outcome(case: Case, found: SelfCalibration) -> dict[str, Any]:
    true = case.scene.sensor
    told_angle, told_ratio = light_errors(case.told, true)
    fitted = replace(case.told, light_directions=found.light_directions, light_intensities=found.light_intensities)
    angle, ratio = light_errors(fitted, true)
    pairs = zip(case.poses.R_cam_obj, found.parts, strict=True)
    turned = [Rotation.from_matrix(R.T @ part.R_cam_obj).magnitude() for R, part in pairs]
    return {
        "group": case.group, "scene": case.name, "parts": len(found.parts), "kept": found.kept,
        "angle_told_deg": rms(told_angle), "angle_deg": rms(angle),
        "intensity_told_percent": 100 * rms(told_ratio), "intensity_percent": 100 * rms(ratio),
        "angle_std_deg": float(np.degrees(rms(found.direction_std))),
        "intensity_std_percent": 100 * rms(found.intensity_std),
        "loss_before": found.residual_before, "loss_after": found.residual_after, "pixels": found.pixels,
        "patch_bias": found.patch_bias, "reflected": found.reflected,
        "pose_error_deg": float(np.degrees(np.median(turned))), "unobserved": list(found.unobserved),
    }  # fmt: skip


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def table(rows: Sequence[dict[str, Any]]) -> str:
    """One line per group: rms over its scenes, and the worst scene."""
    head = "| | scenes | told | left | worst | predicted | told | left | worst | predicted | kept |"
    lines = [head, "|---" * 11 + "|"]
    for group in dict.fromkeys(row["group"] for row in rows):
        some = [row for row in rows if row["group"] == group]

        def of(key: str, some: list = some) -> np.ndarray:
            return np.array([row[key] for row in some])

        cells = [f"{group} | {len(some)}"]
        for key, unit, digits in (("angle", "deg", 2), ("intensity", "percent", 2)):
            told, left, std = (of(f"{key}{k}_{unit}") for k in ("_told", "", "_std"))
            name = "deg" if unit == "deg" else "%"
            cells.append(" | ".join(f"{v:.{digits}f} {name}" for v in (rms(told), rms(left), left.max(), rms(std))))
        cells.append(f"{sum(of('kept'))}/{len(some)}")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Config.out)
    parser.add_argument("--bins", type=int, default=Config.bins)
    parser.add_argument("--parts", type=int, default=Config.parts)
    parser.add_argument("--looks", nargs="+", choices=sorted(LOOKS), default=Config.looks)
    parser.add_argument("--data", type=Path, default=None)
    parser.add_argument("--seed", type=int, default=Config.seed)
    given = vars(parser.parse_args())
    main(replace(Config(), **given | {"looks": tuple(given["looks"])}))
