"""How compiling a tree grows with views and pixels: seconds and memory of 60, 240, 960 and 3840 views.

    python experiments/benchmarks/compile_scaling.py [--out out/compile_scaling] [--parts MODEL ...] [--domes F ...]

Without --parts: the bundled parts, and every CAD file in $ITREE_DATA/cad in its unit, of an assembly one solid
(`cad_files.py`). Each tree is compiled by a process of its own, so that the peak of memory is its own; functions that
JAX has compiled before come from its cache, so that a second run of this command tells the time without compilation.
CPU seconds are of all cores: other programs change them less than the clock. For each part the stage that sees the dome
is told again: the exponent e of CPU seconds ~ views^e (1 is linear), milliseconds per view more, and, of 60 views with
the part 64, 128 and 256 pixels across, the exponent in pixels. Needs the extra `figures`.
"""

import json
import os
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from cad_files import cad_files, label, load_given
from itree_cad.bundled import BUNDLED_PARTS
from itree_cad.part import Part

DOME_STAGE = "casting the dome"
SENSOR = "bundled:bench"
PIXELS_ACROSS = (64, 128, 256)  # the largest part of `detectable.MOST_PIXELS_ACROSS`
GOAL_TRIANGLES, GOAL_VIEWS, GOAL_SECONDS = 5000, 240, 20.0  # a part of so many at least, by the clock on two cores


@dataclass(frozen=True)
class Config:
    out: Path = Path("out/compile_scaling")
    parts: tuple[str, ...] = ()
    domes: tuple[int, ...] = (1, 2, 4, 8)  # 60 f^2 views
    sensor: str = SENSOR
    most_minutes: float = 30.0  # for one tree
    pixels: bool = True  # also grow the pixels


@dataclass(frozen=True)
class Row:
    part: str
    triangles: int
    dome: int
    views: int
    groups: int
    seconds: float
    cpu_seconds: float
    dome_cpu_seconds: float  # of the stage that sees the dome
    before_mb: float  # resident memory before the compilation
    peak_mb: float
    stages: dict[str, float]  # CPU seconds by what `itree compile` says it does


@dataclass(frozen=True)
class Growth:
    """Of one part's dome."""

    views_exponent: float | None  # None: of a single dome
    ms_per_view: float | None  # CPU, of the straight line through all domes
    pixels_exponent: float | None
    ns_per_pixel: float | None


def main(config: Config) -> None:
    """Writes `compile_scaling.json` and `.png` into `config.out`, prints the tables."""
    config.out.mkdir(parents=True, exist_ok=True)
    rows: list[Row] = []
    growth: dict[str, Growth] = {}
    failed: dict[str, str] = {}
    for part in config.parts or every_part():
        own: list[Row] = []
        for frequency in config.domes:
            told = in_its_own_process(["--one", part, str(frequency), config.sensor], config)
            if isinstance(told, str):
                failed[f"{part}, dome {frequency}"] = told
                print(f"{part}, dome {frequency}: {told}", flush=True)
                break
            own.append(Row(**told))
            print(as_table(own[-1:], head=not rows and len(own) == 1), flush=True)
        rows += own
        if own:
            growth[own[0].part] = grown(own, in_its_own_process(["--pixels", part, config.sensor], config)
                                        if config.pixels else None)  # fmt: skip
    machine = {"processor": platform.machine(), "cores": os.cpu_count()}
    said = {
        "machine": machine, "rows": [asdict(row) for row in rows],
        "growth": {part: asdict(g) for part, g in growth.items()}, "failed": failed,
    }  # fmt: skip
    (config.out / "compile_scaling.json").write_text(json.dumps(said, indent=1) + "\n")
    print("\n" + growth_table(growth) + "\n\n" + goal_lines(rows))
    if rows:
        draw(rows, config.out / "compile_scaling.png")


def every_part() -> list[str]:
    """The bundled parts, and the CAD files of the data folder where there is one."""
    return [f"bundled:{name}" for name in BUNDLED_PARTS] + [str(path) for path in cad_files()]


