"""Scenes a second of `recognize` against how many of them a call is given: 1, 2, 4, 8 and 16.

    python experiments/benchmarks/batches.py [--out out/batches] [--sizes N ...] [--scenes N] [--tree TREE] [--parts N]

Simulated bins (extra `sim`) of the bench sensor, 640 x 480 px with a depth map. Without --tree the paper's part is
compiled, once; the tree stays in the folder. Every size recognises all scenes, in turns, after a pass that warms up;
medians, by the clock and by the processors' time. Answers must be the same whatever the size; the command fails
otherwise. Writes `batches.json` and `batches.png` (extra `figures`), prints a table.
"""

import json
import os
import platform
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import median

import numpy as np
import tyro
from itree_cad.bundled import bundled_part

from itree_jax.cli.runtime import start_jax
from itree_jax.compile import compile_tree
from itree_jax.detections import Detections
from itree_jax.prepared import PreparedForest, prepare_forest
from itree_jax.recognition import recognize
from itree_jax.results import results_document
from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.scene_folder import Scene
from itree_jax.simulate import bin_for, image_bin, settle
from itree_jax.tree.tree import InterpretationTree
from itree_jax.tree.tree_file import load_tree, save_tree

PART = "ikeuchi-1987"


@dataclass(frozen=True)
class Config:
    out: Path = Path("out/batches")
    sizes: tuple[int, ...] = (1, 2, 4, 8, 16)
    scenes: int = 16
    parts: int = 10  # dropped into each bin
    tree: Path | None = None  # compiled for the bundled sensor "bench"
    draws: int = 200  # of a tree that is compiled here
    repeats: int = 3
    seed: int = 0


@dataclass(frozen=True)
class Row:
    """One size of the batch."""

    size: int
    seconds: float  # per scene
    cpu_seconds: float  # of all cores
    scenes_per_second: float
    faster: float  # times as many scenes a second as the first size, median of the turns
    same: bool  # answers as those of the first size, to the bit


def main(config: Config) -> int:
    start_jax()
    config.out.mkdir(parents=True, exist_ok=True)
    tree = load_tree(config.tree) if config.tree else compiled_once(config)
    scenes = bins(tree, config)
    rows = measured(prepare_forest([tree]), scenes, config)
    machine = {"processor": platform.machine(), "cores": os.cpu_count()}
    given = {k: str(v) for k, v in asdict(config).items() if k not in ("out", "tree")}  # no paths of a machine
    said = {"machine": machine, "config": given, "rows": [asdict(row) for row in rows]}
    (config.out / "batches.json").write_text(json.dumps(said, indent=1) + "\n")
    print(as_table(rows))
    draw(rows, config.out / "batches.png")
    return 0 if all(row.same for row in rows) else 1


def compiled_once(config: Config) -> InterpretationTree:
    path = config.out / f"{PART}-{config.draws}.tree"
    if not path.is_file():
        save_tree(compile_tree(bundled_part(PART), bundled_sensor("bench"), draws=config.draws), path)
    return load_tree(path)


def bins(tree: InterpretationTree, config: Config) -> list[Scene]:
    """Distinct scenes of the tree's part; the same seed gives the same."""
    sensor = tree.sensor
    bin_ = bin_for(sensor, tree.part.diameter)
    seeds = np.random.SeedSequence(config.seed).generate_state(config.scenes).tolist()
    return [
        image_bin(tree.part, settle(tree.part, config.parts, bin_, seed), bin_, sensor, seed=seed)[0] for seed in seeds
    ]


def measured(forest: PreparedForest, scenes: Sequence[Scene], config: Config) -> list[Row]:
    """All sizes in turns; the turn of the warm-up is not counted."""
    clock: dict[int, list[float]] = {size: [] for size in config.sizes}
    cpu: dict[int, list[float]] = {size: [] for size in config.sizes}
    answers = {}
    for turn in range(1 + config.repeats):
        for size in config.sizes if turn else config.sizes[-1:]:
            start, cpu_start = time.perf_counter(), time.process_time()
            found = in_batches(forest, scenes, size)
            if turn:
                clock[size].append((time.perf_counter() - start) / len(scenes))
                cpu[size].append((time.process_time() - cpu_start) / len(scenes))
                answers[size] = results_document([replace(one, time=-1.0) for one in found])
    first = config.sizes[0]
    return [
        Row(
            size, median(clock[size]), median(cpu[size]), 1.0 / median(clock[size]),
            median(a / b for a, b in zip(clock[first], clock[size], strict=True)), answers[size] == answers[first],
        )
        for size in config.sizes
    ]  # fmt: skip


def in_batches(forest: PreparedForest, scenes: Sequence[Scene], size: int) -> list[Detections]:
    """So many scenes a call."""
    found: list[Detections] = []
    for first in range(0, len(scenes), size):
        some = scenes[first : first + size]
        images, depth = np.stack([s.images for s in some]), np.stack([s.depth for s in some if s.depth is not None])
        answers = recognize(forest, images, some[0].sensor, depth, some[0].R_w2c)
        found += answers if isinstance(answers, list) else [answers]
    return [replace(one, scene_id=k) for k, one in enumerate(found)]


def as_table(rows: Sequence[Row]) -> str:
    lines = [
        f"| scenes a call | scenes per s | s per scene | CPU s | times the rate of {rows[0].size} | same answers |",
        "|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {r.size} | {r.scenes_per_second:.2f} | {r.seconds:.2f} | {r.cpu_seconds:.2f} | {r.faster:.2f} | "
        f"{'yes' if r.same else 'NO'} |"
        for r in rows
    ]
    return "\n".join(lines)


def draw(rows: Sequence[Row], path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.2, 3.0), layout="constrained")
    axes = figure.subplots()
    sizes = [r.size for r in rows]
    axes.plot(sizes, [r.scenes_per_second for r in rows], "o-", color="#0072b2", label="by the clock")
    axes.plot(sizes, [1.0 / r.cpu_seconds for r in rows], "s--", color="#d55e00", label="per second of a core")
    axes.set(xlabel="scenes a call", ylabel="scenes per second", xscale="log", ylim=(0, None))
    axes.set_xticks(sizes, [f"{size}" for size in sizes])
    axes.xaxis.minorticks_off()
    axes.grid(color="#dddddd")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    raise SystemExit(main(tyro.cli(Config)))
