"""Seconds to recognise a scene: the first answer of a fresh process, and warm, stage by stage; beside peers if told.

    python experiments/benchmarks/recognition.py --trees TREE [TREE ...] --scenes FOLDER [FOLDER ...] [--peers CSV ...]
        [--depth file|stereo|none]

A process is fresh but for what earlier ones left in the caches of JAX and Warp. Warm: the median over `repeats` of
every scene, by the clock and by the processors' time, which says more on a machine that does other things too. A
stage's time is without that of the stages it calls, in runs of their own that leave no two stages at once. Peers' csv
files (`peers.recognise`) give their seconds by the clock for the same scenes, the JSON files beside them those of the
processors; each is held against ours of its kind. Prints a table and writes recognition.json.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any, Literal, NamedTuple
from unittest.mock import patch

import tyro

from itree_jax import challenge, competition, interpreting, narrowing, own_axis, reading_order, recognition, settling
from itree_jax.cli.runtime import start_jax
from itree_jax.cli.scene_answer import with_depth_from
from itree_jax.detections import Detections
from itree_jax.prepared import PreparedForest, prepare_forest
from itree_jax.results import read_bop_csv
from itree_jax.sensing.scene_folder import Scene, load_scene
from itree_jax.stereo.second_camera import SecondCamera
from itree_jax.tree.tree_file import load_tree

STAGES: dict[str, tuple[tuple[Any, str], ...]] = {
    "needles, regions, edges": ((recognition, "lit_part"), (recognition, "look")),
    "reflected light": ((recognition, "subtract_reflections"),),
    "features of regions": ((reading_order, "measure_regions"),),
    "tree": ((reading_order, "ask_root"), (interpreting, "in_batches")),
    "placing": ((interpreting, "every_attitude"), (interpreting, "placed_by_segment"), (challenge, "shown_at")),
    "refinement": ((narrowing, "refine"), (settling, "refine")),
    "verification": ((narrowing, "verify"), (challenge, "verify")),
    "likelihood": ((narrowing, "support"), (own_axis, "support")),
    "selection": (
        (competition, "select"), (reading_order, "compete"), (recognition, "compete"), (settling, "compete"),
    ),
    "what is left over": ((recognition, "left_over"),),
    "deviations, paths": ((recognition, "detections_of"),),
}
KINDS = {"wall_s": "s by the clock", "cpu_s": "s of the processors"}


@dataclass(frozen=True)
class Config:
    """What to measure."""

    trees: tuple[Path, ...]
    scenes: tuple[Path, ...]
    peers: tuple[Path, ...] = ()
    out: Path = Path("out/recognition")
    repeats: int = 3
    fresh: bool = True  # also start a process of its own
    depth: Literal["file", "stereo", "none"] = "file"  # where depth comes from


class Seen(NamedTuple):
    """A scene, with its depth map or without, and what its second camera saw if depth comes from there."""

    scene: Scene
    second: SecondCamera | None


@dataclass
class Clock:
    """Own seconds of each stage; of nested ones the inner has its time."""

    wall: dict[str, float] = field(default_factory=dict)
    cpu: dict[str, float] = field(default_factory=dict)
    inner: list[list[float]] = field(default_factory=list)

    def timed(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **named: Any) -> Any:
            self.inner.append([0.0, 0.0])
            start = time.perf_counter(), time.process_time()
            try:
                return function(*args, **named)
            finally:
                took = time.perf_counter() - start[0], time.process_time() - start[1]
                wall, cpu = self.inner.pop()
                self.wall[name] = self.wall.get(name, 0.0) + took[0] - wall
                self.cpu[name] = self.cpu.get(name, 0.0) + took[1] - cpu
                if self.inner:
                    self.inner[-1][0] += took[0]
                    self.inner[-1][1] += took[1]

        return call


@contextmanager
def stages_timed(clock: Clock) -> Iterator[None]:
    """The functions of every stage report to the clock, and no two at once."""
    with ExitStack() as stack:
        stack.enter_context(patch.object(settling, "on_all_cores", lambda step, answers: [step(a) for a in answers]))
        for name, functions in STAGES.items():
            for module, function in functions:
                stack.enter_context(patch.object(module, function, clock.timed(name, getattr(module, function))))
        yield


def main(config: Config) -> None:
    start_jax()
    fresh = seconds_of_fresh_process(config) if config.fresh else None
    forest = prepare_forest([load_tree(path) for path in config.trees])
    sensor = forest.trees[0].tree.sensor
    seen = [Seen(*with_depth_from(config.depth, load_scene(folder), sensor)) for folder in config.scenes]
    rows = [measured(forest, one, config.repeats) for one in seen]
    peers = {path.stem: peers_seconds(path) for path in config.peers}
    result = {"cores": os.cpu_count(), "fresh_process_s": fresh, "scenes": rows, "peers_s": peers}
    config.out.mkdir(parents=True, exist_ok=True)
    (config.out / "recognition.json").write_text(json.dumps(result, indent=1) + "\n")
    print(table(result))


def measured(forest: PreparedForest, scene: Seen, repeats: int) -> dict[str, Any]:
    """Medians of one scene after a call that warms up."""
    whole = [whole_scene(forest, scene) for _ in range(repeats + 1)][1:]
    clocks = []
    for _ in range(repeats):
        clocks.append(Clock())
        with stages_timed(clocks[-1]):
            found = recognised(forest, scene)
    picks = [first_pick(forest, scene) for _ in range(repeats + 1)][1:]
    return {
        "scene": scene.scene.scene_id, "found": len(found.detections),
        "pick_wall_s": median(wall for wall, _ in picks), "pick_cpu_s": median(cpu for _, cpu in picks),
        "wall_s": median(wall for wall, _ in whole), "cpu_s": median(cpu for _, cpu in whole),
        "stages_cpu_s": {name: median(clock.cpu.get(name, 0.0) for clock in clocks) for name in STAGES},
    }  # fmt: skip


def recognised(forest: PreparedForest, seen: Seen, picks: int | None = None) -> Detections:
    scene, second = seen
    return recognition.recognize_one(forest, scene.images, scene.sensor, scene.depth, scene.R_w2c, second, picks)


def whole_scene(forest: PreparedForest, scene: Seen) -> tuple[float, float]:
    """Seconds of all of a scene: by the clock, of the processors."""
    start = time.perf_counter(), time.process_time()
    recognised(forest, scene)
    return time.perf_counter() - start[0], time.process_time() - start[1]


def first_pick(forest: PreparedForest, scene: Seen) -> tuple[float, float]:
    """Seconds until one pose is sure, the highest regions first: by the clock, of the processors."""
    start = time.perf_counter(), time.process_time()
    recognised(forest, scene, picks=1)
    return time.perf_counter() - start[0], time.process_time() - start[1]


def seconds_of_fresh_process(config: Config) -> float:
    """From starting Python to the poses of the first scene on disk."""
    words = ["recognize", config.scenes[0], *config.trees, "-o", config.out / "fresh.csv", "--depth", config.depth]
    config.out.mkdir(parents=True, exist_ok=True)
    start = time.perf_counter()
    program = "import sys; from itree_jax.cli.main import main; sys.exit(main(sys.argv[1:]))"
    subprocess.run([sys.executable, "-c", program, *map(str, words)], check=True, capture_output=True)
    return time.perf_counter() - start


def peers_seconds(path: Path) -> dict[str, dict[int, float]]:
    """What a peer took for each scene: by the clock as its csv states it, of the processors by the JSON beside it."""
    results = read_bop_csv(path)
    clock = {k: s for k, s in zip(results.scene_id.tolist(), results.time.tolist(), strict=True) if s >= 0}
    beside = path.with_suffix(".json")
    told = json.loads(beside.read_text())["scene_cpu_s"] if beside.is_file() else {}
    return {"wall_s": clock, "cpu_s": {int(scene): s for scene, s in told.items()}}


def peer_line(name: str, kind: str, seconds: dict[int, float], rows: list[dict[str, Any]]) -> str:
    """Against ours of the same kind, on the scenes that both have done."""
    both = [row for row in rows if row["scene"] in seconds]
    if not both:
        return f"{name}: no {KINDS[kind]} of these scenes"
    ratio = median(seconds[row["scene"]] / row[kind] for row in both)
    theirs = median(seconds[row["scene"]] for row in both)
    return f"{name}: {theirs:.2f} {KINDS[kind]} on {len(both)} scenes, {ratio:.1f} times as long"


def table(result: dict[str, Any]) -> str:
    rows = result["scenes"]
    wall, cpu, found = (median(row[name] for row in rows) for name in ("wall_s", "cpu_s", "found"))
    lines = [
        f"{len(rows)} scenes, {result['cores']} cores; medians: {wall:.2f} s by the clock, {cpu:.2f} s of the "
        f"processors, {found:.0f} parts",
    ]
    if result["fresh_process_s"] is not None:
        lines.append(f"fresh process, first answer: {result['fresh_process_s']:.1f} s")
    first = [median(row[name] for row in rows) for name in ("pick_wall_s", "pick_cpu_s")]
    lines.append(f"first pick: {first[0]:.2f} s by the clock, {first[1]:.2f} s of the processors")
    lines += ["", "| stage | CPU s | share |", "|---|---|---|"]
    spent = {name: median(row["stages_cpu_s"][name] for row in rows) for name in STAGES}
    spent["everything else"] = max(0.0, cpu - sum(spent.values()))
    lines += [f"| {name} | {s:.3f} | {100 * s / cpu:.0f} % |" for name, s in spent.items()]
    lines += [
        "\n" + peer_line(name, kind, seconds, rows)
        for name, kinds in result["peers_s"].items() for kind, seconds in kinds.items()
    ]  # fmt: skip
    return "\n".join(lines)


if __name__ == "__main__":
    main(tyro.cli(Config))
