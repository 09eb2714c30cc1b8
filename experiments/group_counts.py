"""Attitude groups of the bundled parts against the frequency of the dome: how many labels, groups and leaves.

    python experiments/group_counts.py [--frequencies 1 2 3 4] [--sensor bundled:ikeuchi-1987] [--out DIR]

Labels are counted before they are merged; a group per label is what the paper's method would give on a finer dome.
"""

import argparse
import json
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from itree_cad.bundled import BUNDLED_PARTS, bundled_part
from itree_cad.revolution import rings
from itree_cad.symmetry import symmetries
from itree_kernels.mesh import ray_mesh

from itree_jax.sensing.sensor_file import load_sensor
from itree_jax.sensor import Sensor
from itree_jax.tree.groups import attitude_groups


@dataclass(frozen=True)
class Config:
    out: Path = Path("out/group_counts")
    parts: tuple[str, ...] = BUNDLED_PARTS
    frequencies: tuple[int, ...] = (1, 2, 3, 4)
    sensor: str = "bundled:ikeuchi-1987"


@dataclass(frozen=True)
class Row:
    part: str
    frequency: int
    views: int
    labels: int  # that differ, before any merging
    labels_of_one_view: int
    groups: int
    groups_of_one_view: int
    leaves: int  # groups that aren't pruned
    moved: float  # share of the views whose group has another label, beyond symmetry
    seconds: float


def main(config: Config) -> list[Row]:
    """Writes `table.md` and `counts.json` into `config.out`, and prints the table."""
    config.out.mkdir(parents=True, exist_ok=True)
    sensor = load_sensor(config.sensor)
    rows = [count(name, f, sensor) for name in config.parts for f in config.frequencies]
    table = as_markdown(rows)
    counts = {"config": asdict(config) | {"out": str(config.out)}, "rows": [asdict(row) for row in rows]}
    (config.out / "counts.json").write_text(json.dumps(counts, indent=1) + "\n")
    (config.out / "table.md").write_text(table + "\n")
    print(table)
    return rows


def count(name: str, frequency: int, sensor: Sensor) -> Row:
    part = bundled_part(name)
    symmetry = symmetries(part)
    part = rings(part, symmetry)
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle)
    start = time.perf_counter()
    groups = attitude_groups(mesh, part, sensor, frequency, symmetry=symmetry)
    seconds = time.perf_counter() - start
    views_of_label = np.unique(groups.labels, axis=0, return_counts=True)[1]
    return Row(
        part=name,
        frequency=frequency,
        views=len(groups.directions),
        labels=len(views_of_label),
        labels_of_one_view=int((views_of_label == 1).sum()),
        groups=groups.group_count,
        groups_of_one_view=int((groups.view_count == 1).sum()),
        leaves=int((~groups.pruned).sum()),
        moved=float((groups.membership < 1.0).mean()),
        seconds=seconds,
    )


def as_markdown(rows: list[Row]) -> str:
    lines = [
        "| part | f | views | labels | of one view | groups | of one view | leaves | views that moved | s |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {r.part} | {r.frequency} | {r.views} | {r.labels} | {r.labels_of_one_view} | {r.groups} | "
        f"{r.groups_of_one_view} | {r.leaves} | {100.0 * r.moved:.1f} % | {r.seconds:.1f} |"
        for r in rows
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frequencies", type=int, nargs="+", default=list(Config.frequencies))
    parser.add_argument("--sensor", default=Config.sensor)
    parser.add_argument("--out", type=Path, default=Config.out)
    given = parser.parse_args()
    main(Config(out=given.out, frequencies=tuple(given.frequencies), sensor=given.sensor))
