"""Our csv and the peers' against the same truth: a table per level, and the cases where a peer wins.

    PYTHONPATH=experiments python -m peers.compare itree=ours.csv ppf=out/peers/ppf.csv fpfh=out/peers/fpfh.csv
        [--dataset DATASET] [--reasons ours.json] [--out DIR]

The first csv is ours. Beside each csv may lie a JSON file of the same name with `preparation_s` (per object) and
`scene_cpu_s` (per scene), as the peers and `peers.ours` write it. Runs in the environment of itree-jax.
"""

import argparse
import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from itree_jax.evaluation import GroupReport, Rate, evaluate
from peers.wins import Case, peer_wins, why

HEADS = ("", "method", "scenes", "top pick", "recall", "precision", "rotation", "position", "s per scene", "CPU s",
         "CPU s per model")  # fmt: skip


@dataclass(frozen=True)
class Config:
    results: dict[str, Path]  # the first is ours
    dataset: Path = Path(os.environ.get("ITREE_DATA", Path(__file__).parents[3] / "shared" / "data")) / "scenes"
    reasons: Path | None = None
    out: Path = Path("out/peers")


def main(config: Config) -> None:
    """Writes `comparison.md` and prints it."""
    ours, *others = config.results
    reports = {name: evaluate(config.dataset, path).groups for name, path in config.results.items()}
    costs = {name: cost_of(path) for name, path in config.results.items()}
    peers = {name: config.results[name] for name in others}
    cases = peer_wins(config.dataset, config.results[ours], peers, config.reasons)
    text = "\n".join([comparison(reports, costs), ratios(ours, costs), wins_table(cases)])
    config.out.mkdir(parents=True, exist_ok=True)
    (config.out / "comparison.md").write_text(text)
    print(text)


def cost_of(csv: Path) -> tuple[float | None, float | None]:
    """Median CPU seconds per scene and of the preparation of a model, where a JSON file beside the csv tells them."""
    path = csv.with_suffix(".json")
    told = json.loads(path.read_text()) if path.is_file() else {}
    scenes, models = (list(told.get(key, {}).values()) for key in ("scene_cpu_s", "preparation_s"))
    return (float(np.median(scenes)) if scenes else None, float(np.median(models)) if models else None)


def comparison(
    reports: Mapping[str, Mapping[str, GroupReport]], costs: Mapping[str, tuple[float | None, float | None]]
) -> str:
    """One markdown table: "all" and each level, a row per method. CPU seconds are medians over all scenes."""
    lines = ["| " + " | ".join(HEADS) + " |", "|---" * len(HEADS) + "|"]
    first = next(iter(reports.values()))
    for group in (name for name in first if re.fullmatch(r"all|level \w+", name)):
        for method, groups in reports.items():
            told = costs.get(method, (None, None)) if group == "all" else (None, None)
            lines.append(row(group, method, groups[group], told))
    return "\n".join(lines) + "\n"


def ratios(ours: str, costs: Mapping[str, tuple[float | None, float | None]]) -> str:
    """How many times our CPU seconds a scene each peer takes."""
    own = costs[ours][0]
    peers = {name: scene for name, (scene, _) in costs.items() if name != ours and scene is not None}
    return "".join(
        f"{name}: {scene / own:.2f} times the CPU seconds of {ours}\n" for name, scene in peers.items() if own
    )


def row(name: str, method: str, group: GroupReport, cost: tuple[float | None, float | None]) -> str:
    rates = [as_percent(rate) for rate in (group.top_pick, group.recall_5, group.precision_5)]
    degrees = None if group.rotation is None else float(np.degrees(group.rotation))
    numbers = (degrees, "{:.3f} deg"), (group.translation, "{:.3f} mm"), (group.time, "{:.1f}"), (cost[0], "{:.1f}"), (
        cost[1], "{:.1f}")  # fmt: skip
    cells = [name, method, str(group.scenes), *rates, *("-" if x is None else form.format(x) for x, form in numbers)]
    return "| " + " | ".join(cells) + " |"


def as_percent(rate: Rate) -> str:
    if rate.fraction is None:
        return "-"
    low, high = rate.interval
    return f"{100 * rate.fraction:.0f} % ({100 * low:.0f}-{100 * high:.0f})"


def wins_table(cases: Sequence[Case]) -> str:
    """The peers' wins as a markdown table, the most visible first."""
    heads = ("scene", "level", "object", "instance", "visible", "right", "ours")
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for c in sorted(cases, key=lambda c: -c.visible):
        cells = (c.scene, c.level, c.obj_id, c.instance, f"{100 * c.visible:.0f} %", ", ".join(c.right), why(c))
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return "\n".join(lines) + "\n"


def named(word: str) -> tuple[str, Path]:
    name, found, path = word.partition("=")
    if not found:
        raise argparse.ArgumentTypeError(f"NAME=CSV is expected, not {word!r}")
    return name, Path(path)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=named, nargs="+", metavar="NAME=CSV")
    parser.add_argument("--dataset", type=Path, default=Config.dataset)
    parser.add_argument("--reasons", type=Path, default=None)
    parser.add_argument("--out", type=Path, default=Config.out)
    words = parser.parse_args()
    main(Config(dict(words.results), words.dataset, words.reasons, words.out))
