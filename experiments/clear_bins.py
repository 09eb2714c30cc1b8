"""Clears simulated bins of bundled parts, one kind after another, and prints what was removed, wrong and in collision.

    python experiments/clear_bins.py [--bins N] [--parts-per-bin N] [--gripper GRIPPER] [--out DIR]

Needs the physics engine (extra `sim`). Writes a folder per part with cleared.json and cleared.csv, and table.md.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from itree_cad.bundled import bundled_part

from itree_jax.cli.runtime import start_jax
from itree_jax.compile import compile_tree
from itree_jax.grasp import grasp_tables, load_gripper
from itree_jax.prepared import prepare_forest
from itree_jax.sensing.sensor_file import load_sensor
from itree_jax.simulate.clear import ClearedBin, clear_bin
from itree_jax.simulate.clear_tables import total, write_tables
from itree_jax.tree.tree_file import load_tree, save_tree

SHOWN = ("dropped", "removed", "wrong", "missed", "left", "cycles", "collisions", "free_free", "free_hit", "hit_free",
         "hit_hit")  # fmt: skip


@dataclass(frozen=True)
class Config:
    """What to clear."""

    out: Path = Path("out/clear_bins")
    parts: tuple[str, ...] = ("ikeuchi-1987", "bracket", "stepped-bushing")
    sensor: str = "bundled:bench"
    gripper: str = "bundled:jaw"
    bins: int = 10  # of each part
    parts_per_bin: int = 8
    seed: int = 0


def main(config: Config) -> None:
    """Writes the tables of every part and `table.md`, and prints the latter."""
    start_jax()
    config.out.mkdir(parents=True, exist_ok=True)
    results = {name: cleared_bins(name, config) for name in config.parts}
    table = markdown(results)
    (config.out / "table.md").write_text(table, encoding="utf-8")
    print(table)


def cleared_bins(name: str, config: Config) -> list[ClearedBin]:
    """The bins of one part. Its tree stays in the output folder; what is done so far is written after each bin."""
    folder = config.out / name
    folder.mkdir(exist_ok=True)
    path = folder / f"{name}.tree"
    if not path.exists():
        save_tree(compile_tree(bundled_part(name), load_sensor(config.sensor)), path)
    tree, gripper = load_tree(path), load_gripper(config.gripper)
    forest, tables = prepare_forest([tree]), grasp_tables([tree], gripper)
    cleared = []
    for k, sequence in enumerate(np.random.SeedSequence(config.seed).spawn(config.bins), start=1):
        seed = int(sequence.generate_state(1)[0])
        cleared.append(clear_bin(forest, gripper, tree.sensor, config.parts_per_bin, seed, tables=tables))
        write_tables(cleared, gripper.name, [name], folder)
        print(f"{name}: bin {k} of {config.bins}, {total(cleared[-1:])['removed']} of {cleared[-1].dropped} removed")
    return cleared


def markdown(results: dict[str, list[ClearedBin]]) -> str:
    """A row per part, and their sum."""
    rows = [(name, total(bins)) for name, bins in results.items()]
    rows.append(("all", total([one for bins in results.values() for one in bins])))
    lines = [f"| part | {' | '.join(SHOWN)} | bins |", "|" + "---|" * (len(SHOWN) + 2)]
    lines += [f"| {name} | {' | '.join(str(sums[column]) for column in SHOWN)} | {sums['ended']} |"
              for name, sums in rows]  # fmt: skip
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main(tyro.cli(Config))
