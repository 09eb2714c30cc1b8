"""What weighed windows come to: sums over each window, the part of it that is not empty, and what was found since."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from itree_jax.refinement.likelihood import Support


class Explained(NamedTuple):
    """What a hypothesis explains: of its window what isn't empty and lies in the image."""

    rows: slice  # of the image, every so many
    columns: slice
    nats: Float[np.ndarray, "rows columns"]  # how well; 0: not at all
    hidden: Bool[np.ndarray, "rows columns"]  # by something nearer
    pixels: int  # that are explained
    whole: float  # the sum of their nats


@dataclass(eq=False)
class Found:
    """What selections have found of one hypothesis: the next one, in other company, need not look again."""

    ratios: dict["Found", float] = field(default_factory=dict)  # log-likelihood ratio to another one [nats]
    shares_space: dict["Found", bool] = field(default_factory=dict)  # with another one
    explains: Explained | None = None
    told: Float[np.ndarray, "rows columns"] | None = None  # what isn't empty of its window, with pixels at steps [nats]

    def keeps(self, other: "Found") -> bool:
        """Which of two keeps what was found of both: none keep each other, so that they go with their scene."""
        return id(self) <= id(other)


class Totals(NamedTuple):
    """Of each window of a `Support`. They stay what they are in whatever company a pose is judged."""

    spoken_for: Float[np.ndarray, "h"]  # nats of the pixels that speak for the pose
    spoken_against: Float[np.ndarray, "h"]  # nats of those that contradict it
    agreeing: Int[np.ndarray, "h"]  # pixels that speak for the pose
    hidden: Int[np.ndarray, "h"]  # pixels behind something nearer
    box: Int[np.ndarray, "h 4"]  # first and end row, first and end column of what isn't empty
    found: Shaped[np.ndarray, "h"]  # of `Found`

    def take(self, index: Int[np.ndarray, "kept"]) -> "Totals":
        return Totals(*(values[index] for values in self))

    def joined(self, other: "Totals") -> "Totals":
        """Both lists, one after the other."""
        return Totals(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))


def totals(support: Support) -> Totals:
    """The sums of all windows, one window after the other: it stays in the cache meanwhile."""
    windows = [
        (
            np.maximum(pixels, 0.0).sum(), -np.minimum(pixels, 0.0).sum(), np.count_nonzero(pixels > 0),
            np.count_nonzero(hidden), box(support, h), Found(),
        )
        for h, (pixels, hidden) in enumerate(zip(support.pixels, support.hidden, strict=True))
    ]  # fmt: skip
    if not windows:
        none = np.zeros(0, np.float32)
        return Totals(none, none, np.zeros(0, int), np.zeros(0, int), np.zeros((0, 4), int), np.zeros(0, object))
    return Totals(*(np.array(values) for values in zip(*windows, strict=True)))


def box(support: Support, h: int) -> tuple[int, int, int, int]:
    """Rows and columns of a window between which all of it lies that isn't empty."""
    there = (support.pixels[h] != 0) | (support.at_steps[h] != 0) | support.hidden[h]
    rows, columns = np.flatnonzero(there.any(axis=1)), np.flatnonzero(there.any(axis=0))
    return (int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1) if len(rows) else (0, 0, 0, 0)
