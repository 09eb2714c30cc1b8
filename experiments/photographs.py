"""Real photographs: needle maps against measured normals, and light calibration against itself.

    python experiments/photographs.py [--data FOLDER] [--out FOLDER]

`--data` is the folder `photometric` of the evaluation data: `ball` and `cat` (16 lights of DiLiGenT, with measured
normals), `chrome_sphere` and `gray_sphere` (12 photographs each of a mirror and a matte sphere under the same lights).
"""

import json
import os
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import scipy.io
import tyro

from itree_jax.cli.runtime import start_jax
from itree_jax.report.palette import WHITE
from itree_jax.report.scene_pictures import VIRIDIS, needle_colours
from itree_jax.sensing.image_file import png_bytes
from itree_jax.sensing.light_calibration.calibrate import SphereImages, calibrate, load_sphere
from itree_jax.sensing.light_calibration.matte import lights_from_shading
from itree_jax.sensing.light_source import FROM_VIEWER
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.needle_input import NeedleInput, load_needle_input
from itree_jax.sensing.photometric import least_squares, photometric_stereo

FULL_ERROR = 15.0  # [deg] at the end of the error maps' colours
BLOCK = 16  # [px] of the checkerboard whose white and black fields are the half sets of pixels


@dataclass(frozen=True)
class Config:
    """What to read and where to write."""

    data: Path = Path(os.environ.get("ITREE_DATA", "../shared/data")) / "photometric"
    """Folder of the photographs."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("out/photographs")
    """Folder for report.json, table.md and a picture of each object."""
    objects: tuple[str, ...] = ("ball", "cat")
    """Folders with measured normals."""


def main(config: Config) -> dict[str, Any]:
    """Writes `report.json`, `table.md` and the pictures into `config.out`, and prints the tables."""
    start_jax()
    config.out.mkdir(parents=True, exist_ok=True)
    report: dict[str, Any] = {"needles": {}, "lights": light_errors(config.data)}
    for name in config.objects:
        report["needles"][name] = needle_errors(config.data / name, config.out / f"{name}.png")
    (config.out / "report.json").write_text(json.dumps(report, indent=1) + "\n")
    table = needle_table(report["needles"]) + "\n" + light_lines(report["lights"])
    (config.out / "table.md").write_text(table)
    print(table)
    return report


def needle_errors(folder: Path, picture: Path) -> dict[str, Any]:
    """Angular errors [deg] of both methods with all lights and with three; draws needle maps and error maps."""
    given = load_needle_input(folder)
    truth = scipy.io.loadmat(folder / "Normal_gt.mat")["Normal_gt"] * FROM_VIEWER
    three = best_three(given.sensor.light_directions)
    rows, drawn, plain = {}, [], np.zeros(0)
    for lights, chosen in (("all", list(range(len(given.images)))), ("three", three)):
        for method in ("least squares", "robust"):
            needle = solve(given, chosen, method)
            error = angle_deg(needle.normals, truth)
            there = needle.interpretable & given.mask
            plain = error if method == "least squares" else plain
            rows[f"{method}, {lights}"] = {
                "lights": len(chosen), "answered": float(there.sum() / given.mask.sum()),
                "mean_deg": float(error[there].mean()), "median_deg": float(np.median(error[there])),
                "least_squares_mean_deg": float(plain[there].mean()),  # at the pixels that this method answers
            }  # fmt: skip
            shown = needle._replace(interpretable=there)
            words = f"{method}, {len(chosen)} lights: mean {error[there].mean():.2f} deg"
            drawn.append(tile(shown, error, given.mask, words))
    picture.write_bytes(png_bytes(np.concatenate(drawn, axis=1)))
    return {"three": three, "rows": rows}


def solve(given: NeedleInput, chosen: list[int], method: str) -> NeedleMap:
    s, images = given.sensor, given.images[chosen]
    L, e = s.light_directions[chosen], s.light_intensities[chosen]
    if method == "robust":
        found = photometric_stereo(images, L, e, s.noise, s.slant_limit)
    else:
        found = least_squares(images, L, e, s.noise)
    return NeedleMap(*(np.asarray(a) for a in found))


def best_three(L: np.ndarray) -> list[int]:
    """The three lights that determine normals best when all reach: of the largest determinant."""
    return list(max(combinations(range(len(L)), 3), key=lambda three: abs(np.linalg.det(L[list(three)]))))


def light_errors(data: Path) -> dict[str, Any]:
    """Degrees between calibrations of the same 12 lights, and between those of half sets."""
    chrome, matte = load_sphere(data / "chrome_sphere"), load_sphere(data / "gray_sphere")
    mirrored, shaded = calibrate([chrome], "chrome").directions, calibrate([matte], "matte")
    channels = {
        kind: [calibrate([load_sphere(data / folder, channel=c)], kind).directions for c in ("red", "blue")]
        for kind, folder in (("chrome", "chrome_sphere"), ("matte", "gray_sphere"))
    }
    return {
        "chrome against matte": summary(mirrored, shaded.directions),
        "matte, half of the pixels against the other": summary(*half_pixels(matte)),
        "chrome, red images against blue": summary(*channels["chrome"]),
        "matte, red images against blue": summary(*channels["matte"]),
        "matte residual [%]": {"median": float(100 * np.median(shaded.shading_residuals))},
    }


def half_pixels(matte: SphereImages) -> list[np.ndarray]:
    v, u = np.indices(matte.images.shape[1:]) // BLOCK
    return [lights_from_shading(matte.images, matte.sphere, (u + v) % 2 == k).directions for k in (0, 1)]


def summary(a: np.ndarray, b: np.ndarray) -> dict[str, Any]:
    degrees = angle_deg(a, b)
    return {"each": degrees.round(2).tolist(), "median": float(np.median(degrees)), "worst": float(degrees.max())}


def angle_deg(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle [deg] between unit vectors, accurate when small."""
    return np.degrees(2 * np.arcsin(np.clip(np.linalg.norm(np.asarray(a, float) - b, axis=-1) / 2, 0, 1)))


