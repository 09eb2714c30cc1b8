"""How many rays a second `cast_apparent_shapes` casts: an icosphere seen from many views, by one core and by all.

    python experiments/benchmarks/ray_casting.py --out out/ray_casting

Rays are those really cast: one for each pixel, and one toward each light from every point that faces it. The rate by
the clock is for a machine that does nothing else; the rate by the processor's time holds on a shared one too.
"""

import json
import os
import platform
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from unittest.mock import patch

import numpy as np
import trimesh
import tyro
import warp as wp
from itree_kernels.apparent import ApparentShapes, cast_apparent_shapes
from itree_kernels.camera import Camera
from itree_kernels.mesh import RayMesh, ray_mesh
from scipy.spatial.transform import Rotation

LIGHTS = np.array([[0.0, -0.5736, -0.8192], [-0.4967, 0.2868, -0.8192], [0.4967, 0.2868, -0.8192]])
RADIUS = 30.0  # [mm]


@dataclass(frozen=True)
class Config:
    out: Path = Path("out/ray_casting")
    subdivisions: int = 4  # of the icosphere: 20 * 4^n triangles
    views: int = 240
    size: int = 128  # [px]
    repeats: int = 5  # the fastest is reported
    device: str | None = None  # Warp's name; default: Warp's own choice


def main(config: Config) -> None:
    """Measures, prints a table, and writes `ray_casting.json` into `config.out`."""
    solid = trimesh.creation.icosphere(subdivisions=config.subdivisions, radius=RADIUS)
    mesh = ray_mesh(solid.vertices, solid.faces, np.arange(len(solid.faces)) % 32768, config.device)
    rows = [
        measure(mesh, camera, lights, threads, config)
        for camera in cameras(config.size)
        for lights in (LIGHTS[:0], LIGHTS)
        for threads in (sorted({1, os.cpu_count() or 1}) if mesh.device == "cpu" else [1])
    ]
    machine = {"processor": platform.machine(), "cores": os.cpu_count(), "device": mesh.device, "warp": wp.__version__}
    result = {"machine": machine, "triangles": len(solid.faces), "config": asdict(config) | {"out": str(config.out)}}
    config.out.mkdir(parents=True, exist_ok=True)
    (config.out / "ray_casting.json").write_text(json.dumps(result | {"rows": rows}, indent=2) + "\n")
    print(f"{len(solid.faces)} triangles, {config.views} views of {config.size} x {config.size}, {mesh.device}")
    print(f"{'camera':<14}{'lights':>7}{'threads':>9}{'seconds':>10}{'Mpixel/s':>10}{'Mray/s':>8}{'Mray/core-s':>13}")
    for row in rows:
        print(
            f"{row['camera']:<14}{row['lights']:>7}{row['threads']:>9}{row['seconds']:>10.3f}"
            f"{row['pixels_per_second'] / 1e6:>10.2f}{row['rays_per_second'] / 1e6:>8.2f}"
            f"{row['rays_per_core_second'] / 1e6:>13.2f}"
        )


def cameras(size: int) -> list[Camera]:
    """Both see the sphere fill about two thirds of the image; the pinhole from 10 radii away."""
    scale, centre = 0.94 * size / (2 * RADIUS), (size - 1) / 2
    focal = scale * 10 * RADIUS
    return [
        Camera("orthographic", scale, scale, centre, centre, size, size),
        Camera("pinhole", focal, focal, centre, centre, size, size),
    ]


def measure(mesh: RayMesh, camera: Camera, lights: np.ndarray, threads: int, config: Config) -> dict:
    lights = lights / np.linalg.norm(lights, axis=1, keepdims=True)
    R = Rotation.random(config.views, random_state=np.random.RandomState(0)).as_matrix()
    t = np.tile([0.0, 0.0, 10 * RADIUS], (config.views, 1))
    cast_apparent_shapes(mesh, R[:1], t[:1], camera, lights, np.deg2rad(42.0))  # compiles
    seconds, core_seconds = [], []
    with patch("os.cpu_count", return_value=threads):
        for _ in range(config.repeats):
            start, core_start = time.perf_counter(), time.process_time()
            shapes = cast_apparent_shapes(mesh, R, t, camera, lights, np.deg2rad(42.0))
            seconds.append(time.perf_counter() - start)
            core_seconds.append(time.process_time() - core_start)
    rays = ray_count(shapes, lights)
    return {
        "camera": camera.kind,
        "lights": len(lights),
        "threads": threads,
        "seconds": min(seconds),
        "pixels_per_second": shapes.face.size / min(seconds),
        "rays_per_second": rays / min(seconds),
        "rays_per_core_second": rays / min(core_seconds),
    }


def ray_count(shapes: ApparentShapes, lights: np.ndarray) -> int:
    """Primary rays, and shadow rays of the points that face their light."""
    return shapes.face.size + sum(int(np.count_nonzero(shapes.normal @ light > 0)) for light in lights)


if __name__ == "__main__":
    main(tyro.cli(Config))
