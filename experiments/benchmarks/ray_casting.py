"""How many rays a second `cast_apparent_shapes` casts: an icosphere seen from many views, by one core and by all.

    python experiments/benchmarks/ray_casting.py --out out/ray_casting

Rays are those really cast: one for each pixel, and one toward each light from every point that faces it. The rate by
the clock is for a machine that does nothing else; the rate by the processor's time holds on a shared one too.

Embree (extra `bench`) gets the same rays on one core, in turns with ours: nearest hits of
all pixels, then any-hit queries toward the lights. Its rays lie ready in memory and its answers stay there; ours makes
the rays in the kernel and writes all maps of `ApparentShapes`. The binding hands Embree one ray at a time, so what is
compared is the program one would get from Python, not the best that Embree's packets could do.

Last, the same pixels filled triangle by triangle (`itree_kernels.raster`): nearest hits alone, no lights.
"""

import json
import os
import platform
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from unittest.mock import patch

import numpy as np
import trimesh
import tyro
import warp as wp
from itree_kernels.apparent import ApparentShapes, cast_apparent_shapes
from itree_kernels.camera import Camera
from itree_kernels.mesh import RayMesh, ray_mesh
from itree_kernels.raster import raster_kernel
from itree_kernels.rays import camera_vector
from itree_kernels.warp_start import load_kernel
from scipy.spatial.transform import Rotation

if TYPE_CHECKING:
    from embreex.rtcore_scene import EmbreeScene

LIGHTS = np.array([[0.0, -0.5736, -0.8192], [-0.4967, 0.2868, -0.8192], [0.4967, 0.2868, -0.8192]])
RADIUS = 30.0  # [mm]


@dataclass(frozen=True)
class Config:
    out: Path = Path("out/ray_casting")
    subdivisions: int = 4  # of the icosphere: 20 * 4^n triangles
    views: int = 240
    size: int = 128  # [px]
    repeats: int = 5  # the fastest is reported, and the median of the ratios
    device: str | None = None  # Warp's name; default: Warp's own choice


def main(config: Config) -> None:
    """Measures, prints a table, and writes `ray_casting.json` into `config.out`."""
    solid = trimesh.creation.icosphere(subdivisions=config.subdivisions, radius=RADIUS)
    mesh = ray_mesh(solid.vertices, solid.faces, np.arange(len(solid.faces)) % 32768, config.device)
    embree = embree_scene(solid)
    rows = [
        measure(mesh, camera, lights, threads, config, embree)
        for camera in cameras(config.size)
        for lights in (LIGHTS[:0], LIGHTS)
        for threads in (sorted({1, os.cpu_count() or 1}) if mesh.device == "cpu" else [1])
    ]
    filled = []
    if mesh.device == "cpu":
        filled = [filled_ratio(mesh, camera, config, embree) for camera in cameras(config.size)]
    machine = {"processor": platform.machine(), "cores": os.cpu_count(), "device": mesh.device, "warp": wp.__version__}
    result = {"machine": machine, "triangles": len(solid.faces), "config": asdict(config) | {"out": str(config.out)}}
    config.out.mkdir(parents=True, exist_ok=True)
    (config.out / "ray_casting.json").write_text(json.dumps(result | {"rows": rows, "filled": filled}, indent=2) + "\n")
    print(f"{len(solid.faces)} triangles, {config.views} views of {config.size} x {config.size}, {mesh.device}")
    print(
        f"{'camera':<14}{'lights':>7}{'threads':>9}{'seconds':>10}{'Mpixel/s':>10}{'Mray/s':>8}{'Mray/core-s':>13}"
        f"{'of Embree':>11}"
    )
    for row in rows:
        print(
            f"{row['camera']:<14}{row['lights']:>7}{row['threads']:>9}{row['seconds']:>10.3f}"
            f"{row['pixels_per_second'] / 1e6:>10.2f}{row['rays_per_second'] / 1e6:>8.2f}"
            f"{row['rays_per_core_second'] / 1e6:>13.2f}{ratio_in_words(row):>11}"
        )

    for row in filled:
        rate = f"{row['pixels_per_core_second'] / 1e6:.2f} Mpixel/core-s, {ratio_in_words(row)} of Embree"
        print(f"{row['camera']}, filled triangle by triangle: {rate}")