def tile(needle: NeedleMap, error: np.ndarray, mask: np.ndarray, words: str) -> np.ndarray:
    """Needle map above error map, both dark where there is no answer, cut to the object."""
    v, u = np.nonzero(mask)
    box = np.s_[v.min() : v.max() + 1, u.min() : u.max() + 1]
    level = np.clip(255 * error / FULL_ERROR, 0, 255).astype(np.uint8)
    colours = cv2.cvtColor(cv2.applyColorMap(level, VIRIDIS), cv2.COLOR_BGR2RGB)
    colours[~needle.interpretable] = 40
    stack = np.concatenate([needle_colours(needle)[box], colours[box]])
    side = cv2.resize(stack, None, fx=(scale := 300 / stack.shape[1]), fy=scale, interpolation=cv2.INTER_AREA)
    caption = np.zeros((22, side.shape[1], 3), np.uint8)
    cv2.putText(caption, words, (3, 15), cv2.FONT_HERSHEY_SIMPLEX, 0.38, WHITE, 1, cv2.LINE_AA)
    return np.pad(np.concatenate([caption, side]), ((0, 0), (2, 2), (0, 0)))


def needle_table(found: dict[str, Any]) -> str:
    heads = ("object", "method", "lights", "answered", "mean", "median", "least squares there")
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for name, result in found.items():
        for method, row in result["rows"].items():
            lines.append(
                f"| {name} | {method} | {row['lights']} | {100 * row['answered']:.1f} % | {row['mean_deg']:.2f} deg | "
                f"{row['median_deg']:.2f} deg | {row['least_squares_mean_deg']:.2f} deg |"
            )
        plain, robust = (result["rows"][f"{m}, all"]["mean_deg"] for m in ("least squares", "robust"))
        lines.append(f"| {name} | robust / least squares | | | {100 * (1 - robust / plain):.0f} % less | | |")
    return "\n".join(lines) + "\n"


def light_lines(found: dict[str, Any]) -> str:
    lines = ["| lights | median | worst |", "|---|---|---|"]
    for what, row in found.items():
        worst = f"{row['worst']:.2f}" if "worst" in row else ""
        lines.append(f"| {what} | {row['median']:.2f} | {worst} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main(tyro.cli(Config, description=__doc__))