def in_its_own_process(words: list[str], config: Config) -> Any:
    """What this script prints when it is called with these words; in words what went wrong, if it did."""
    try:
        done = subprocess.run(
            [sys.executable, __file__, *words], capture_output=True, text=True, check=False,
            timeout=60 * config.most_minutes,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return f"took longer than {config.most_minutes:.0f} minutes"
    if done.returncode:
        return done.stderr.strip().splitlines()[-1]
    return json.loads(done.stdout.splitlines()[-1])


def compile_one(source: str, frequency: int, sensor: str) -> Row:
    """Compiles here."""
    from itree_jax.cli.runtime import start_jax

    start_jax()
    from itree_jax.compile import compile_tree
    from itree_jax.sensing.sensor_file import load_sensor

    part = load_given(source)
    stages: dict[str, float] = {}
    last = ["", 0.0]

    def report(what: str, share: float) -> None:
        now = time.process_time()
        if last[0]:
            stages[last[0]] = stages.get(last[0], 0.0) + now - float(last[1])
        last[:] = [what.split(":")[0], now]

    before, start, cpu_start = peak_mb(), time.perf_counter(), time.process_time()
    tree = compile_tree(part, load_sensor(sensor), dome_frequency=frequency, report=report)
    return Row(
        label(source, part), len(part.triangles), frequency, len(tree.groups.directions), tree.groups.group_count,
        time.perf_counter() - start, time.process_time() - cpu_start, stages[DOME_STAGE], before, peak_mb(), stages,
    )  # fmt: skip


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def pixel_seconds(source: str, sensor: str) -> list[tuple[int, float]]:
    """Pixels of 60 views, and the CPU seconds to see them, by how many pixels the part is across."""
    from itree_kernels.mesh import ray_mesh

    from itree_jax.sensing.sensor_file import load_sensor
    from itree_jax.sensor import Sensor
    from itree_jax.tree.detectable import detectable, part_camera
    from itree_jax.tree.dome import camera_rotation, dome

    def with_pixels(bench: Sensor, part: Part, across: int) -> Sensor:
        k = bench.mm_per_px * across / part.diameter
        return replace(bench, camera=replace(bench.camera, fx=bench.camera.fx * k, fy=bench.camera.fy * k))

    part, bench = load_given(source).about_middle(), load_sensor(sensor)
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle)
    R = camera_rotation(dome(1).directions)
    detectable(mesh, part, with_pixels(bench, part, PIXELS_ACROSS[0]), R[:1])  # loads the kernel
    found = []
    for across in PIXELS_ACROSS:
        finer = with_pixels(bench, part, across)
        start, camera = time.process_time(), part_camera(part, finer)
        detectable(mesh, part, finer, R)
        found.append((len(R) * camera.width * camera.height, time.process_time() - start))
    return found


def grown(rows: Sequence[Row], pixels: Any) -> Growth:
    """`pixels` as `pixel_seconds` gives them, or none."""
    views = [(r.views, r.dome_cpu_seconds) for r in rows]
    in_pixels = pixels if isinstance(pixels, list) else []
    return Growth(exponent(views), slope(views, 1e3), exponent(in_pixels), slope(in_pixels, 1e9))


def exponent(points: Sequence[tuple[float, float]]) -> float | None:
    """e of seconds ~ x^e."""
    return float(np.polyfit(*np.log(np.transpose(points)), 1)[0]) if len(points) > 1 else None


def slope(points: Sequence[tuple[float, float]], unit: float) -> float | None:
    """Seconds more per x more, in 1/unit."""
    return float(unit * np.polyfit(*np.transpose(points), 1)[0]) if len(points) > 1 else None


