"""Edges, boundaries and regions against truth: how many get the right label, how pure and complete regions are.

    python experiments/seeing_edges_regions.py [--dataset DATASET] [--bins N] [--parts N] [--out DIR]

Simulated bins (extra `sim`) are what choices are made by; the data set, which another program rendered, is only
reported. It defaults to `scenes` in the folder that ITREE_DATA names and is left out where it is not there.

Purity: share of the pixels of regions that belong to the region's main part, over regions whose main part is a part.
Completeness: share of a part's detectable pixels in the largest region of which it is the main part; mean over parts.
Reach: of the directions from a region's mass centre in which its boundary has a label, the share in which the part's
surface within the slant limit, lit or not, goes on beyond it: there d(theta) is but a lower bound.
"Truth" is what regions would be if every part's detectable pixels were cut out by their true instance.
"""

import argparse
import json
import os
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from itree_cad.bundled import BUNDLED_PARTS
from seeing_truth import Seen, data_set, kind_at, simulated

from itree_jax.sensing.boundaries import REACH, Boundary, BoundaryLabel, boundary_labels
from itree_jax.sensing.edges import EdgeLabel, SceneEdges, scene_edges
from itree_jax.sensing.lit import lit_by_any
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.photometric import needle_map
from itree_jax.sensing.region_cuts import Cuts
from itree_jax.sensing.regions import Regions, regions
from itree_jax.sensing.slant_limit import detectable

KINDS = ("outline", "crease", "shadow")
DIRECTIONS = 64  # as d(theta) has
GOES_ON = 2.5  # [px]: by more than the pixels that edges make uninterpretable
SMALLEST_PART = 240  # [px], 60 mm^2 at the bench: a part that shows less has no region to be complete
NOTHING = Cuts(outline=False, concave=False, geometric=False)
CUTS = {
    "no edges": NOTHING,
    "outlines": replace(NOTHING, outline=True),
    "grooves": replace(NOTHING, concave=True),
    "outlines and grooves": replace(NOTHING, outline=True, concave=True),
    "outlines, geometric": replace(NOTHING, outline=True, geometric=True),
    "all of them": Cuts(),
}


@dataclass(frozen=True)
class Config:
    dataset: Path = Path(os.environ.get("ITREE_DATA", Path(__file__).parents[2] / "shared" / "data")) / "scenes"
    out: Path = Path("out/seeing_edges_regions")
    parts: tuple[str, ...] = BUNDLED_PARTS
    parts_per_bin: int = 9
    bins: int = 1  # of each part
    seed: int = 0


def main(config: Config) -> None:
    """Writes `report.json` and `table.md` into `config.out`, and prints the tables."""
    config.out.mkdir(parents=True, exist_ok=True)
    counts: dict[str, Any] = {"edges": defaultdict(_table), "boundaries": defaultdict(_wide)}
    counts |= {"reach": defaultdict(_reach), "regions": {}, "times": {}}
    for seen in scenes(config):
        measure(seen, counts)
    report = {
        "config": {k: str(v) for k, v in asdict(config).items()},
        "edges": {k: v.tolist() for k, v in counts["edges"].items()},
        "boundaries": {k: v.tolist() for k, v in counts["boundaries"].items()},
        "reach": {k: v.tolist() for k, v in counts["reach"].items()},
        "regions": {k: summed(v) for k, v in counts["regions"].items()},
        "seconds": {k: float(np.median(v)) for k, v in counts["times"].items()},
    }
    (config.out / "report.json").write_text(json.dumps(report, indent=1) + "\n")
    text = as_markdown(report)
    (config.out / "table.md").write_text(text)
    print(text)


def scenes(config: Config) -> Iterator[Seen]:
    made = simulated(config.parts, config.parts_per_bin, config.bins, config.seed)
    return chain(made, data_set(config.dataset)) if config.dataset.is_dir() else made


