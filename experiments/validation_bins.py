"""Simulates the 200 bins that thresholds and scores are chosen by: 40 of each bundled part, in three levels.

    python experiments/validation_bins.py [--out DIR] [--scenes N] [--parts NAME ...] [--seed S]

A: Lambertian, direct light. B: light between the parts and the sensor's noise, three or four lights of told strengths.
C: as B with a specular lobe, lights off by 1 degree and 2 % from what is told. Every scene has a second camera 120 mm
to the right and a depth map of 0.3 mm noise. Needs the physics engine (extra `sim`). Scenes that are there are kept.
"""

import argparse
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from forest_parts import PART_NAMES, forest_part
from itree_cad.bundled import BUNDLED_PARTS
from itree_cad.part import Part

from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.scene_writer import write_scene
from itree_jax.sensor import Sensor
from itree_jax.simulate.bin import bin_for
from itree_jax.simulate.dataset import write_model
from itree_jax.simulate.imaging import LOOKS, ImageNoise, Look, image_bin
from itree_jax.simulate.settle import settle

SECOND_CAMERA = 120.0  # [mm] to the right
FEWEST, MOST = 5, 14  # parts dropped
LIGHT_TILT, LIGHT_STRENGTH = np.radians(1.0), 0.02  # how far level C's lights are off what is told
TOLD_STRENGTHS = (0.85, 1.15)  # of level B and C
CYCLE = ("A3", "B3", "C3", "A3", "B4", "B3", "C3", "A3", "B3", "B4")  # level and number of lights, scene after scene


@dataclass(frozen=True)
class Config:
    out: Path = Path("out/validation_bins")
    parts: tuple[str, ...] = BUNDLED_PARTS
    scenes: int = 40  # per part
    seed: int = 0


def main(config: Config) -> None:
    """Writes the data set; `scenes.json` tells part and level of each scene."""
    records: dict[str, Any] = {}
    for name in config.parts:
        obj_id = object_number(name)
        part = forest_part(name)
        write_model(part, obj_id, config.out / "models")
        for number in range(1, config.scenes + 1):
            scene_id = 100 * obj_id + number
            records[f"{scene_id:06d}"] = make_scene(part, obj_id, scene_id, number, config)
            print(f"{name} {number} / {config.scenes}", flush=True)
    path = config.out / "scenes.json"
    known = json.loads(path.read_text()) if path.is_file() else {}
    path.write_text(json.dumps(dict(sorted((known | records).items())), indent=1) + "\n")


def object_number(name: str) -> int:
    return 1 + PART_NAMES.index(name)


def bench(lights: int) -> Sensor:
    """The bundled bench with three lights, or with four in the diagonals."""
    sensor = bundled_sensor("bench")
    if lights == 3:
        return sensor
    azimuth = np.radians([45.0, 135.0, 225.0, 315.0])
    slant = np.arccos(-sensor.light_directions[0, 2])
    L = np.stack([np.sin(slant) * np.cos(azimuth), np.sin(slant) * np.sin(azimuth), np.full(4, -np.cos(slant))], axis=1)
    return replace(sensor, light_directions=L, light_intensities=np.ones(4))


def make_scene(part: Part, obj_id: int, scene_id: int, number: int, config: Config) -> dict[str, Any]:
    """One scene, written unless it is there; returns what `scenes.json` says of it."""
    level, lights = CYCLE[(number - 1) % len(CYCLE)]
    rng = np.random.default_rng([config.seed, scene_id])
    count = int(rng.integers(FEWEST, MOST + 1))
    told = bench(int(lights))
    if level != "A":
        told = replace(told, light_intensities=rng.uniform(*TOLD_STRENGTHS, told.light_count))
    true = lights_off(told, rng) if level == "C" else told
    look = look_of(level, rng)
    seeds = rng.integers(0, 2**31, 3).tolist()
    record = {
        "obj_id": obj_id, "part": part.name, "level": level, "kind": "bin", "lights": int(lights),
        "material": look.name,
    }  # fmt: skip
    folder = config.out / "test" / f"{scene_id:06d}"
    if folder.is_dir():
        return record
    bin_ = bin_for(told, part.diameter)
    T_bin_obj = settle(part, count, bin_, seeds[0])
    noise = ImageNoise(sensor=level != "A")
    views = [
        image_bin(
            part, T_bin_obj, bin_, true, look, noise, seed=seed, scene_id=scene_id, obj_id=obj_id, aside=aside, im_id=k
        )
        for k, (seed, aside) in enumerate(zip(seeds[1:], (0.0, SECOND_CAMERA), strict=True))
    ]
    (left, truth), (right, _) = views
    folder.parent.mkdir(parents=True, exist_ok=True)
    left, right = (with_told_lights(scene, told) for scene in (left, right))
    write_scene(folder, left, truth, right=right)
    return record


def look_of(level: str, rng: np.random.Generator) -> Look:
    """A: direct light on a Lambertian surface. B: light between the parts too. C: blasted metal or rough plastic."""
    if level == "A":
        return LOOKS["lambert"]
    if level == "B":
        return replace(LOOKS["reflecting"], albedo=float(rng.uniform(0.5, 0.8)))
    name = str(rng.choice(["metal", "plastic"]))
    return replace(LOOKS[name], ambient=0.0, reflected=LOOKS["reflecting"].reflected)


def lights_off(told: Sensor, rng: np.random.Generator) -> Sensor:
    """The lights as they are: each turned by `LIGHT_TILT` about a random axis across it, and its strength off."""
    L = told.light_directions
    across = np.cross(L, rng.normal(size=L.shape))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    directions = np.cos(LIGHT_TILT) * L + np.sin(LIGHT_TILT) * across
    strength = told.light_intensities * (1.0 + LIGHT_STRENGTH * rng.normal(size=len(L)))
    return replace(told, light_directions=directions, light_intensities=strength)


def with_told_lights(scene: Any, told: Sensor) -> Any:
    sensor = replace(
        scene.sensor, light_directions=told.light_directions, light_intensities=told.light_intensities
    )
    return replace(scene, sensor=sensor)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Config.out)
    parser.add_argument("--parts", nargs="+", choices=PART_NAMES, default=BUNDLED_PARTS)
    parser.add_argument("--scenes", type=int, default=Config.scenes)
    parser.add_argument("--seed", type=int, default=Config.seed)
    given = vars(parser.parse_args())
    main(Config(**given | {"parts": tuple(given["parts"])}))
