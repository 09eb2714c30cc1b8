"""How long photometric stereo of one image under each of four lights takes, beside reading and writing their bytes.

    python experiments/benchmarks/photometric_stereo.py [--out out/photometric_stereo] [--repeats 50]

The images (640 x 480, four lights, noise) are a bin of the paper's parts. All of them are measured in turn in one run,
so that what else the machine does falls on all alike; medians are reported, and ratios of medians. Files are read and
written where the system keeps temporary ones, and are in the system's memory by then: no disk is waited for.
"""

import json
import os
import platform
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import cv2
import jax
import jax.numpy as jnp
import numpy as np
import tyro

from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.photometric import photometric_stereo
from itree_jax.sensor import Sensor
from itree_jax.simulate.demo import demo_scene


@dataclass(frozen=True)
class Config:
    out: Path = Path("out/photometric_stereo")
    repeats: int = 50  # of each, in turn


def main(config: Config) -> None:
    """Measures, prints a table, and writes `photometric_stereo.json` into `config.out`."""
    sensor = four_lights()
    images = np.ascontiguousarray(demo_scene(sensor, seed=0).images, np.float32)
    with tempfile.TemporaryDirectory() as folder:
        seconds = in_turn(tasks(images, sensor, Path(folder)), config.repeats)
    first, *others = seconds
    ratios = {name: seconds[first] / seconds[name] for name in others}
    machine = {"processor": platform.machine(), "cores": os.cpu_count(), "device": str(jax.devices()[0])}
    result = {"machine": machine, "config": asdict(config) | {"out": str(config.out)}, "images": images.shape}
    config.out.mkdir(parents=True, exist_ok=True)
    (config.out / "photometric_stereo.json").write_text(
        json.dumps(result | {"seconds": seconds, "ratios": ratios}, indent=2) + "\n"
    )
    print("| | median | photometric stereo takes |\n|---|---|---|")
    for name, median in seconds.items():
        print(f"| {name} | {1e3 * median:.1f} ms | {f'{ratios[name]:.2f} times it' if name in ratios else ''} |")


def four_lights() -> Sensor:
    """The bench with lights above, to the right, below and to the left, 35 degrees off the axis."""
    azimuth = np.radians([270.0, 0.0, 90.0, 180.0])
    sin, cos = np.sin(np.radians(35.0)), np.cos(np.radians(35.0))
    ring = np.stack([sin * np.cos(azimuth), sin * np.sin(azimuth), np.full(4, -cos)], axis=1)
    return replace(bundled_sensor("bench"), light_directions=ring, light_intensities=np.ones(4))


def tasks(images: np.ndarray, sensor: Sensor, folder: Path) -> dict[str, Callable[[], object]]:
    """What is timed, by name; photometric stereo first."""
    on_device = jnp.asarray(images)
    lights = jnp.asarray(sensor.light_directions), jnp.asarray(sensor.light_intensities)
    stored = np.round(65535.0 * np.clip(images, 0.0, 1.0)).astype(np.uint16)
    for k, image in enumerate(stored):
        cv2.imwrite(str(folder / f"{k}.png"), image)
        (folder / f"{k}.raw").write_bytes(image.tobytes())

    def png() -> None:
        for k in range(len(stored)):
            image = cv2.imread(str(folder / f"{k}.png"), cv2.IMREAD_UNCHANGED)
            cv2.imwrite(str(folder / f"{k}-again.png"), image)

    def raw() -> None:
        for k in range(len(stored)):
            (folder / f"{k}-again.raw").write_bytes((folder / f"{k}.raw").read_bytes())

    return {
        "photometric stereo": lambda: jax.block_until_ready(photometric_stereo(on_device, *lights, sensor.noise)),
        "reading and writing four 16-bit PNGs": png,
        "reading and writing the same bytes as they are": raw,
        "copying the float32 images in memory": images.copy,
    }


def in_turn(tasks: dict[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Median seconds of each, one after the other, over and over."""
    seconds: dict[str, list[float]] = {name: [] for name in tasks}
    for task in tasks.values():
        task()  # compiles, and fills the system's cache
    for _ in range(repeats):
        for name, task in tasks.items():
            start = time.perf_counter()
            task()
            seconds[name].append(time.perf_counter() - start)
    return {name: float(np.median(some)) for name, some in seconds.items()}


if __name__ == "__main__":
    main(tyro.cli(Config))