def measure(seen: Seen, counts: dict[str, Any]) -> None:
    """Adds one image to the counts."""
    needle = NeedleMap(*(np.asarray(a) for a in needle_map(seen.images, seen.sensor)))
    mask = detectable(needle, seen.sensor)
    lit = lit_by_any(seen.images, seen.sensor, needle)
    add_regions(counts, f"{seen.group} | - | truth", true_regions(mask, seen.instance), mask, seen)
    for known, depth in (("with depth", seen.depth), ("without depth", None)):
        start = time.perf_counter()
        edges = scene_edges(seen.images, seen.sensor, needle, depth)
        counts["times"].setdefault(f"scene_edges {known}", []).append(time.perf_counter() - start)
        counts["edges"][f"{seen.group} | {known}"] += edge_confusion(edges, seen)
        for name, cuts in CUTS.items():
            start = time.perf_counter()
            labels = regions(needle, depth, seen.sensor, edges=edges, cuts=cuts, lit=lit).labels
            counts["times"].setdefault(f"regions {known}, {name}", []).append(time.perf_counter() - start)
            add_regions(counts, f"{seen.group} | {known} | {name}", labels, mask, seen)
        found = regions(needle, depth, seen.sensor, edges=edges, lit=lit)
        start = time.perf_counter()
        boundary = boundary_labels(found, edges, seen.sensor)
        counts["times"].setdefault("boundary_labels", []).append(time.perf_counter() - start)
        counts["reach"][f"{seen.group} | {known}"] += reach(found, boundary, seen)
        kind, _ = kind_at(seen.kinds, boundary.pixel[:, ::-1].astype(float), REACH)
        on_part = seen.instance[tuple(boundary.pixel.T)] < seen.parts
        np.add.at(counts["boundaries"][f"{seen.group} | {known}"], (kind[on_part], boundary.label[on_part]), 1)


def edge_confusion(edges: SceneEdges, seen: Seen) -> np.ndarray:
    """Points on parts, by true kind and label; those near two kinds of edges are left out."""
    kind, alone = kind_at(seen.kinds, edges.uv)
    column, row = np.round(edges.uv).astype(int).T
    use = alone & (kind >= 0) & (seen.instance[row, column] < seen.parts)
    table = _table()
    np.add.at(table, (kind[use], edges.label[use]), 1)
    return table


def _table() -> np.ndarray:
    return np.zeros((len(KINDS), len(EdgeLabel)), int)


def _wide() -> np.ndarray:
    return np.zeros((len(KINDS) + 1, len(BoundaryLabel)), int)  # last row: no true edge there


def _reach() -> np.ndarray:
    return np.zeros((len(BoundaryLabel), 2), int)  # directions, and those in which the surface goes on


def reach(found: Regions, boundary: Boundary, seen: Seen) -> np.ndarray:
    """By label of the boundary: directions of regions of parts, and in how many the part's surface goes on."""
    table = _reach()
    for region in range(found.count):
        own = found.mask(region)
        part = np.bincount(seen.instance[own]).argmax()
        if part == seen.parts:
            continue
        surface = cv2.connectedComponents((seen.facing & (seen.instance == part)).astype(np.uint8), connectivity=8)[1]
        there = np.bincount(surface[own & (surface > 0)], minlength=1)
        if there.sum() == 0:
            continue
        edge = boundary.of(region)
        direction, distance = polar(edge.pixel, found.centroid_uv[region])
        true_direction, true_distance = polar(np.argwhere(surface == there.argmax()), found.centroid_uv[region])
        farthest = np.zeros(DIRECTIONS)
        np.maximum.at(farthest, true_direction, true_distance)
        for k in np.unique(direction):
            mine = np.flatnonzero(direction == k)
            last = mine[distance[mine].argmax()]
            table[edge.label[last]] += (1, farthest[k] > distance[last] + GOES_ON)
    return table


