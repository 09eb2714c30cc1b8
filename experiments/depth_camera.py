"""Bins seen by a depth camera alone: recall and precision, and how well its needles are known.

    python experiments/depth_camera.py [--scenes N] [--parts NAME...] [--sensor SENSOR] [--out DIR]

Needs the physics engine (extra `sim`). Compiles each bundled part for the depth camera, drops it into bins, and
recognises it as a user would. The second table compares the needles of the scenes' depth maps with the true normals of
the parts, by their distance from the nearest edge in the image (crease, step or border of a component face), and the
third with the needles that the trees' draws are made of (for a part at the working distance; those in a bin are
nearer, and their pixels smaller: 5 to 10 % more error).
"""

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from itree_cad.bundled import BUNDLED_PARTS, bundled_part
from itree_cad.part import Part
from itree_kernels.instances import Material
from itree_kernels.lit_scene import render_scene
from itree_kernels.mesh import ray_mesh
from jaxtyping import Bool, Float
from quality.comparison import group_table
from validate_simulated import Config as Simulated
from validate_simulated import scenes_of

from itree_jax.evaluation.report import Report, summarise
from itree_jax.evaluation.truth import load_truth
from itree_jax.sensing.depth_needles import RADIUS
from itree_jax.sensing.reading import read_needles
from itree_jax.sensing.scene_folder import load_scene, scene_folders
from itree_jax.sensing.sensor_file import load_sensor
from itree_jax.sensor import Sensor
from itree_jax.simulate.bin import bin_for, bin_ray_mesh, camera_above
from itree_jax.tree.depth_draws import depth_camera_needles

NEAR = (0.0, 1.0, 2.0, 4.0, 8.0)  # [px] from an edge: the lower ends of the table's rows
MOST_FOR_DRAWS = 48 * 48 * 8  # normals that the draws are made of


@dataclass(frozen=True)
class Config:
    out: Path = Path("out/depth_camera")
    parts: tuple[str, ...] = ("ikeuchi-1987", "bracket", "stepped-bushing")
    sensor: str = "bundled:depth-bench"
    scenes: int = 2  # per part
    seed: int = 0


@dataclass(frozen=True)
class Needles:
    """Pixels of parts that a depth camera detects."""

    distance: Float[np.ndarray, "pixels"]  # from the nearest edge [px]
    known: Bool[np.ndarray, "pixels"]
    error: Float[np.ndarray, "pixels"]  # [deg] between needle and true normal; of what isn't known it means nothing
    predicted: Float[np.ndarray, "pixels"]  # [deg]
    normals: Float[np.ndarray, "pixels 3"]  # true ones


def main(config: Config) -> None:
    """Writes `table.md` into `config.out` and prints it."""
    config.out.mkdir(parents=True, exist_ok=True)
    simulated = Simulated(out=config.out, sensor=config.sensor, scenes=config.scenes, seed=config.seed)
    answers = {name: scenes_of(name, simulated, k) for k, name in enumerate(config.parts)}
    groups = {"all": summarise([s for found in answers.values() for s in found.counts])}
    groups |= {f"part {name}": summarise(found.counts) for name, found in answers.items()}
    sensor = load_sensor(config.sensor)
    seen = {name: joined(needles_of(config.out / name / "dataset", name, sensor)) for name in config.parts}
    tables = [group_table(Report(groups, 0).to_json()["groups"]), by_edge(joined(seen.values())), by_part(seen, sensor)]
    (config.out / "table.md").write_text("\n".join(tables))
    print("\n".join(tables))


def needles_of(dataset: Path, name: str, sensor: Sensor) -> Iterator[Needles]:
    """The needles of every scene of a data set beside the true normals."""
    part = bundled_part(name)
    for folder, truth in zip(scene_folders(dataset), load_truth(dataset), strict=True):
        scene = load_scene(folder, sensor=sensor)
        found = read_needles(scene.images, scene.sensor, scene.depth)
        normals, on_part, edge = true_normals(part, truth.pose.R, truth.pose.t, scene.sensor)
        v, u = np.indices(on_part.shape)
        toward = -scene.sensor.camera.viewing_ray(np.stack([u, v], axis=-1).astype(float))
        detectable = on_part & ((normals * toward).sum(-1) > np.cos(scene.sensor.slant_limit))
        distance = cv2.distanceTransform((~edge).astype(np.uint8), cv2.DIST_L2, 5)
        yield Needles(
            distance[detectable], np.asarray(found.interpretable)[detectable],
            angles(np.asarray(found.normals)[detectable], normals[detectable]),
            np.degrees(np.asarray(found.normal_std)[detectable]), normals[detectable],
        )


