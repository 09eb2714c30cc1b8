"""How compiling a tree grows with the number of views: seconds and memory of 60, 240, 960 and 3840 views.

    python experiments/benchmarks/compile_scaling.py [--out out/compile_scaling] [--parts MODEL ...] [--domes F ...]

Without --parts: the bundled parts, and every CAD file in $ITREE_DATA/cad. Each tree is compiled by a process of its
own, so that the peak of memory is its own; functions that JAX has compiled before come from its cache, so that a second
run of this command tells the time without compilation. CPU seconds are of all cores: other programs change them less
than the clock. The slope is that of log(CPU seconds of the stage that sees the dome) over log(views): 1 is linear.
Needs the extra `figures`.
"""

import json
import os
import platform
import resource
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from itree_cad.bundled import BUNDLED_PARTS

DOME_STAGE = "casting the dome"
SENSOR = "bundled:bench"
ASSEMBLIES = ("as1", "dm1")  # how the names of files of several solids begin


@dataclass(frozen=True)
class Config:
    out: Path = Path("out/compile_scaling")
    parts: tuple[str, ...] = ()
    domes: tuple[int, ...] = (1, 2, 4, 8)  # 60 f^2 views
    sensor: str = SENSOR
    most_minutes: float = 30.0  # for one tree


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


def main(config: Config) -> None:
    """Writes `compile_scaling.json` and `.png` into `config.out`, prints the table."""
    config.out.mkdir(parents=True, exist_ok=True)
    rows: list[Row] = []
    failed: dict[str, str] = {}
    for part in config.parts or every_part():
        for frequency in config.domes:
            row = measured(part, frequency, config)
            if isinstance(row, str):
                failed[f"{part}, dome {frequency}"] = row
                print(f"{part}, dome {frequency}: {row}", flush=True)
                break
            rows.append(row)
            print(as_table(rows[-1:], head=len(rows) == 1), flush=True)
    machine = {"processor": platform.machine(), "cores": os.cpu_count()}
    said = {"machine": machine, "rows": [asdict(row) for row in rows], "slopes": slopes(rows), "failed": failed}
    (config.out / "compile_scaling.json").write_text(json.dumps(said, indent=1) + "\n")
    for part, slope in slopes(rows).items():
        print(f"{part}: CPU seconds of the dome grow as views^{slope:.2f}")
    if rows:
        draw(rows, config.out / "compile_scaling.png")


def every_part() -> list[str]:
    """The bundled parts, and the CAD files of the data folder where there is one."""
    bundled = [f"bundled:{name}" for name in BUNDLED_PARTS]
    data = os.environ.get("ITREE_DATA")
    return bundled + ([str(p) for p in sorted((Path(data) / "cad").iterdir()) if p.is_file()] if data else [])


def measured(part: str, frequency: int, config: Config) -> Row | str:
    """One compilation in a process of its own; what went wrong, if it did."""
    words = [sys.executable, __file__, "--one", part, str(frequency), config.sensor]
    try:
        done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=60 * config.most_minutes)
    except subprocess.TimeoutExpired:
        return f"took longer than {config.most_minutes:.0f} minutes"
    if done.returncode:
        return done.stderr.strip().splitlines()[-1]
    return Row(**json.loads(done.stdout.splitlines()[-1]))


def compile_one(part: str, frequency: int, sensor: str) -> Row:
    """Compiles here; the part of an assembly is its first solid."""
    from itree_jax.cli.runtime import start_jax

    start_jax()
    from itree_cad.load import load_part

    from itree_jax.compile import compile_tree
    from itree_jax.sensing.sensor_file import load_sensor

    solid = 0 if Path(part).name.startswith(ASSEMBLIES) else None
    loaded = load_part(part, solid=solid)
    stages: dict[str, float] = {}
    last = ["", 0.0]

    def report(what: str, share: float) -> None:
        now = time.process_time()
        if last[0]:
            stages[last[0]] = stages.get(last[0], 0.0) + now - float(last[1])
        last[:] = [what, now]

    before, start, cpu_start = peak_mb(), time.perf_counter(), time.process_time()
    tree = compile_tree(loaded, load_sensor(sensor), dome_frequency=frequency, report=report)
    dome = sum(seconds for what, seconds in stages.items() if what.startswith(DOME_STAGE))
    return Row(
        loaded.name, len(loaded.triangles), frequency, len(tree.groups.directions), tree.groups.group_count,
        time.perf_counter() - start, time.process_time() - cpu_start, dome, before, peak_mb(), stages,
    )  # fmt: skip


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def slopes(rows: list[Row]) -> dict[str, float]:
    """By part, where there are two numbers of views or more."""
    found = {}
    for part in dict.fromkeys(row.part for row in rows):
        own = [row for row in rows if row.part == part]
        if len(own) > 1:
            x, y = np.log([r.views for r in own]), np.log([r.dome_cpu_seconds for r in own])
            found[part] = float(np.polyfit(x, y, 1)[0])
    return found


def as_table(rows: list[Row], head: bool) -> str:
    lines = [
        "| part | triangles | views | groups | s | CPU s | CPU ms per view of the dome | peak MB | MB of these |",
        "|---|---|---|---|---|---|---|---|---|",
    ] if head else []  # fmt: skip
    return "\n".join([*lines, *(
        f"| {r.part} | {r.triangles} | {r.views} | {r.groups} | {r.seconds:.0f} | {r.cpu_seconds:.0f} | "
        f"{1e3 * r.dome_cpu_seconds / r.views:.1f} | {r.peak_mb:.0f} | {r.peak_mb - r.before_mb:.0f} |"
        for r in rows
    )])  # fmt: skip


def draw(rows: list[Row], path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    time_axes, memory_axes = figure.subplots(1, 2)
    for part in dict.fromkeys(row.part for row in rows):
        own: list[Any] = [row for row in rows if row.part == part]
        views = [r.views for r in own]
        time_axes.loglog(views, [r.dome_cpu_seconds for r in own], "o-", label=part)
        memory_axes.semilogx(views, [r.peak_mb for r in own], "o-", label=part)
    time_axes.set(xlabel="views", ylabel="CPU seconds of the dome")
    memory_axes.set(xlabel="views", ylabel="peak memory [MB]", ylim=(0, None))
    memory_axes.legend(fontsize="small")
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        print(json.dumps(asdict(compile_one(sys.argv[2], int(sys.argv[3]), sys.argv[4]))))
    else:
        main(tyro.cli(Config))
