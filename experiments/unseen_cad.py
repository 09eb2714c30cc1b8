"""Every CAD file of a folder compiled, or refused with the reason that a user would read.

    python experiments/unseen_cad.py [--folder DIR] [--sensor SENSOR] [--draws N] [--out DIR]

The folder defaults to `cad` in the one that ITREE_DATA names. An assembly is compiled solid by solid; a mesh file that
is refused as it is (a mesh says no unit) is tried again in inches and metres. Prints a table of groups, rules, expected
error, time and ambiguities.
"""

import argparse
import json
import os
import re
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from itree_cad.load import MESH_SUFFIXES, load_part
from itree_kernels.errors import ItreeError

from itree_jax.compile import DRAWS, compile_tree
from itree_jax.sensing.sensor_file import load_sensor
from itree_jax.tree.describe import ambiguities
from itree_jax.tree.tree import PRUNED, InterpretationTree

OTHER_UNITS = ("in", "m")


@dataclass(frozen=True)
class Config:
    folder: Path = Path(os.environ.get("ITREE_DATA", Path(__file__).parents[2] / "shared" / "data")) / "cad"
    sensor: str = "bundled:bench"
    draws: int = DRAWS
    out: Path = Path("out/unseen_cad")


def main(config: Config) -> None:
    config.out.mkdir(parents=True, exist_ok=True)
    rows = [row for path in sorted(config.folder.iterdir()) if path.is_file() for row in rows_of_file(path, config)]
    (config.out / "report.json").write_text(
        json.dumps({"config": {k: str(v) for k, v in asdict(config).items()}, "rows": rows}, indent=1) + "\n"
    )
    table = as_markdown(rows)
    (config.out / "table.md").write_text(table)
    print(table)


def rows_of_file(path: Path, config: Config) -> Iterator[dict[str, Any]]:
    """The file as it is; its solids one by one; a mesh that was refused again in other units."""
    solids = solids_of(path)
    for solid in solids or [None]:
        row = compiled(path, None, solid, config)
        yield row
        if row["refused"] and path.suffix.lower() in MESH_SUFFIXES:
            yield from (compiled(path, unit, solid, config) for unit in OTHER_UNITS)


def solids_of(path: Path) -> list[str]:
    """Names of the solids of an assembly; none for a single part."""
    try:
        load_part(path)
    except ItreeError as error:
        return re.findall(r"\d+: ([^()]+) \(", str(error)) if "assembly" in str(error) else []
    return []


def compiled(path: Path, unit: str | None, solid: str | None, config: Config) -> dict[str, Any]:
    """One row of the table."""
    row: dict[str, Any] = {"file": path.name, "solid": solid or "", "units": unit or "as it is"}
    start = time.perf_counter()
    try:
        tree = compile_tree(load_part(path, unit, solid), load_sensor(config.sensor), draws=config.draws)
    except ItreeError as error:
        return {**row, "refused": str(error)}
    return {**row, "refused": "", "seconds": time.perf_counter() - start, **facts(tree)}


def facts(tree: InterpretationTree) -> dict[str, Any]:
    """What the table tells of a tree."""
    kept = ~tree.groups.pruned
    steps = Counter(" ".join(tree.determination.steps[g]) or "-" for g in np.flatnonzero(kept))
    found = ambiguities(tree)
    return {
        "diameter_mm": tree.part.diameter, "triangles": len(tree.part.triangles), "faces": tree.part.face_count,
        "symmetries": len(tree.symmetries.discrete) - 1, "axes": len(tree.symmetries.continuous),
        "groups": tree.groups.group_count, "leaves": int(kept.sum()),
        "rules": dict(Counter(rule for rule in tree.nodes.rule if rule != PRUNED)), "steps": dict(steps),
        "expected_error": {
            "whole": float(tree.confusion.expected_error[0]), "cut": float(tree.confusion.expected_error[1])
        },
        "pairs_not_told": sum(a["kind"] == "groups" for a in found),
        "rotations_open": sum(a["kind"] == "rotation" for a in found),
    }  # fmt: skip


def as_markdown(rows: list[dict[str, Any]]) -> str:
    heads = ("file", "units", "diameter", "triangles", "symmetry", "groups (leaves)", "rules at the nodes",
             "expected error, whole / cut", "pairs not told", "rotations open", "s")  # fmt: skip
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for row in rows:
        name = row["file"] + (f", {row['solid']}" if row["solid"] else "")
        if row["refused"]:
            lines.append(f"| {name} | {row['units']} | refused: {row['refused']} |" + " |" * (len(heads) - 3))
            continue
        rules = ", ".join(f"{count} x {rule}" for rule, count in sorted(row["rules"].items())) or "-"
        symmetry = "axis" if row["axes"] else f"{row['symmetries']} turns" if row["symmetries"] else "none"
        whole, cut = (100.0 * row["expected_error"][kind] for kind in ("whole", "cut"))
        cells = (
            name, row["units"], f"{row['diameter_mm']:.1f} mm", str(row["triangles"]), symmetry,
            f"{row['groups']} ({row['leaves']})", rules, f"{whole:.0f} % / {cut:.0f} %", str(row["pairs_not_told"]),
            str(row["rotations_open"]), f"{row['seconds']:.0f}",
        )  # fmt: skip
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=Config.folder)
    parser.add_argument("--sensor", default=Config.sensor)
    parser.add_argument("--draws", type=int, default=Config.draws)
    parser.add_argument("--out", type=Path, default=Config.out)
    main(Config(**vars(parser.parse_args())))
