"""How many rays a second `cast_apparent_shapes` casts: an icosphere seen from many views, on one core and on two.

    python experiments/benchmarks/ray_casting.py --out out/ray_casting

Rays are those really cast: one for each pixel, and one toward each light from every point that faces it. Numbers are
medians. The rate by the clock is for a machine that does nothing else; that by the processor's time holds on a shared
one too.

Embree (extra `bench`) gets the same rays on as many threads, in turns with ours: nearest hits of all pixels, then
any-hit queries toward the lights, both in as many pieces as ours are launched in. Its rays lie ready in memory and its
answers stay there; ours makes the rays in the kernel and writes all maps of `ApparentShapes`. The binding hands Embree
one ray at a time, so what is compared is the program one would get from Python, not the best that Embree's packets
could do.

A bound: as many bytes as the maps hold are copied on as many threads. Memory lets nobody be faster than that.

On a CPU `cast_apparent_shapes` finds what the rays would meet triangle by triangle; the last rows cast the rays
instead, as it does on a GPU and for very fine meshes.
"""

import json
import os
import platform
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from unittest.mock import patch

import numpy as np
import trimesh
import tyro
import warp as wp
from itree_kernels import apparent
from itree_kernels.apparent import ApparentShapes, cast_apparent_shapes
from itree_kernels.camera import Camera
from itree_kernels.mesh import RayMesh, ray_mesh
from scipy.spatial.transform import Rotation

if TYPE_CHECKING:
    from embreex.rtcore_scene import EmbreeScene

LIGHTS = np.array([[0.0, -0.5736, -0.8192], [-0.4967, 0.2868, -0.8192], [0.4967, 0.2868, -0.8192]])
RADIUS = 30.0  # [mm]
SLANT_LIMIT = np.deg2rad(42.0)
PIECES = 4  # per thread, as `launch_in_chunks` has them: none waits long for the last one


@dataclass(frozen=True)
class Config:
    out: Path = Path("out/ray_casting")
    subdivisions: int = 4  # of the icosphere: 20 * 4^n triangles
    views: int = 240
    size: int = 128  # [px]
    repeats: int = 5  # of everything, in turns, after one that warms up
    threads: tuple[int, ...] = (1, 2)
    device: str | None = None  # Warp's name; default: Warp's own choice


class Spent(NamedTuple):
    clock: float  # [s]
    cpu: float  # [s] of all cores


Runs = dict[str, dict[int, list[Spent]]]  # by who ran and on how many threads


def main(config: Config) -> None:
    """Measures, prints a table, and writes `ray_casting.json` into `config.out`."""
    solid = trimesh.creation.icosphere(subdivisions=config.subdivisions, radius=RADIUS)
    mesh = ray_mesh(solid.vertices, solid.faces, np.arange(len(solid.faces)) % 32768, config.device)
    embree = embree_scene(solid)
    rows = [
        row
        for by_rays in (False, True)
        for camera in cameras(config.size)
        for lights in (LIGHTS[:0], LIGHTS)
        for row in measure(mesh, camera, lights, config, embree, by_rays)
    ]
    machine = {"processor": platform.machine(), "cores": os.cpu_count(), "device": mesh.device, "warp": wp.__version__}
    result = {"machine": machine, "triangles": len(solid.faces), "config": asdict(config) | {"out": str(config.out)}}
    config.out.mkdir(parents=True, exist_ok=True)
    (config.out / "ray_casting.json").write_text(json.dumps(result | {"rows": rows}, indent=2) + "\n")
    print(f"{len(solid.faces)} triangles, {config.views} views of {config.size} x {config.size}, {mesh.device}\n")
    print(as_table(rows))