def cameras(size: int) -> list[Camera]:
    """Both see the sphere fill about two thirds of the image; the pinhole from 10 radii away."""
    scale, centre = 0.94 * size / (2 * RADIUS), (size - 1) / 2
    focal = scale * 10 * RADIUS
    return [
        Camera("orthographic", scale, scale, centre, centre, size, size),
        Camera("pinhole", focal, focal, centre, centre, size, size),
    ]


def measure(
    mesh: RayMesh, camera: Camera, lights: np.ndarray, threads: int, config: Config, embree: "EmbreeScene | None"
) -> dict:
    """Ours and Embree in turns; `of_embree` is the median ratio of rays per second of the processor."""
    lights = lights / np.linalg.norm(lights, axis=1, keepdims=True)
    R, t = poses(config.views)
    cast_apparent_shapes(mesh, R[:1], t[:1], camera, lights, np.deg2rad(42.0))  # compiles
    seconds, core_seconds, of_embree = [], [], []
    queries = None if embree is None else queries_for_embree(mesh, R, t, camera, lights)
    with patch("os.cpu_count", return_value=threads):
        for _ in range(config.repeats):
            start, core_start = time.perf_counter(), time.process_time()
            shapes = cast_apparent_shapes(mesh, R, t, camera, lights, np.deg2rad(42.0))
            seconds.append(time.perf_counter() - start)
            core_seconds.append(time.process_time() - core_start)
            if embree is not None and queries is not None:
                of_embree.append(embree_seconds(embree, queries) / core_seconds[-1])
    rays = ray_count(shapes, lights)
    return {
        "camera": camera.kind,
        "lights": len(lights),
        "threads": threads,
        "seconds": min(seconds),
        "pixels_per_second": shapes.face.size / min(seconds),
        "rays_per_second": rays / min(seconds),
        "rays_per_core_second": rays / min(core_seconds),
        "of_embree": float(np.median(of_embree)) if of_embree else None,
        "hits_differ": None if queries is None or embree is None else hits_differ(embree, queries, shapes),
    }


def filled_ratio(mesh: RayMesh, camera: Camera, config: Config, embree: "EmbreeScene | None") -> dict:
    """Seconds of one core that filling takes per pixel; `of_embree` as in `measure`, for nearest hits alone."""
    R, t = poses(config.views)
    shape, device = (config.views, camera.height, camera.width), mesh.device
    depth, triangle = wp.zeros(shape, dtype=float, device=device), wp.zeros(shape, dtype=int, device=device)
    inputs = [
        mesh.warp_mesh.points, mesh.warp_mesh.indices, mesh.normals_obj, int(mesh.is_closed),
        wp.array(R.astype(np.float32), dtype=wp.mat33, device=device),
        wp.array(t.astype(np.float32), dtype=wp.vec3, device=device),
        wp.zeros(config.views, dtype=wp.vec2, device=device), camera_vector(camera), int(camera.is_orthographic), 1.0,
        0, wp.full(config.views, 1, dtype=int, device=device),
    ]  # fmt: skip
    load_kernel(raster_kernel, device)
    queries = None if embree is None else queries_for_embree(mesh, R, t, camera, LIGHTS[:0])
    seconds, of_embree = [], []
    for _ in range(config.repeats):
        start = time.process_time()
        wp.launch(raster_kernel, dim=config.views, inputs=inputs, outputs=[depth, triangle], device=device)
        seconds.append(time.process_time() - start)
        if embree is not None and queries is not None:
            of_embree.append(embree_seconds(embree, queries) / seconds[-1])
    shapes = cast_apparent_shapes(mesh, R, t, camera, LIGHTS[:0], np.deg2rad(42.0))
    return {
        "camera": camera.kind,
        "pixels_per_core_second": triangle.size / min(seconds),
        "of_embree": float(np.median(of_embree)) if of_embree else None,
        "hits_differ": float(np.mean((triangle.numpy() >= 0) != (shapes.face >= 0))),  # from ours, on outlines
    }


