"""What came of clearing bins, as files: JSON with every cycle, and a csv table with a line per bin."""

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from itree_kernels.whole_files import write_whole

from itree_jax.results import write_json_document
from itree_jax.simulate.clear import MISSED, NOTHING, REMOVED, WRONG, ClearedBin

CLEARED_VERSION = 1
COLUMNS: tuple[str, ...] = (
    "bin", "dropped", "removed", "wrong", "missed", "left", "cycles", "collisions", "free_free", "free_hit", "hit_free",
    "hit_hit", "ended",
)  # fmt: skip


def row(number: int, cleared: ClearedBin) -> dict[str, Any]:
    """One bin's numbers. "collisions" are picks on whose way the physics engine found something touched; "free_hit"
    counts, of the grasps checked, those said to be free that touch something in the engine, and so on.
    """
    counts = {
        name: sum(getattr(cycle, name) for cycle in cleared.cycles)
        for name in ("free_free", "free_hit", "hit_free", "hit_hit")
    }
    return {
        "bin": number, "dropped": cleared.dropped, "removed": cleared.count(REMOVED), "wrong": cleared.count(WRONG),
        "missed": cleared.count(MISSED), "left": cleared.left, "cycles": len(cleared.cycles),
        "collisions": cleared.collisions, **counts, "ended": cleared.reason,
    }  # fmt: skip


def total(bins: Sequence[ClearedBin]) -> dict[str, Any]:
    """The sums over all bins; "ended" says how many were emptied."""
    rows = [row(k, cleared) for k, cleared in enumerate(bins)]
    sums = {name: sum(r[name] for r in rows) for name in COLUMNS if name not in ("bin", "ended")}
    emptied = sum(not cleared.left for cleared in bins)
    return {"bin": "all", **sums, "ended": f"{emptied} of {len(bins)} emptied"}


def write_tables(bins: Sequence[ClearedBin], gripper: str, part_names: Sequence[str], folder: Path) -> None:
    """Writes cleared.json and cleared.csv into a folder. Lengths in mm."""
    document = {
        "version": CLEARED_VERSION, "units": {"length": "mm"}, "gripper": gripper, "parts": list(part_names),
        "outcomes": [REMOVED, WRONG, MISSED, NOTHING], "all": total(bins),
        "bins": [{**row(k, cleared), "seed": cleared.seed, "each_cycle": [asdict(c) for c in cleared.cycles]}
                 for k, cleared in enumerate(bins, start=1)],
    }  # fmt: skip
    write_json_document(document, folder / "cleared.json")
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows([*(row(k, cleared) for k, cleared in enumerate(bins, start=1)), total(bins)])
    write_whole(folder / "cleared.csv", text.getvalue())
