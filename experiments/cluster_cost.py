"""What a million scenes and ten thousand parts cost, from units measured here; and whether a cluster gives the same.

    python experiments/cluster_cost.py [--out out/cluster_cost] [--parts NAME ...] [--scenes N] [--drop N] [--workers N]

Bundled parts are compiled and simulated bins of the first of them recognised (extra `sim`), once in this process and
once on a local Ray cluster (extra `cluster`). Every file but the records of seconds must then be the same to the byte;
the command fails otherwise. The cost is counted in core hours: CPU seconds of all cores, which other programs on the
machine change less than the clock, the median of the units, times how many there are.
"""

import json
import os
import platform
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median

import tyro
from itree_cad.bundled import bundled_part

from itree_jax.cli.compile_catalogue import Options, compile_part, compile_units
from itree_jax.cli.recognize_dataset import recognize_folder, scene_units, write_csv
from itree_jax.cluster import Ran, ThisMachine, Unit, Workers, run_units
from itree_jax.cluster.finished_units import RECORDS
from itree_jax.cluster.ray_workers import ray_workers
from itree_jax.cluster.unit import Work
from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.simulate import simulate

PARTS, SCENES = 10_000, 1_000_000  # whose cost is told
CORES = (16, 256, 1024)


@dataclass(frozen=True)
class Config:
    out: Path = Path("out/cluster_cost")
    parts: tuple[str, ...] = ("plate", "bracket", "clevis")
    scenes: int = 4
    drop: int = 4  # parts into each bin
    workers: int = 2
    price: float = 0.04  # of a core hour, in whatever currency


@dataclass(frozen=True)
class Measured:
    """One kind of unit, in this process and on the cluster."""

    what: str
    units: int
    cpu_seconds: float  # median per unit, in this process
    seconds: float
    cluster_cpu_seconds: float
    megabytes: float  # of what a unit leaves
    same_bytes: bool


def main(config: Config) -> None:
    """Writes `cluster_cost.json`, prints the tables."""
    config.out.mkdir(parents=True, exist_ok=True)
    sensor, dataset = bundled_sensor("bench"), config.out / "dataset"
    if not dataset.exists():
        simulate(bundled_part(config.parts[0]), sensor, config.scenes, config.drop, dataset)
    parts = compile_units([f"bundled:{name}" for name in config.parts], sensor, Options())
    with ray_workers("local", config.workers) as workers:
        compiled = measured("part", parts, compile_part, config.out / "trees", workers)
        trees = [config.out / "trees" / "here" / f"{config.parts[0]}.tree"]
        scenes = scene_units(dataset, trees, "auto")
        recognised = measured("scene", scenes, recognize_folder, config.out / "answers", workers)
    machine = {"processor": platform.machine(), "cores": os.cpu_count()}
    rows = [cost(recognised, SCENES, config.price), cost(compiled, PARTS, config.price)]
    said = {"machine": machine, "measured": [asdict(recognised), asdict(compiled)], "cost": rows}
    (config.out / "cluster_cost.json").write_text(json.dumps(said, indent=1) + "\n")
    print("\n".join([*measured_table([recognised, compiled]), "", *cost_table(rows)]))
    if not (compiled.same_bytes and recognised.same_bytes):
        raise SystemExit("the cluster's files are not those of one process")


def measured(what: str, units: list[Unit], work: Work, folder: Path, workers: Workers) -> Measured:
    """Does the units twice; what is there already from an earlier run of this command counts as it was measured."""
    folder.mkdir(exist_ok=True)
    here = finished(units, work, folder / "here", ThisMachine())
    there = finished(units, work, folder / "cluster", workers)
    files = results_of(folder / "here")
    return Measured(
        what, len(units), median(one.cpu_seconds for one in here.done), median(one.seconds for one in here.done),
        median(one.cpu_seconds for one in there.done), sum(map(len, files.values())) / len(units) / 1e6,
        files == results_of(folder / "cluster"),
    )  # fmt: skip


def finished(units: list[Unit], work: Work, folder: Path, workers: Workers) -> Ran:
    ran = run_units(units, work, folder, workers, lambda what, share: print(f"{folder}: {what}", flush=True))
    if ran.failures:
        raise SystemExit(json.dumps(ran.failures, indent=1))
    if units[0].name.isdecimal():
        write_csv(ran, folder)
    return ran


def results_of(folder: Path) -> dict[str, bytes]:
    """All files but the records, which tell seconds."""
    paths = (p for p in folder.rglob("*") if p.is_file() and p.parent.name != RECORDS)
    return {str(p.relative_to(folder)): p.read_bytes() for p in paths}


def cost(one: Measured, count: int, price: float) -> dict[str, float | str]:
    hours = one.cpu_seconds * count / 3600.0
    return {
        "what": f"{count:,} {one.what}s", "cpu_seconds": one.cpu_seconds, "core_hours": hours, "price": hours * price,
        "gigabytes": one.megabytes * count / 1e3, **{f"hours_on_{cores}": hours / cores for cores in CORES},
    }  # fmt: skip


def measured_table(rows: list[Measured]) -> list[str]:
    head = ["| unit | measured | CPU s | s | CPU s on the cluster | MB | same bytes |", "|---|---|---|---|---|---|---|"]
    return head + [
        f"| {r.what} | {r.units} | {r.cpu_seconds:.1f} | {r.seconds:.1f} | {r.cluster_cpu_seconds:.1f} | "
        f"{r.megabytes:.2f} | {'yes' if r.same_bytes else 'NO'} |"
        for r in rows
    ]


def cost_table(rows: list[dict[str, float | str]]) -> list[str]:
    on = "".join(f" hours on {cores} cores |" for cores in CORES)
    head = [f"| what | CPU s each | core hours |{on} GB | price |", "|---|---|---|" + "---|" * (len(CORES) + 2)]
    return head + [
        f"| {r['what']} | {r['cpu_seconds']:.1f} | {r['core_hours']:,.0f} |"
        + "".join(f" {r[f'hours_on_{cores}']:,.1f} |" for cores in CORES)
        + f" {r['gigabytes']:,.0f} | {r['price']:,.0f} |"
        for r in rows
    ]


if __name__ == "__main__":
    main(tyro.cli(Config))
