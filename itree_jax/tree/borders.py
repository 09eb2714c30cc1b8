"""Borders of attitude groups: which labels make a group, and which group a label at a border belongs to.

The paper's groups are the labels of 60 views. On a finer dome, or on noisy draws, faces whose detectable area is close
to the sensor's smallest region make labels that differ in such a digit without showing anything else. A label is no
group of its own when all its views can be taken for a larger group's, with digits changed only where they are
uncertain; nor when it fills less than a cell of the dome of frequency 1, which is as small as a group of the paper can
be. Its views join the label that costs least to reach: the sum, over the digits that differ, of |log(area / smallest
region)|.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from itree_jax.sensor import Sensor
from itree_jax.tree.concavity import STEEP
from itree_jax.tree.dome import TRIANGLES_PER_FREQUENCY_1
from itree_jax.tree.same_label import digit_margin, disagreement, group_by_label

STEEPEST = np.radians(60.0)  # a face seen more obliquely has next to no area, whatever slant the sensor allows


def uncertain_band(sensor: Sensor, frequency: int, pitch: float) -> float:
    """|log(area / smallest region)| up to which a digit is uncertain (see the module's text).

    Two things change the area [mm^2] of a region of the smallest size, independently of each other:

    - the rim: noise and mixed pixels take or give half a pixel around it, which is sqrt(pi pitch^2 / area) of a round
      one;
    - the direction: a view stands for a cell of the dome, whose points are sqrt(2 / 60) / frequency [rad] (root mean
      square, of a disc of the cell's solid angle) from its middle; cos(slant) changes by its tangent times that, with
      the sensor's slant limit as the steepest slant.

    With the paper's setting these are 11 % and 16 %, together 20 % on the dome of frequency 1; its part is known to
    keep its groups for smallest regions of 60 to 80 mm^2, which is 14 % to either side of their mean.

    Args:
        pitch: size of a pixel [mm].
    """
    rim = np.sqrt(np.pi * pitch**2 / sensor.smallest_region)
    cell = np.sqrt(2.0 / TRIANGLES_PER_FREQUENCY_1) / frequency
    return float(np.hypot(rim, np.tan(min(sensor.slant_limit, STEEPEST)) * cell))


def labels_of_groups(
    digit_area: Float[np.ndarray, "views digits"],
    same_digits: Int[np.ndarray, "symmetries digits"],
    smallest: float,
    blocking: Float[np.ndarray, "digits"],
    band: float,
    least_views: int,
) -> Bool[np.ndarray, "groups digits"]:
    """The labels that make groups, as falling binary numbers.

    Args:
        digit_area: detectable area of the digits' faces [mm^2].
        same_digits: see `digit_permutations`.
        smallest: the sensor's smallest region [mm^2].
        blocking: share of its own light that each face blocks.
        band: see `uncertain_band`.
        least_views: views of a cell of the dome of frequency 1.
    """
    labels, own = group_by_label(digit_area > smallest, same_digits)
    untold = untold_labels(labels, blocking)
    cost = label_costs(digit_area, labels, same_digits, smallest, untold, untold[own])
    different = surely_different(digit_area, labels, same_digits, smallest, band)
    return labels[standing_labels(cost, different, least_views)]


def nearest_label(
    digit_area: Float[np.ndarray, "n digits"],
    group_labels: Bool[np.ndarray, "groups digits"],
    same_digits: Int[np.ndarray, "symmetries digits"],
    smallest: float,
    blocking: Float[np.ndarray, "digits"],
) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Index of the label that costs least, and the membership that is left, exp(-cost)."""
    untold = untold_labels(group_labels, blocking)
    untold_view = untold_labels(digit_area > smallest, blocking)
    cost = label_costs(digit_area, group_labels, same_digits, smallest, untold, untold_view)
    group = cost.argmin(axis=1).astype(np.int32)
    return group, np.exp(-cost[np.arange(len(cost)), group])


def untold_labels(
    labels: Bool[np.ndarray, "n digits"], blocking: Float[np.ndarray, "digits"]
) -> Bool[np.ndarray, "n"]:
    """Labels of nothing, or of steep concave faces alone: their groups are pruned."""
    return np.logical_not(np.any(labels[:, blocking < STEEP], axis=1))


def label_costs(
    digit_area: Float[np.ndarray, "views digits"],
    labels: Bool[np.ndarray, "groups digits"],
    same_digits: Int[np.ndarray, "symmetries digits"],
    smallest: float,
    pruned: Bool[np.ndarray, "groups"],
    pruned_view: Bool[np.ndarray, "views"],
) -> Float[np.ndarray, "views groups"]:
    """What it costs each view to take each label: 0 for the label that it has.

    A view that shows something that can be told does not join a label that is pruned (infinite cost) while there is
    another: it would be lost to recognition.

    Args:
        digit_area: detectable area of the digits' faces [mm^2].
        smallest: the sensor's smallest region [mm^2].
        pruned, pruned_view: labels, and views whose own label, show nothing that can be told.
    """
    cost = disagreement(digit_area > smallest, digit_margin(digit_area, smallest), labels, same_digits)
    if pruned.all():
        return cost
    return np.where(pruned[None, :] & ~pruned_view[:, None], np.inf, cost)


def surely_different(
    digit_area: Float[np.ndarray, "views digits"],
    labels: Bool[np.ndarray, "groups digits"],
    same_digits: Int[np.ndarray, "symmetries digits"],
    smallest: float,
    band: float,
) -> Bool[np.ndarray, "views groups"]:
    """Whether a digit outside the band of uncertainty differs."""
    certain = (digit_margin(digit_area, smallest) > band).astype(float)
    return disagreement(digit_area > smallest, certain, labels, same_digits) > 0.0


def standing_labels(
    cost: Float[np.ndarray, "views labels"], different: Bool[np.ndarray, "views labels"], least_views: int
) -> Bool[np.ndarray, "labels"]:
    """Which labels make a group; every view belongs to the one of them that costs it least.

    The smallest label that need not stand goes first and its views go over, until none is left to go: at first those
    whose views are all uncertain, then those of fewer than `least_views`.
    """
    stands = np.ones(cost.shape[1], dtype=bool)
    while (gone := _label_to_go(cost, stands, _uncertain(cost, different, stands))) is not None:
        stands[gone] = False
    while (gone := _label_to_go(cost, stands, _view_count(cost, stands) < least_views)) is not None:
        stands[gone] = False
    return stands


def _uncertain(cost: np.ndarray, different: np.ndarray, stands: np.ndarray) -> Bool[np.ndarray, "labels"]:
    """Labels all of whose views could have a larger label (of two equally large ones, that of the greater number)."""
    count, held = _view_count(cost, stands), _held(cost, stands)
    rank = np.lexsort((np.arange(len(count)), -count)).argsort()
    larger = stands[None, :] & (rank[None, :] < rank[held][:, None])
    free = (larger & ~different & np.isfinite(cost)).any(axis=1)
    return np.bincount(held, weights=~free, minlength=len(stands)) == 0


def _label_to_go(cost: np.ndarray, stands: np.ndarray, weak: np.ndarray) -> int | None:
    """The smallest weak label whose views have another to go to; of equal ones that of least cost, then the last."""
    count, held = _view_count(cost, stands), _held(cost, stands)
    choices = []
    for label in np.flatnonzero(stands & weak):
        elsewhere = np.where(stands & (np.arange(len(stands)) != label), cost[held == label], np.inf).min(axis=1)
        if np.isfinite(elsewhere).all():
            choices.append((int(count[label]), float(elsewhere.sum()), -int(label)))
    return -min(choices)[2] if choices and stands.sum() > 1 else None


def _held(cost: np.ndarray, stands: np.ndarray) -> Int[np.ndarray, "views"]:
    return np.where(stands, cost, np.inf).argmin(axis=1)


def _view_count(cost: np.ndarray, stands: np.ndarray) -> Int[np.ndarray, "labels"]:
    return np.bincount(_held(cost, stands), minlength=len(stands))