def polar(pixel: np.ndarray, centre_uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which of the directions pixels (row, column) lie in, and how far from the centre [px]."""
    x, y = pixel[:, 1] - centre_uv[0], pixel[:, 0] - centre_uv[1]
    turn = np.arctan2(y, x) / (2.0 * np.pi)
    return np.floor(turn * DIRECTIONS).astype(int) % DIRECTIONS, np.hypot(x, y)


def true_regions(mask: np.ndarray, instance: np.ndarray) -> np.ndarray:
    labels, count = np.full(mask.shape, -1), 0
    for part in np.unique(instance[mask]):
        found, pieces = cv2.connectedComponents((mask & (instance == part)).astype(np.uint8), connectivity=8)
        labels[pieces > 0] = pieces[pieces > 0] - 1 + count
        count += found - 1
    return labels


def add_regions(counts: dict[str, Any], key: str, labels: np.ndarray, mask: np.ndarray, seen: Seen) -> None:
    inside = labels >= 0
    pixels = np.zeros((labels.max(initial=-1) + 1, seen.parts + 1), int)
    np.add.at(pixels, (labels[inside], seen.instance[inside]), 1)
    pixels = pixels[pixels.sum(axis=1) >= SMALLEST_PART]
    main_part = pixels.argmax(axis=1)
    of_part = main_part < seen.parts
    total, own = pixels.sum(axis=1)[of_part], pixels.max(axis=1, initial=0)[of_part]
    shown = np.bincount(seen.instance[mask], minlength=seen.parts + 1)[: seen.parts]
    best = np.zeros(seen.parts)
    np.maximum.at(best, main_part[of_part], own)
    complete = (best / np.maximum(shown, 1))[shown >= SMALLEST_PART]
    counts["regions"].setdefault(key, []).append((total, own, complete))


def summed(rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> dict[str, float]:
    total, own, complete = (np.concatenate(column) for column in zip(*rows, strict=True))
    return {
        "regions": len(total),
        "purity": float(own.sum() / max(total.sum(), 1)),
        "pure_regions": float((own >= 0.95 * total).mean()) if len(total) else 0.0,
        "completeness": float(complete.mean()) if len(complete) else 0.0,
    }


def as_markdown(report: dict[str, Any]) -> str:
    lines = ["| edges on parts | true kind | points | " + " | ".join(n.name.lower() for n in EdgeLabel) + " |"]
    lines += confusion_rows(report["edges"], KINDS, len(EdgeLabel))
    lines += ["", "| boundary pixels on parts | true kind | pixels | "
              + " | ".join(n.name.lower() for n in BoundaryLabel) + " |"]  # fmt: skip
    lines += confusion_rows(report["boundaries"], (*KINDS, "none"), len(BoundaryLabel))
    lines += ["", "| d(theta) ends at | directions | surface goes on |", "|---|---|---|"]
    for key, table in sorted(report["reach"].items()):
        lines += [f"| {key.replace(' | ', ', ')}, {BoundaryLabel(k).name.lower()} | {n} | {100 * on / n:.0f} % |"
                  for k, (n, on) in enumerate(table) if n]  # fmt: skip
    lines += ["", "| regions | cut by | regions of parts | purity | pure by 95 % | completeness |", "|" + "---|" * 6]
    for key, row in sorted(report["regions"].items(), key=lambda item: item[0].split(" | ")[:2]):
        group, known, name = key.split(" | ")
        shares = " | ".join(f"{100 * row[k]:.1f} %" for k in ("purity", "pure_regions", "completeness"))
        lines.append(f"| {group}, {known} | {name} | {row['regions']} | {shares} |")
    lines += ["", "| median seconds per image | |", "|---|---|"]
    lines += [f"| {name} | {seconds:.3f} |" for name, seconds in report["seconds"].items()]
    return "\n".join(lines) + "\n"


def confusion_rows(tables: dict[str, list[list[int]]], kinds: Iterable[str], labels: int) -> list[str]:
    rows = ["|" + "---|" * (labels + 3)]
    for key, table in sorted(tables.items()):
        for kind, row in zip(kinds, table, strict=True):
            total = max(sum(row), 1)
            rows.append(f"| {key.replace(' | ', ', ')} | {kind} | {sum(row)} | "
                        + " | ".join(f"{100 * n / total:.0f} %" for n in row) + " |")  # fmt: skip
    return rows


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dataset", type=Path, default=Config.dataset)
    parser.add_argument("--out", type=Path, default=Config.out)
    parser.add_argument("--bins", type=int, default=Config.bins)
    parser.add_argument("--parts-per-bin", type=int, default=Config.parts_per_bin)
    parser.add_argument("--seed", type=int, default=Config.seed)
    main(replace(Config(), **vars(parser.parse_args())))
