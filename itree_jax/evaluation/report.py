"""Counts over scenes as rates with their intervals."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

Z_95 = 1.959963984540054  # the 97.5 % quantile of the normal distribution


@dataclass(frozen=True)
class Rate:
    """`count` of `total`, with Wilson's 95 % interval (Wilson 1927). Instances of one scene are not independent, so the
    interval is an optimistic one for recall and precision."""

    count: int
    total: int

    @property
    def fraction(self) -> float | None:
        return self.count / self.total if self.total else None

    @property
    def interval(self) -> tuple[float, float]:
        """Low and high end of the 95 % interval of the fraction; (0, 1) when nothing was counted."""
        return wilson_interval(self.count, self.total)


def wilson_interval(count: int, total: int, z: float = Z_95) -> tuple[float, float]:
    """The fractions f that `count` of `total` n fits: |count - n f| <= z sqrt(n f (1 - f))."""
    if total == 0:
        return 0.0, 1.0
    p, spread = count / total, z * z / total
    centre = (p + spread / 2) / (1 + spread)
    half = z * np.sqrt(p * (1 - p) / total + spread / (4 * total)) / (1 + spread)
    low = 0.0 if count == 0 else centre - half  # exact ends: the formula leaves a rounding error there
    return float(max(0.0, low)), float(1.0 if count == total else min(1.0, centre + half))


@dataclass(frozen=True)
class SceneCounts:
    """What one scene adds to its groups. "5" and "10" are the limits of the MSSD in % of the diameter."""

    estimates: int
    visible: int  # instances visible enough to be asked for
    top: bool  # the answer with the best score is right at 5 %
    found_5: int  # visible instances found
    found_10: int
    right_5: int  # estimates that found an instance, visible or not
    right_10: int
    found_add_s: int  # visible instances found at ADD-S under 10 % of the diameter
    targets: int  # instances that BOP asks for
    found_mssd: tuple[int, ...]  # targets found, per threshold of BOP
    found_mspd: tuple[int, ...]
    rotation: tuple[float, ...] = field(repr=False, default=())  # [rad] of the estimates right at 5 %
    translation: tuple[float, ...] = field(repr=False, default=())  # [mm]
    time: float | None = None  # [s]


@dataclass(frozen=True)
class GroupReport:
    """The scenes of one group."""

    scenes: int
    top_pick: Rate  # scenes whose best-scored answer is right at 5 %
    recall_5: Rate  # of the instances visible by 70 % or more
    recall_10: Rate
    precision_5: Rate  # of the estimates
    precision_10: Rate
    recall_add_s: Rate  # of the same instances as recall_5, ADD-S under 10 % of the diameter
    ar_mssd: float | None  # average recall over BOP's ten thresholds, of instances visible by 10 % or more
    ar_mspd: float | None
    rotation: float | None  # median over the estimates right at 5 % [rad]
    translation: float | None  # [mm]
    time: float | None  # median over the scenes [s]

    def to_json(self) -> dict[str, Any]:
        """Rates in percent with count, total and 95 % interval; degrees, mm, s."""
        out: dict[str, Any] = {"scenes": self.scenes}
        for name in RATES:
            rate: Rate = getattr(self, name)
            low, high = rate.interval
            out[name] = {"percent": _percent(rate.fraction), "count": rate.count, "total": rate.total,
                         "low": _percent(low), "high": _percent(high)}  # fmt: skip
        out |= {"ar_mssd": _percent(self.ar_mssd), "ar_mspd": _percent(self.ar_mspd)}
        rot_deg = None if self.rotation is None else float(np.degrees(self.rotation))
        return out | {"rot_deg": rot_deg, "trans_mm": self.translation, "time_s": self.time}


RATES = ("top_pick", "recall_5", "recall_10", "precision_5", "precision_10", "recall_add_s")


@dataclass(frozen=True)
class Report:
    """Everything that `evaluate` found out; groups "all", and "level ..", "part .." when scenes.json tells them."""

    groups: dict[str, GroupReport]
    ignored_rows: int  # rows of the csv for images that the data set does not score

    def to_json(self) -> dict[str, Any]:
        return {"ignored_rows": self.ignored_rows, "groups": {k: g.to_json() for k, g in self.groups.items()}}

    def rows(self) -> list[list[str]]:
        """The report as a table of text, the heads first; intervals only for the group "all"."""
        heads = ["group", "scenes", *(name.replace("_", " ") + " %" for name in RATES), "AR MSSD %", "AR MSPD %",
                 "rot deg", "trans mm", "time s"]  # fmt: skip
        return [heads, *(_row(name, group) for name, group in self.groups.items())]


def summarise(scenes: Sequence[SceneCounts]) -> GroupReport:
    """Sums over the scenes of a group."""

    def total(name: str) -> int:
        return sum(int(getattr(s, name)) for s in scenes)

    estimates, visible, targets = total("estimates"), total("visible"), total("targets")
    return GroupReport(
        scenes=len(scenes),
        top_pick=Rate(total("top"), len(scenes)),
        recall_5=Rate(total("found_5"), visible),
        recall_10=Rate(total("found_10"), visible),
        precision_5=Rate(total("right_5"), estimates),
        precision_10=Rate(total("right_10"), estimates),
        recall_add_s=Rate(total("found_add_s"), visible),
        ar_mssd=_average_recall([s.found_mssd for s in scenes], targets),
        ar_mspd=_average_recall([s.found_mspd for s in scenes], targets),
        rotation=_median([x for s in scenes for x in s.rotation]),
        translation=_median([x for s in scenes for x in s.translation]),
        time=_median([s.time for s in scenes if s.time is not None and s.time >= 0]),
    )


def _average_recall(found: Sequence[tuple[int, ...]], targets: int) -> float | None:
    return float(np.mean(np.sum(found, axis=0) / targets)) if targets else None


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if len(values) else None


def _percent(fraction: float | None) -> float | None:
    return None if fraction is None else 100 * fraction


def _row(name: str, group: GroupReport) -> list[str]:
    def cell(value: float | None, digits: int) -> str:
        return "-" if value is None else f"{value:.{digits}f}"

    rates = [cell(_percent(getattr(group, rate).fraction), 1) for rate in RATES]
    if name == "all":
        ends = [getattr(group, rate).interval for rate in RATES]
        rates = [f"{text} ({100 * low:.0f}-{100 * high:.0f})" for text, (low, high) in zip(rates, ends, strict=True)]
    degrees = None if group.rotation is None else float(np.degrees(group.rotation))
    rest = [cell(_percent(group.ar_mssd), 1), cell(_percent(group.ar_mspd), 1), cell(degrees, 3),
            cell(group.translation, 3), cell(group.time, 2)]  # fmt: skip
    return [name, str(group.scenes), *rates, *rest]
