"""Many scenes in one process: whether memory stays flat, nothing is compiled again, and answers stay the same.

    python experiments/soak.py [--scenes 1000] [--distinct 20] [--out DIR]

Bins of two of the paper's part at 240 x 180 px with a depth map; so many distinct ones are recognised in turn, shuffled
anew in every round. The first round is the warm-up. Every answer is held against that of the warm-up by a digest of all
that is written of it, so that "same" is equality to the bit. Some scenes are recognised again in fresh processes, on
one thread, on two, and in batches. Prints tables, and writes them with `report.json` into DIR.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

PART, PARTS, SCALE = "ikeuchi-1987", 2, 0.375  # of the bench camera's sides: 240 x 180 px
ROWS = 10  # of the table of memory
PAGE = os.sysconf("SC_PAGE_SIZE")  # [bytes]


@dataclass(frozen=True)
class Config:
    scenes: int = 1000
    distinct: int = 20
    again: int = 5  # scenes that fresh processes recognise
    draws: int = 50  # of the tree
    seed: int = 0
    out: Path = Path("out/soak")


@dataclass(frozen=True)
class Way:
    """How a fresh process recognises scenes."""

    name: str
    threads: int = 2
    batch: int = 0  # scenes of a call; 0: each alone


WAYS = (
    Way("fresh process"), Way("fresh process, one thread", threads=1), Way("fresh process, batches of 2", batch=2),
    Way("fresh process, one thread, batches of 5", threads=1, batch=5),
)  # fmt: skip


@dataclass(frozen=True)
class Checkpoint:
    """After so many scenes."""

    scenes: int
    memory_mb: float  # resident
    traced: int  # since the row before
    compiled: int
    loaded: int
    differing: int  # answers that are not those of the warm-up
    cpu_s: float  # per scene, of all threads


def main(config: Config) -> int:
    config.out.mkdir(parents=True, exist_ok=True)
    tree = config.out / "part.tree"
    if not tree.is_file():
        compile_once(tree, config)
    digests, rows = soaked(config, tree)
    table = memory_table(rows)
    print(table, flush=True)
    same = {way.name: fresh(k, config, tree, digests) for k, way in enumerate(WAYS)}
    table += "\n" + ways_table(same, config.again)
    print(ways_table(same, config.again))
    report = {"config": asdict(config) | {"out": str(config.out)}, "rows": [asdict(r) for r in rows], "same": same}
    (config.out / "report.json").write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    (config.out / "table.md").write_text(table, encoding="utf-8")
    steady = rows[1:]
    good = not any(r.traced + r.compiled + r.loaded + r.differing for r in steady)
    return 0 if good and all(count == config.again for count in same.values()) else 1


def compile_once(path: Path, config: Config) -> None:
    from itree_cad.bundled import bundled_part

    from itree_jax.compile import compile_tree
    from itree_jax.tree.tree_file import save_tree

    save_tree(compile_tree(bundled_part(PART), small_sensor(), draws=config.draws), path)


def small_sensor():
    from degrading.imaging import scaled

    from itree_jax.sensing.bundled import bundled_sensor

    return scaled(bundled_sensor("bench"), SCALE)


def bins(count: int, seed: int, parts: int = PARTS) -> list:
    """Distinct simulated scenes; the same seed gives the same."""
    from itree_cad.bundled import bundled_part

    from itree_jax.simulate import bin_for, image_bin, settle

    part, sensor = bundled_part(PART), small_sensor()
    bin_ = bin_for(sensor, part.diameter)
    seeds = np.random.SeedSequence(seed).generate_state(count).tolist()
    return [image_bin(part, settle(part, parts, bin_, one), bin_, sensor, seed=one)[0] for one in seeds]


def soaked(config: Config, tree: Path) -> tuple[list[str], list[Checkpoint]]:
    """Digests of the warm-up, and a row for it and for every tenth of the run."""
    from soaking.compilations import Compilations, counted
    from soaking.digest import digest

    from itree_jax.prepared import prepare, prepare_forest
    from itree_jax.recognition import recognize_one
    from itree_jax.tree.tree_file import load_tree

    scenes, rng = bins(config.distinct, config.seed), np.random.default_rng(config.seed)
    forest = prepare_forest([prepare(load_tree(tree))])
    digests: list[str] = [""] * len(scenes)
    rows: list[Checkpoint] = []
    every = max(1, (config.scenes - config.distinct) // ROWS)
    done = differing = last = 0
    began = time.process_time()
    with counted() as count:
        before = Compilations()
        while done < config.scenes:
            order = rng.permutation(len(scenes)) if done else np.arange(len(scenes))
            for k in order[: config.scenes - done].tolist():
                s = scenes[k]
                found = digest(recognize_one(forest, s.images, s.sensor, s.depth, s.R_w2c))
                differing += found != digests[k] if digests[k] else 0
                digests[k] = digests[k] or found
                done += 1
                if done == config.distinct or (done > config.distinct and (done - config.distinct) % every == 0):
                    spent = (time.process_time() - began) / (done - last)
                    rows.append(Checkpoint(
                        done, memory_mb(), count.traced - before.traced, count.compiled - before.compiled,
                        count.loaded - before.loaded, differing, round(spent, 2),
                    ))  # fmt: skip
                    print(rows[-1], file=sys.stderr, flush=True)
                    before, last, differing, began = replace(count), done, 0, time.process_time()
    return digests, rows


def memory_mb() -> float:
    """What the process has resident [MB]."""
    return round(int(Path("/proc/self/statm").read_text().split()[1]) * PAGE / 1e6, 1)


def fresh(k: int, config: Config, tree: Path, digests: Sequence[str]) -> int:
    """Of how many scenes a fresh process gives the same."""
    task = json.dumps([k, str(tree), config.again, config.seed, config.distinct])
    done = subprocess.run([sys.executable, __file__, "--task", task], capture_output=True, text=True, check=True)
    found = json.loads(done.stdout.splitlines()[-1])
    return sum(a == b for a, b in zip(found, digests, strict=False))


def answer(k: int, tree: str, again: int, seed: int, distinct: int) -> list[str]:
    """Digests of the first scenes, under `WAYS[k]`."""
    way = WAYS[k]
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: way.threads])
    os.cpu_count = lambda: way.threads
    from soaking.digest import digest

    from itree_jax.prepared import prepare, prepare_forest
    from itree_jax.recognition import recognize
    from itree_jax.tree.tree_file import load_tree

    forest, scenes = prepare_forest([prepare(load_tree(tree))]), bins(distinct, seed)[:again]
    size = way.batch or 1
    found: list[Any] = []
    for first in range(0, again, size):
        some = scenes[first : first + size]
        images, depth = np.stack([s.images for s in some]), np.stack([s.depth for s in some])
        if way.batch:
            found += recognize(forest, images, some[0].sensor, depth, some[0].R_w2c)
        else:
            found.append(recognize(forest, images[0], some[0].sensor, depth[0], some[0].R_w2c))
    return [digest(one) for one in found]


def memory_table(rows: Sequence[Checkpoint]) -> str:
    lines = [
        "| scenes | resident MB | traced by JAX | compiled | loaded by Warp | other answers | CPU s per scene |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {r.scenes}{' (warm-up)' if k == 0 else ''} | {r.memory_mb:.0f} | {r.traced} | {r.compiled} | {r.loaded} "
        f"| {r.differing} | {r.cpu_s:.2f} |"
        for k, r in enumerate(rows)
    ]
    return "\n".join(lines) + "\n"


def ways_table(same: dict[str, int], count: int) -> str:
    lines = ["| recognised again | same to the bit |", "|---|---|"]
    return "\n".join([*lines, *(f"| {name} | {n} of {count} |" for name, n in same.items())]) + "\n"


if __name__ == "__main__":
    if sys.argv[1:2] == ["--task"]:
        print(json.dumps(answer(*json.loads(sys.argv[2]))))
        sys.exit()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in asdict(Config()).items():
        parser.add_argument(f"--{name}", type=type(default) if name != "out" else Path, default=default)
    sys.exit(main(Config(**vars(parser.parse_args()))))