def as_table(rows: Sequence[Row], head: bool) -> str:
    lines = [
        "| part | triangles | views | groups | s | CPU s | CPU ms per view of the dome | peak MB | MB of these |",
        "|---|---|---|---|---|---|---|---|---|",
    ] if head else []  # fmt: skip
    return "\n".join([*lines, *(
        f"| {r.part} | {r.triangles} | {r.views} | {r.groups} | {r.seconds:.0f} | {r.cpu_seconds:.0f} | "
        f"{1e3 * r.dome_cpu_seconds / r.views:.1f} | {r.peak_mb:.0f} | {r.peak_mb - r.before_mb:.0f} |"
        for r in rows
    )])  # fmt: skip


def growth_table(growth: dict[str, Growth]) -> str:
    lines = [
        "| part | exponent in views | CPU ms per view more | exponent in pixels | CPU ns per pixel more |",
        "|---|---|---|---|---|",
    ]
    for part, g in growth.items():
        cells = (
            (g.views_exponent, ".2f"), (g.ms_per_view, ".1f"), (g.pixels_exponent, ".2f"), (g.ns_per_pixel, ".0f")
        )  # fmt: skip
        lines.append(f"| {part} | " + " | ".join("-" if x is None else format(x, form) for x, form in cells) + " |")
    return "\n".join(lines)


def goal_lines(rows: Sequence[Row]) -> str:
    """How long the trees of the goal take."""
    asked = [r for r in rows if r.views == GOAL_VIEWS and r.triangles >= GOAL_TRIANGLES]
    goal = f"on {os.cpu_count()} cores (goal: {GOAL_SECONDS:.0f} s on two)"
    return "\n".join(
        f"{r.part}, {r.triangles} triangles, {r.views} views: {r.seconds:.1f} s, {r.cpu_seconds:.1f} CPU s {goal}"
        for r in asked
    )


def draw(rows: Sequence[Row], path: Path) -> None:
    """The dome's seconds, the whole compilation's, and the peak of memory over the views; dashed: linear."""
    import matplotlib
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 4.6))
    panels = figure.subplots(1, 3)
    parts = list(dict.fromkeys(row.part for row in rows))
    for k, part in enumerate(parts):
        own = [row for row in rows if row.part == part]
        views = [r.views for r in own]
        style: dict[str, Any] = {
            "color": matplotlib.colormaps["tab20"](k % 20), "marker": "os^Dv"[k % 5], "ms": 4.5, "lw": 1.3,
            "label": f"{part} ({own[0].triangles:,})",
        }  # fmt: skip
        panels[0].plot(views, [r.dome_cpu_seconds for r in own], **style)
        panels[1].plot(views, [r.cpu_seconds for r in own], **style)
        panels[2].plot(views, [r.peak_mb for r in own], **style)
    domes = np.array(sorted({r.views for r in rows}))
    middle = np.median([r.dome_cpu_seconds / r.views for r in rows])
    panels[0].plot(domes, middle * domes, "--", color="#555555", lw=1.0, label="linear")
    panels[0].set(title="the stage that sees the dome", ylabel="CPU seconds", yscale="log")
    panels[1].set(title="the whole tree", ylabel="CPU seconds", ylim=(0, None))
    panels[2].set(title="peak of memory", ylabel="MB", ylim=(0, None))
    for axes in panels:
        axes.set(xlabel="views", xscale="log")
        axes.set_xticks(domes, [f"{n}" for n in domes])
        axes.xaxis.minorticks_off()
        axes.grid(color="#dddddd")
        axes.spines[["top", "right"]].set_visible(False)
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="lower center", ncols=4, frameon=False, fontsize=8, title="part (triangles)")
    figure.tight_layout(rect=(0.0, 0.07 + 0.045 * -(-len(names) // 4), 1.0, 1.0))
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        print(json.dumps(asdict(compile_one(sys.argv[2], int(sys.argv[3]), sys.argv[4]))))
    elif sys.argv[1:2] == ["--pixels"]:
        print(json.dumps(pixel_seconds(sys.argv[2], sys.argv[3])))
    else:
        main(tyro.cli(Config))
