"""How time and memory grow with the number of parts: forests of 1, 5, 20 and 100 parts on the same mixed bins.

    python experiments/forest_growth.py [--cache DIR] [--sizes N ...] [--scenes N] [--runs N] [--out FILE]

The parts (`forest_parts.py`) are compiled with few draws, once; the trees stay in the cache, and in the place of a part
that can't be compiled for the sensor stands the next one. The bins hold the five bundled parts, one each, dropped by
the physics engine (extra `sim`), so that forests of five parts and more know all that lies there. Memory is what the
trees' arrays take, and what the process holds after the scenes. Forests up to the size `--exhaustive` are also measured
without their root (all regions, all parts): that is what N trees one after another cost. A picture lies beside FILE
(extra `figures`).
"""

import argparse
import json
import resource
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from forest_parts import forest_part, part_names
from itree_cad.bundled import BUNDLED_PARTS
from itree_kernels.errors import ItreeError

from itree_jax.compile import compile_tree
from itree_jax.detections import Detections
from itree_jax.evaluation.matching import match
from itree_jax.evaluation.pose_errors import Pose, mssd
from itree_jax.evaluation.symmetry import symmetry_set
from itree_jax.prepared import Prepared, PreparedForest, prepare
from itree_jax.recognition import recognize_one
from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.scene_folder import Scene
from itree_jax.sensing.scene_writer import TrueObject
from itree_jax.sensor import Sensor
from itree_jax.simulate.bin import bin_for
from itree_jax.simulate.dataset import model_info
from itree_jax.simulate.imaging import image_mixed_bin
from itree_jax.simulate.settle import settle_mixed
from itree_jax.tree.forest import compile_forest
from itree_jax.tree.packing import Arrays, pack
from itree_jax.tree.tree import InterpretationTree
from itree_jax.tree.tree_file import load_tree, save_tree

VISIBLE = 0.7  # parts that recall counts
RIGHT = 0.05  # MSSD, of the diameter
MOST_TRIED = 3  # times as many parts as are asked for


@dataclass(frozen=True)
class Config:
    out: Path = Path("out/forest_growth.json")
    cache: Path = Path("out/forest_trees")
    sizes: tuple[int, ...] = (1, 5, 20, 100)
    exhaustive: int = 5  # largest forest that is also asked without its root
    scenes: int = 3
    runs: int = 3  # of every scene, after one that compiles
    draws: int = 16
    seed: int = 0


@dataclass(frozen=True)
class Row:
    """One forest on all scenes."""

    parts: int
    root: bool
    rule: str
    root_error: float
    root_seconds: float  # to build it
    regions: float  # per scene
    pairs: float  # (region, part) that were interpreted, per scene
    seconds: float  # per scene, median
    cpu_seconds: float  # of all cores, per scene, median: what other programs on the machine change less
    in_bin: int  # parts of the forest visible by 70 %
    found: int  # of these
    answers: int
    right: int
    tree_mb: float  # of the arrays of all trees
    resident_mb: float  # of the process, after the scenes


def main(config: Config) -> None:
    """Writes `config.out` and a picture beside it, prints the table."""
    sensor = bundled_sensor("bench")
    files = compiled(sensor, config)
    prepared: list[Prepared] = []
    scenes = [mixed_bin(sensor, config.seed + k) for k in range(config.scenes)]
    rows = []
    for size in sorted(config.sizes):
        prepared += [prepare(load_tree(path)) for path in files[len(prepared) : size]]
        start = time.perf_counter()
        root = compile_forest([p.tree for p in prepared[:size]]).root
        forest = PreparedForest(tuple(prepared[:size]), root)
        rows.append(measure(forest, True, time.perf_counter() - start, scenes, config.runs))
        print(as_table(rows[-1:], head=len(rows) == 1), flush=True)
        if 1 < size <= config.exhaustive:
            everything = replace(forest, root=replace(root, behind=np.inf))
            rows.append(measure(everything, False, 0.0, scenes, config.runs))
            print(as_table(rows[-1:], head=False), flush=True)
    config.out.parent.mkdir(parents=True, exist_ok=True)
    told = {k: str(v) for k, v in asdict(config).items() if k not in ("out", "cache")}
    said = {"config": told, "rows": [asdict(row) for row in rows]}
    config.out.write_text(json.dumps(said | {"ratios": ratios(rows)}, indent=1) + "\n")
    draw([row for row in rows if row.root], config.out.with_suffix(".png"))
    print("\n" + as_table(rows, head=True) + "\n\n" + "\n".join(ratio_line(r) for r in ratios(rows)))