def true_normals(
    part: Part, R_cam_obj: Float[np.ndarray, "parts 3 3"], t_cam_obj: Float[np.ndarray, "parts 3"], sensor: Sensor
) -> tuple[Float[np.ndarray, "h w 3"], Bool[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """Normals, where the parts are, and pixels beside an edge: another part or face is next to them."""
    bin_, T_cam_bin = bin_for(sensor, part.diameter), camera_above(sensor)
    meshes = [ray_mesh(part.vertices, part.triangles, part.face_of_triangle), bin_ray_mesh(bin_)]
    count = len(R_cam_obj)
    lit = render_scene(
        meshes, np.append(np.zeros(count, int), 1), np.concatenate([R_cam_obj, T_cam_bin[None, :3, :3]]),
        np.concatenate([t_cam_obj, T_cam_bin[None, :3, 3]]), sensor.camera, sensor.light_directions,
        sensor.light_intensities, Material(albedo=np.ones(count + 1), specular=np.zeros(count + 1), exponent=1.0),
    )  # fmt: skip
    label = lit.instance.astype(int) * (part.face_count + 1) + lit.face
    edge = np.zeros(label.shape, bool)
    for axis in (0, 1):
        differs = np.diff(label, axis=axis) != 0
        pad = [(0, 0), (0, 0)]
        for side in ((0, 1), (1, 0)):
            pad[axis] = side
            edge |= np.pad(differs, pad)
    return lit.normal, (lit.instance >= 0) & (lit.instance < count), edge


def angles(a: Float[np.ndarray, "n 3"], b: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Between unit vectors [deg]."""
    return np.degrees(2.0 * np.arcsin(np.clip(np.linalg.norm(a - b, axis=-1) / 2.0, 0.0, 1.0)))


def joined(parts: Iterable[Needles]) -> Needles:
    each = list(parts)
    names = ("distance", "known", "error", "predicted", "normals")
    return Needles(*(np.concatenate([getattr(one, name) for one in each]) for name in names))


def by_edge(seen: Needles) -> str:
    head = "| distance from an edge | pixels | with a needle | median error | 90 % | predicted rms |"
    rows = [head, "|---" * 6 + "|"]
    for low, high in zip(NEAR, (*NEAR[1:], np.inf), strict=True):
        here = (seen.distance >= low) & (seen.distance < high)
        known = here & seen.known
        rows.append(
            f"| {low:.0f} px and more | {here.sum()} | {100 * known.sum() / max(here.sum(), 1):.0f} % | "
            f"{np.median(seen.error[known]):.1f} deg | {np.percentile(seen.error[known], 90):.1f} deg | "
            f"{rms(seen.predicted[known]):.1f} deg |"
        )
    return "\n".join(rows) + "\n"


def by_part(seen: dict[str, Needles], sensor: Sensor) -> str:
    """The error of the scenes' needles beside that of draws with the same true normals."""
    rows = ["| part | with a needle | median error | 90 % | in draws: median | 90 % |", "|---" * 6 + "|"]
    for name, one in seen.items():
        shown = one.normals[:: max(1, len(one.normals) // MOST_FOR_DRAWS)]
        shown = shown[: len(shown) // 48**2 * 48**2].reshape(-1, 48, 48, 3)
        there = np.ones(shown.shape[:3], bool)
        pitch = (2 * RADIUS + 1) * sensor.mm_per_px  # neighbours here are none in the image: their fits share nothing
        wide = replace(sensor, slant_limit=np.pi / 2)
        _, needles = depth_camera_needles(there, shown.astype(np.float32), pitch, wide, np.random.default_rng(0))
        drawn, known = angles(needles.reshape(-1, 3), shown.reshape(-1, 3)), one.error[one.known]
        rows.append(
            f"| {name} | {100 * one.known.mean():.0f} % | {np.median(known):.1f} deg | {np.percentile(known, 90):.1f} "
            f"deg | {np.median(drawn):.1f} deg | {np.percentile(drawn, 90):.1f} deg |"
        )
    return "\n".join(rows) + "\n"


def rms(values: Float[np.ndarray, "n"]) -> float:
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Config.out)
    parser.add_argument("--parts", nargs="+", choices=BUNDLED_PARTS, default=Config.parts)
    parser.add_argument("--sensor", default=Config.sensor)
    parser.add_argument("--scenes", type=int, default=Config.scenes)
    parser.add_argument("--seed", type=int, default=Config.seed)
    given = vars(parser.parse_args())
    main(replace(Config(), **given | {"parts": tuple(given["parts"])}))