def poses(views: int) -> tuple[np.ndarray, np.ndarray]:
    """At random attitudes, 10 radii away."""
    R = Rotation.random(views, random_state=np.random.RandomState(0)).as_matrix()
    return R, np.tile([0.0, 0.0, 10 * RADIUS], (views, 1))


def ratio_in_words(row: dict) -> str:
    return "-" if row["of_embree"] is None else f"{row['of_embree']:.2f}"


@dataclass(frozen=True)
class Queries:
    """The rays of `cast_apparent_shapes` in the part's frame, float32 as Embree takes them."""

    pixels: tuple[np.ndarray, np.ndarray]  # origins [mm], directions
    shadows: tuple[np.ndarray, np.ndarray]  # of the points that face a light


def embree_scene(solid: trimesh.Trimesh) -> "EmbreeScene | None":
    """None where Embree is not installed."""
    try:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
    except ImportError:
        return None
    scene = EmbreeScene()
    TriangleMesh(scene, np.asarray(solid.vertices[solid.faces], np.float32))
    return scene


def queries_for_embree(mesh: RayMesh, R: np.ndarray, t: np.ndarray, camera: Camera, lights: np.ndarray) -> Queries:
    """All rays of all views; those toward the lights start a little above the surface."""
    v, u = np.mgrid[: camera.height, : camera.width].reshape(2, -1)
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    if camera.is_orthographic:
        origins, directions = np.stack([x, y, 0 * x], axis=1), np.tile([0.0, 0.0, 1.0], (len(x), 1))
    else:
        directions = np.stack([x, y, np.ones_like(x)], axis=1)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        origins = np.zeros_like(directions)
    start = np.einsum("npx,nxy->npy", origins[None] - t[:, None], R).reshape(-1, 3)  # x_obj = R^T (x_cam - t)
    toward = np.einsum("px,nxy->npy", directions, R).reshape(-1, 3)
    shapes = cast_apparent_shapes(mesh, R, t, camera, lights, np.deg2rad(42.0))
    normal, depth = shapes.normal.reshape(-1, 3), shapes.depth.reshape(-1)
    along = depth if camera.is_orthographic else depth / np.tile(directions[:, 2], len(R))
    normal_obj = np.einsum("npx,nxy->npy", normal.reshape(len(R), -1, 3), R).reshape(-1, 3)
    above = start + along[:, None] * toward + mesh.shadow_offset * normal_obj
    of_light = [np.flatnonzero((depth > 0) & (normal @ light > 0)) for light in lights]
    lights_obj = [np.einsum("x,nxy->ny", light, R).repeat(len(x), axis=0) for light in lights]
    none = [np.zeros((0, 3))]
    return Queries(
        (start.astype(np.float32), toward.astype(np.float32)),
        (
            np.concatenate([above[k] for k in of_light] or none).astype(np.float32),
            np.concatenate([L[k] for L, k in zip(lights_obj, of_light, strict=True)] or none).astype(np.float32),
        ),
    )


def embree_seconds(scene: "EmbreeScene", queries: Queries) -> float:
    """Of the processor."""
    start = time.process_time()
    scene.run(*queries.pixels, query="INTERSECT")
    if len(queries.shadows[0]):
        scene.run(*queries.shadows, query="OCCLUDED")
    return time.process_time() - start


def hits_differ(scene: "EmbreeScene", queries: Queries, shapes: ApparentShapes) -> float:
    """Share of pixels where one hits and the other does not: that it is the same rays shows."""
    hit = scene.run(*queries.pixels, query="INTERSECT").reshape(shapes.face.shape) >= 0
    return float(np.mean(hit != (shapes.face >= 0)))


def ray_count(shapes: ApparentShapes, lights: np.ndarray) -> int:
    """Primary rays, and shadow rays of the points that face their light."""
    return shapes.face.size + sum(int(np.count_nonzero(shapes.normal @ light > 0)) for light in lights)


if __name__ == "__main__":
    main(tyro.cli(Config))
