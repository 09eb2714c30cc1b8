"""Dual photometric stereo against truth: depth error within parts, per level, beside block matching alone.

    python experiments/dual_stereo.py [--dataset DATASET] [--out DIR]

Matched pieces are the pixels whose needles lie on a piece that was placed along its epipolar line (`by_needles`); the
others are those that windows alone tell. Block matching: OpenCV's, as dual photometric stereo starts from. Shares
within some millimetres are of the pixels that are answered, shares answered are of all of the parts' pixels.

The data set defaults to `scenes` in the folder that ITREE_DATA names. It is reported, nothing is chosen by it.
"""

import json
import os
import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tyro

from itree_jax.sensing.scene_folder import Scene, load_scene
from itree_jax.stereo.dual_stereo import block_matching, dual_photometric_stereo, searched
from itree_jax.stereo.second_camera import SecondCamera, epipolar_pair, to_first_camera
from itree_jax.stereo.second_file import load_second

WITHIN = (0.5, 1.0, 2.0, 5.0)  # [mm]
WAYS = ("matched pieces", "other pixels", "together", "block matching alone")


@dataclass(frozen=True)
class Config:
    dataset: Path = Path(os.environ.get("ITREE_DATA", Path(__file__).parents[2] / "shared" / "data")) / "scenes"
    out: Path = Path("out/dual_stereo")


def main(config: Config) -> None:
    """Writes `report.json` and `table.md` into `config.out`, and prints the tables."""
    errors: dict[tuple[str, str], list[np.ndarray]] = defaultdict(list)
    seconds: list[tuple[float, float]] = []
    for level, scene, second, truth, part in scenes_with_truth(config.dataset):
        maps, took = depth_maps(scene, second)
        seconds.append(took)
        for name, depth in maps.items():
            errors[level, name].append(np.where(depth > 0.0, depth - truth, np.nan)[part])
    report = {
        "config": {k: str(v) for k, v in asdict(config).items()},
        "errors": {f"{level} | {name}": summed(rows) for (level, name), rows in sorted(errors.items())},
        # the first scene compiles
        "seconds": dict(zip(("dual photometric stereo", "block matching"), np.median(seconds, axis=0), strict=True)),
    }
    config.out.mkdir(parents=True, exist_ok=True)
    (config.out / "report.json").write_text(json.dumps(report, indent=1) + "\n")
    text = as_markdown(report)
    (config.out / "table.md").write_text(text)
    print(text)


def scenes_with_truth(dataset: Path) -> Iterator[tuple[str, Scene, SecondCamera, np.ndarray, np.ndarray]]:
    """Level, scene, its second camera, true depth [mm] and where parts are, [h, w] each."""
    for name, record in sorted(json.loads((dataset / "scenes.json").read_text()).items()):
        folder = dataset / "test" / name
        scene = load_scene(folder)
        second = load_second(scene)
        if second is None:
            continue
        scale = json.loads((folder / "scene_camera.json").read_text())[str(scene.im_id)]["depth_scale"]
        image = f"{scene.im_id:06d}.png"
        truth = scale * cv2.imread(str(folder / "depth_exact" / image), cv2.IMREAD_UNCHANGED).astype(float)
        ids = cv2.imread(str(folder / "ids" / image), cv2.IMREAD_UNCHANGED)
        yield record["level"], scene, second, truth, (ids > 0) & (truth > 0.0)


def depth_maps(scene: Scene, second: SecondCamera) -> tuple[dict[str, np.ndarray], tuple[float, float]]:
    """Depth maps [mm] by the names of `WAYS`, and the seconds that stereo and block matching took."""
    start = time.perf_counter()
    stereo = dual_photometric_stereo(scene.images, scene.sensor, second)
    middle = time.perf_counter()
    pair = epipolar_pair(scene.images, scene.sensor, second)
    alone = to_first_camera(block_matching(pair, *searched(pair)), pair, scene.sensor.camera)
    took = middle - start, time.perf_counter() - middle
    matched, other = (np.where(some, stereo.depth, 0.0) for some in (stereo.by_needles, ~stereo.by_needles))
    return dict(zip(WAYS, (matched, other, stereo.depth, alone), strict=True)), took


def summed(rows: list[np.ndarray]) -> dict[str, float]:
    every = np.concatenate(rows)
    off = np.abs(every[np.isfinite(every)])
    if len(off) == 0:
        return {"scenes": len(rows), "pixels": len(every), "answered": 0.0}
    return {
        "scenes": len(rows),
        "pixels": len(every),
        "answered": len(off) / len(every),
        "median_mm": float(np.median(off)),
        **{f"within_{limit}": float((off < limit).mean()) for limit in WITHIN},
    }


def as_markdown(report: dict[str, Any]) -> str:
    lines = ["| level | pixels | answered | median | " + " | ".join(f"within {w:g} mm" for w in WITHIN) + " |"]
    lines.append("|" + "---|" * (4 + len(WITHIN)))
    for key, row in sorted(report["errors"].items(), key=lambda item: _order(item[0])):
        level, name = key.split(" | ")
        if row["answered"] == 0.0:
            lines.append(f"| {level} | {name} | 0 % |" + " - |" * (1 + len(WITHIN)))
            continue
        shares = " | ".join(f"{100 * row[f'within_{w}']:.1f} %" for w in WITHIN)
        lines.append(f"| {level} | {name} | {100 * row['answered']:.1f} % | {row['median_mm']:.2f} mm | {shares} |")
    lines += ["", "| median seconds per scene | |", "|---|---|"]
    lines += [f"| {name} | {seconds:.2f} |" for name, seconds in report["seconds"].items()]
    return "\n".join(lines) + "\n"


def _order(key: str) -> tuple[str, int]:
    level, name = key.split(" | ")
    return level, WAYS.index(name)


if __name__ == "__main__":
    main(tyro.cli(Config))