def compiled(sensor: Sensor, config: Config) -> list[Path]:
    """The trees of as many parts as the largest forest holds, compiled where the cache has none."""
    files: list[Path] = []
    asked = max(config.sizes)
    config.cache.mkdir(parents=True, exist_ok=True)
    for number, name in enumerate(islice(part_names(), MOST_TRIED * asked), start=1):
        if len(files) == asked:
            break
        path = config.cache / f"{name.replace(':', '_')}.tree"
        if not path.exists():
            try:
                tree = compile_tree(forest_part(name), sensor, obj_id=number, draws=config.draws)
            except ItreeError as error:
                print(f"{name} is left out: {error}", flush=True)
                continue
            save_tree(tree, path)
            print(f"{name}: compiled", flush=True)
        files.append(path)
    if len(files) < asked:
        raise SystemExit(f"{len(files)} of {MOST_TRIED * asked} parts can be compiled for this sensor, not {asked}")
    return files


def megabytes(tree: InterpretationTree) -> float:
    """Of all its arrays."""
    arrays: Arrays = {}
    pack(tree, arrays)
    return sum(array.nbytes for array in arrays.values()) / 1e6


def resident_mb() -> float:
    """Memory that the process holds now (Linux)."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


def mixed_bin(sensor: Sensor, seed: int) -> tuple[Scene, tuple[TrueObject, ...]]:
    """The bundled parts, one each, as they fell."""
    parts = [forest_part(name) for name in BUNDLED_PARTS]
    order = np.random.default_rng(seed).permutation(len(parts))
    bin_ = bin_for(sensor, max(part.diameter for part in parts))
    T_bin_obj, kept = settle_mixed([parts[k] for k in order], bin_, seed)
    kinds = [(part, k + 1) for k, part in enumerate(parts)]
    return image_mixed_bin(kinds, order[kept], T_bin_obj, bin_, sensor, seed=seed)


def measure(
    forest: PreparedForest, root: bool, root_seconds: float, scenes: Sequence[tuple[Scene, tuple[TrueObject, ...]]],
    runs: int,
) -> Row:
    """Recognises all scenes, several times each."""
    seconds, cpu, pairs, regions, counts = [], [], [], [], np.zeros(4, int)
    for scene, truth in scenes:
        found, used = [], []
        for _ in range(runs + 1):
            before = time.process_time()
            found.append(recognize_one(forest, scene.images, scene.sensor, scene.depth, scene.R_w2c))
            used.append(time.process_time() - before)
        seconds.append(float(np.median([one.time for one in found[1:]])))
        cpu.append(float(np.median(used[1:])))
        last = found[-1]
        assert last.labels is not None
        regions.append(int(last.labels.max()) + 1)
        pairs.append(last.interpretations)
        counts += count_right(last, truth, forest.trees)
    said = forest.root
    return Row(
        len(forest.trees), root, said.rule if root else "-", said.error, root_seconds, float(np.mean(regions)),
        float(np.mean(pairs)), float(np.median(seconds)), float(np.median(cpu)), *(int(c) for c in counts),
        sum(megabytes(one.tree) for one in forest.trees), resident_mb(),
    )  # fmt: skip


def count_right(
    found: Detections, truth: Sequence[TrueObject], trees: Sequence[Prepared]
) -> tuple[int, int, int, int]:
    """Visible parts of the forest, those found, answers, right answers (of any part that is there)."""
    of = {p.tree.obj_id: p.tree.part for p in trees}
    known = [t for t in truth if t.obj_id in of]
    error = np.full((len(found), len(known)), np.inf)
    for obj_id, part in of.items():
        symmetries, hull = symmetry_set(model_info(part)), part.vertices
        for i, d in enumerate(found):
            for j, t in enumerate(known):
                if d.obj_id == t.obj_id == obj_id:
                    pose, true = Pose(d.R_cam_obj, d.t_cam_obj), Pose(t.R_cam_obj, t.t_cam_obj)
                    error[i, j] = float(mssd(pose, true, hull, symmetries)) / part.diameter
    matched = match(error, found.poses.score, RIGHT)
    visible = [j for j, t in enumerate(known) if t.visib_fract >= VISIBLE]
    return len(visible), sum(j in matched for j in visible), len(found), int((matched >= 0).sum())


def as_table(rows: Sequence[Row], head: bool) -> str:
    lines = [
        "| parts | root | its error | regions | pairs | s per scene | CPU s | recall | right answers | trees MB | "
        "process MB |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ] if head else []  # fmt: skip
    for r in rows:
        root = r.rule if r.root else "not asked"
        lines.append(
            f"| {r.parts} | {root} | {100 * r.root_error:.0f} % | {r.regions:.1f} | {r.pairs:.1f} | {r.seconds:.1f} | "
            f"{r.cpu_seconds:.1f} | {r.found}/{r.in_bin} | {r.right}/{r.answers} | {r.tree_mb:.0f} | "
            f"{r.resident_mb:.0f} |"
        )
    return "\n".join(lines)


def ratios(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Of each forest to every smaller one."""
    told = [r for r in rows if r.root]
    return [
        {"from": a.parts, "to": b.parts, "parts": b.parts / a.parts, "pairs": b.pairs / a.pairs,
         "seconds": b.seconds / a.seconds, "cpu_seconds": b.cpu_seconds / a.cpu_seconds}
        for first, b in enumerate(told[1:]) for a in told[: first + 1]
    ]  # fmt: skip


