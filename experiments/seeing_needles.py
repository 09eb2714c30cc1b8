"""Needle maps against truth: angular error within parts, per level and lights, by three readings of the images.

    python experiments/seeing_needles.py [--dataset DATASET] [--out DIR]

Least squares takes every light to reach every pixel; robust is `photometric_stereo`; with response is the needle map as
`recognize` reads it when there is a depth map, to which the material's response is fitted. Truth: the models at their
true poses, on the pixels where the data set shows that part. Errors are those of the pixels that are answered, all
scenes of a group together.

The predicted error is what the needle map says of itself, noise and what a face shares together: of an angle in two
directions whose rms is r, the median is r sqrt(ln 2).

The data set defaults to `scenes` in the folder that ITREE_DATA names. It is reported, nothing is chosen by it.
"""

import json
import os
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import trimesh
import tyro
from itree_kernels.instances import Material
from itree_kernels.lit_scene import render_scene
from itree_kernels.mesh import ray_mesh

from itree_jax.evaluation.truth import load_truth
from itree_jax.sensing.near_lights import lights_of
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.photometric import least_squares, needle_map
from itree_jax.sensing.reading import read_needles, response_of_depth
from itree_jax.sensing.scene_folder import Scene, load_scene

MEDIAN_OF_RMS = float(np.sqrt(np.log(2.0)))  # of the length of a Gaussian vector of two components
FAR_OFF = 10.0  # [deg]
READINGS = ("least squares", "robust", "with response")


@dataclass(frozen=True)
class Config:
    dataset: Path = Path(os.environ.get("ITREE_DATA", Path(__file__).parents[2] / "shared" / "data")) / "scenes"
    out: Path = Path("out/seeing_needles")


def main(config: Config) -> None:
    """Writes `report.json` and `table.md` into `config.out`, and prints the table."""
    errors: dict[tuple[str, str], list[np.ndarray]] = defaultdict(list)
    kept: dict[str, list[bool]] = defaultdict(list)
    for group, scene, normals, part in scenes_with_truth(config.dataset):
        maps, helped = readings(scene)
        kept[group].append(helped)
        for name, needle in maps.items():
            errors[group, name].append(angles(needle, normals, part))
    report = {
        "config": {k: str(v) for k, v in asdict(config).items()},
        "kept": {group: [sum(some), len(some)] for group, some in sorted(kept.items())},
        "errors": {f"{group} | {name}": summed(rows) for (group, name), rows in sorted(errors.items())},
    }
    config.out.mkdir(parents=True, exist_ok=True)
    (config.out / "report.json").write_text(json.dumps(report, indent=1) + "\n")
    text = as_markdown(report)
    (config.out / "table.md").write_text(text)
    print(text)


def scenes_with_truth(dataset: Path) -> Iterator[tuple[str, Scene, np.ndarray, np.ndarray]]:
    """Group, scene, true normals [h, w, 3] and where parts show them [h, w]."""
    records = json.loads((dataset / "scenes.json").read_text())
    for truth in load_truth(dataset):
        folder = dataset / "test" / f"{truth.scene_id:06d}"
        scene, record = load_scene(folder), records[folder.name]
        ids = cv2.imread(str(folder / "ids" / "000000.png"), cv2.IMREAD_UNCHANGED).astype(int)
        numbers = np.unique(truth.obj_id)
        models = [trimesh.load_mesh(dataset / "models" / f"obj_{n:06d}.ply", process=False) for n in numbers]
        meshes = [ray_mesh(m.vertices, m.faces, np.zeros(len(m.faces), np.int32)) for m in models]
        camera, straight_on = scene.sensor.camera, np.array([[0.0, 0.0, -1.0]])
        which = np.searchsorted(numbers, truth.obj_id)
        pose = truth.pose
        shown = render_scene(meshes, which, pose.R, pose.t, camera, straight_on, np.ones(1), Material())
        part = (ids > 0) & (shown.instance == ids - 1)
        yield f"{record['level']}, {record['lights']} lights", scene, shown.normal.astype(float), part


def readings(scene: Scene) -> tuple[dict[str, NeedleMap], bool]:
    """The needle maps by their names, and whether a response was kept."""
    images, sensor = scene.images, scene.sensor
    assert scene.depth is not None
    response = response_of_depth(on_host(needle_map(images, sensor)), scene.depth, sensor)
    maps = (
        on_host(least_squares(images, *lights_of(sensor), sensor.noise)), on_host(needle_map(images, sensor)),
        read_needles(images, sensor, scene.depth),
    )  # fmt: skip
    return dict(zip(READINGS, maps, strict=True)), not response.is_lambertian


def on_host(needle: NeedleMap) -> NeedleMap:
    return NeedleMap(*(np.asarray(a) for a in needle))


def angles(needle: NeedleMap, normals: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Error and predicted rms error [deg] of each of the parts' pixels, NaN where no needle is believed."""
    chord = np.linalg.norm(needle.normals - normals, axis=-1)
    error = 2.0 * np.arcsin(np.clip(0.5 * chord, 0.0, 1.0))
    predicted = np.hypot(needle.normal_std, needle.normal_bias)
    both = np.where(needle.interpretable[..., None], np.stack([error, predicted], axis=-1), np.nan)
    return np.degrees(both[part])


def summed(rows: list[np.ndarray]) -> dict[str, float]:
    every = np.concatenate(rows)
    answered = every[np.isfinite(every[:, 0])]
    error, predicted = answered.T
    return {
        "scenes": len(rows),
        "pixels": len(every),
        "answered": len(answered) / len(every),
        "median_deg": float(np.median(error)),
        "p90_deg": float(np.percentile(error, 90.0)),
        "far_off": float((error > FAR_OFF).mean()),
        "predicted_median_deg": MEDIAN_OF_RMS * float(np.median(predicted)),
    }


def as_markdown(report: dict[str, Any]) -> str:
    lines = ["| level | reading | median | 90 % | over 10 deg | answered | predicted median | response kept |"]
    lines.append("|---|---|---|---|---|---|---|---|")
    for key, row in sorted(report["errors"].items(), key=lambda item: _order(item[0])):
        group, name = key.split(" | ")
        kept, scenes = report["kept"][group]
        lines.append(
            f"| {group} | {name} | {row['median_deg']:.2f} deg | {row['p90_deg']:.1f} deg "
            f"| {100 * row['far_off']:.1f} % | {100 * row['answered']:.1f} % | {row['predicted_median_deg']:.2f} deg "
            f"| {f'{kept} of {scenes}' if name == READINGS[-1] else ''} |"
        )
    return "\n".join(lines) + "\n"


def _order(key: str) -> tuple[str, int]:
    group, name = key.split(" | ")
    return group, READINGS.index(name)


if __name__ == "__main__":
    main(tyro.cli(Config))
