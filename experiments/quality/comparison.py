"""Configurations side by side on one data set, and the figures of one group that all score tables show."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from itree_jax.evaluation import evaluate

LEVELS = ("all", "level A", "level B", "level C")
RATES = ("top_pick", "recall_5", "precision_5")
MEDIANS = (("rot_deg", "{:.3f} deg"), ("trans_mm", "{:.3f} mm"), ("time_s", "{:.1f}"))
HEADS = ("top pick", "recall", "precision", "rotation", "position", "s per scene")


def score_cells(group: Mapping[str, Any]) -> list[str]:
    """Top pick, recall and precision with their 95 % intervals, median rotation, position and time of a group (one of
    `Report.to_json()["groups"]`); a dash for what is not known."""
    rates = [
        f"{group[c]['percent']:.0f} % ({group[c]['low']:.0f}-{group[c]['high']:.0f})" if group[c]["total"] else "-"
        for c in RATES
    ]
    return rates + ["-" if group[key] is None else form.format(group[key]) for key, form in MEDIANS]


def group_table(groups: Mapping[str, Any], shown: str = r"all|level \w+|part .+|level \w+, bin|lights \d+") -> str:
    """A row for each group of one configuration whose name matches `shown`."""
    rows = [[name, str(g["scenes"]), *score_cells(g)] for name, g in groups.items() if re.fullmatch(shown, name)]
    return markdown_table(["", "scenes", *HEADS], rows)


def comparison_table(groups_of: Mapping[str, Mapping[str, Any]], levels: Sequence[str] = LEVELS) -> str:
    """A row for each configuration, level after level; levels that no configuration has are left out.

    Args:
        groups_of: of each configuration's name, `Report.to_json()["groups"]`.
    """
    rows = [
        [level, name, str(groups[level]["scenes"]), *score_cells(groups[level])]
        for level in levels for name, groups in groups_of.items() if level in groups
    ]  # fmt: skip
    return markdown_table(["level", "configuration", "scenes", *HEADS], rows)


def compare_configurations(
    dataset: str | Path, csv_of: Mapping[str, str | Path], levels: Sequence[str] = LEVELS
) -> str:
    """`comparison_table` of results files on one data set. Raises ItreeError as `evaluate` does."""
    return comparison_table({name: evaluate(dataset, csv).to_json()["groups"] for name, csv in csv_of.items()}, levels)


def markdown_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)]) + "\n"