def ratio_line(r: dict[str, Any]) -> str:
    more = f"{r['parts']:.1f} times the parts: {r['pairs']:.2f} times the pairs, {r['cpu_seconds']:.2f} times the work"
    return f"{r['from']} -> {r['to']}: {more}"


def draw(rows: Sequence[Row], path: Path) -> None:
    """Processor seconds of a scene to the left, memory to the right, over the number of parts."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.4, 3.4), layout="constrained")
    seconds = figure.subplots()
    memory = seconds.twinx()
    parts = [r.parts for r in rows]
    lines = [
        *seconds.plot(parts, [r.cpu_seconds for r in rows], "o-", color="#0072b2", label="CPU s per scene"),
        *memory.plot(parts, [r.resident_mb for r in rows], "s-", color="#d55e00", label="memory of the process"),
        *memory.plot(parts, [r.tree_mb for r in rows], "s:", color="#d55e00", label="arrays of the trees"),
    ]
    seconds.set(xlabel="parts in the forest", xscale="log", ylim=(0, None))
    seconds.set_xticks(parts, [f"{n}" for n in parts])
    seconds.xaxis.minorticks_off()
    seconds.grid(color="#dddddd")
    seconds.set_ylabel("CPU seconds", color="#0072b2")
    memory.set_ylabel("MB", color="#d55e00")
    memory.set_ylim(0, None)
    figure.legend(handles=lines, loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Config.out)
    parser.add_argument("--cache", type=Path, default=Config.cache)
    parser.add_argument("--sizes", type=int, nargs="+", default=Config.sizes)
    parser.add_argument("--exhaustive", type=int, default=Config.exhaustive)
    parser.add_argument("--scenes", type=int, default=Config.scenes)
    parser.add_argument("--runs", type=int, default=Config.runs)
    parser.add_argument("--draws", type=int, default=Config.draws)
    parser.add_argument("--seed", type=int, default=Config.seed)
    given = vars(parser.parse_args())
    main(replace(Config(), **given | {"sizes": tuple(given["sizes"])}))