def as_table(rows: list[dict[str, Any]]) -> str:
    lines = [
        "| what | threads | s | Mpixel/s | Mray/s | Mray/core-s | speed against Embree, clock | CPU | "
        "faster than on one thread | Embree | share of the time that copying the bytes takes |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        rates = (f"{row[name] / 1e6:.2f}" for name in ("pixels_per_second", "rays_per_second", "rays_per_core_second"))
        told = (in_words(row[name]) for name in ("of_embree", "of_embree_cpu", "speed_up", "embree_speed_up"))
        cells = (row["what"], str(row["threads"]), f"{row['seconds']:.3f}", *rates, *told)
        lines.append("| " + " | ".join(cells) + f" | {100 * row['copy_share']:.1f} % |")
    return "\n".join(lines)


def in_words(ratio: float | None) -> str:
    return "-" if ratio is None else f"{ratio:.2f}"


def cameras(size: int) -> list[Camera]:
    """Both see the sphere fill about two thirds of the image; the pinhole from 10 radii away."""
    scale, centre = 0.94 * size / (2 * RADIUS), (size - 1) / 2
    focal = scale * 10 * RADIUS
    return [
        Camera("orthographic", scale, scale, centre, centre, size, size),
        Camera("pinhole", focal, focal, centre, centre, size, size),
    ]


def measure(
    mesh: RayMesh, camera: Camera, lights: np.ndarray, config: Config, embree: "EmbreeScene | None", by_rays: bool
) -> list[dict[str, Any]]:
    """Rays from this camera: a row per number of threads."""
    lights = lights / np.linalg.norm(lights, axis=1, keepdims=True)
    R, t = poses(config.views)
    shapes = cast_apparent_shapes(mesh, R, t, camera, lights, SLANT_LIMIT)
    queries = None if embree is None else queries_for_embree(mesh, R, t, camera, lights)

    def cast(threads: int) -> Spent:
        chosen = patch.object(apparent, "fills", return_value=False) if by_rays else nullcontext()
        with patch("os.cpu_count", return_value=threads), chosen:
            return spent(lambda: cast_apparent_shapes(mesh, R, t, camera, lights, SLANT_LIMIT))

    written = sum(m.nbytes for m in (shapes.face, shapes.depth, shapes.normal, shapes.lit, shapes.detectable))
    runs = in_turns(cast, rival(embree, queries), written, mesh.device, config)
    told = {
        "what": f"{camera.kind}, {len(lights)} lights{', by rays' if by_rays else ''}",
        "bytes_per_pixel": written / shapes.face.size,
        "hits_differ": None if queries is None or embree is None else hits_differ(embree, queries, shapes),
    }  # fmt: skip
    return [told | row for row in table_rows(shapes.face.size, ray_count(shapes, lights), runs)]


def rival(embree: "EmbreeScene | None", queries: "Queries | None") -> Callable[[int], Spent] | None:
    return None if embree is None or queries is None else lambda threads: embree_seconds(embree, queries, threads)


def in_turns(
    ours: Callable[[int], Spent], embree: Callable[[int], Spent] | None, count: int, device: str, config: Config
) -> Runs:
    """Ours, Embree and a copy of `count` bytes, one after the other on each number of threads, over and over."""
    source, target = np.ones(count, np.uint8), np.zeros(count, np.uint8)
    contestants = {"ours": ours, "copy": lambda threads: copy_seconds(source, target, threads)}
    if embree is not None:
        contestants["embree"] = embree
    threads = config.threads if device == "cpu" else (1,)
    runs: Runs = {name: {n: [] for n in threads} for name in contestants}
    for repeat in range(1 + config.repeats):
        for n in threads:
            for name, run in contestants.items():
                done = run(n)
                if repeat:
                    runs[name][n].append(done)
    return runs


def table_rows(pixels: int, rays: int, runs: Runs) -> list[dict[str, Any]]:
    """A row per number of threads; ratios are medians of those inside one turn."""
    ours, copy, embree = runs["ours"], runs["copy"], runs.get("embree")
    least, rows = min(ours), []
    for n in ours:
        seconds, core_seconds = (float(np.median(column)) for column in zip(*ours[n], strict=True))
        rows.append({
            "threads": n, "seconds": seconds, "pixels_per_second": pixels / seconds, "rays_per_second": rays / seconds,
            "rays_per_core_second": rays / core_seconds,
            "of_embree": ratio(embree[n], ours[n], 0) if embree else None,
            "of_embree_cpu": ratio(embree[n], ours[n], 1) if embree else None,
            "speed_up": ratio(ours[least], ours[n], 0),
            "embree_speed_up": ratio(embree[least], embree[n], 0) if embree else None,
            "copy_share": ratio(copy[n], ours[n], 0),
        })  # fmt: skip
    return rows


def ratio(over: list[Spent], under: list[Spent], which: int) -> float:
    return float(np.median([a[which] / b[which] for a, b in zip(over, under, strict=True)]))


def spent(work: Callable[[], object]) -> Spent:
    start, cpu = time.perf_counter(), time.process_time()
    work()
    return Spent(time.perf_counter() - start, time.process_time() - cpu)


def poses(views: int) -> tuple[np.ndarray, np.ndarray]:
    """At random attitudes, 10 radii away."""
    R = Rotation.random(views, random_state=np.random.RandomState(0)).as_matrix()
    return R, np.tile([0.0, 0.0, 10 * RADIUS], (views, 1))


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


def embree_seconds(scene: "EmbreeScene", queries: Queries, threads: int) -> Spent:
    """All rays on so many threads; the binding lets go of the interpreter's lock while it casts."""

    def run(query: str, origins: np.ndarray, directions: np.ndarray) -> None:
        on_threads(lambda *rays: scene.run(*rays, query=query), (origins, directions), threads)

    def cast() -> None:
        run("INTERSECT", *queries.pixels)
        if len(queries.shadows[0]):
            run("OCCLUDED", *queries.shadows)

    return spent(cast)


def copy_seconds(source: np.ndarray, target: np.ndarray, threads: int) -> Spent:
    return spent(lambda: on_threads(lambda a, b: np.copyto(b, a), (source, target), threads))


def on_threads(work: Callable[..., object], arrays: tuple[np.ndarray, ...], threads: int) -> None:
    """Calls `work` on pieces of the arrays; on one thread on all of them, as `launch_in_chunks` does."""
    if threads == 1:
        work(*arrays)
        return
    pieces = zip(*(np.array_split(array, PIECES * threads) for array in arrays), strict=True)
    for done in [_pool(threads).submit(work, *piece) for piece in pieces]:
        done.result()


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads)


def hits_differ(scene: "EmbreeScene", queries: Queries, shapes: ApparentShapes) -> float:
    """Share of pixels where one hits and the other does not: that it is the same rays shows."""
    hit = scene.run(*queries.pixels, query="INTERSECT").reshape(shapes.face.shape) >= 0
    return float(np.mean(hit != (shapes.face >= 0)))


def ray_count(shapes: ApparentShapes, lights: np.ndarray) -> int:
    """Primary rays, and shadow rays of the points that face their light."""
    return shapes.face.size + sum(int(np.count_nonzero(shapes.normal @ light > 0)) for light in lights)


if __name__ == "__main__":
    main(tyro.cli(Config))
