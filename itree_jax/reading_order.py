"""Which regions of a scene are read, and when: what a pose that is surely right explains needs no reading."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from itree_jax.answers import Interpretation
from itree_jax.backtracking import FIRST, Beam, count_of_sure, explained
from itree_jax.competition import compete
from itree_jax.interpreting import interpret
from itree_jax.prepared import Prepared, PreparedForest
from itree_jax.region_measures import Measured, measure_regions
from itree_jax.root_answer import RootAnswer, ask_root
from itree_jax.sensing.regions import Regions
from itree_jax.settling import settled
from itree_jax.sight import Sight

AT_ONCE = 4  # regions that are read together where a few picks are enough: most parts show two
MOSTLY = 0.5  # of a region's pixels


class Asked(NamedTuple):
    """The regions of a scene as the trees read them, and what the root says of each."""

    measured: dict[float, Measured]  # by the pitch of the windows [mm]
    said: RootAnswer | None  # None: there are no regions


def ask(forest: PreparedForest, images: Float[np.ndarray, "lights height width"], sight: Sight) -> Asked:
    """Measures all regions and asks the root."""
    found = sight.found
    if not found.count:
        return Asked({}, None)
    measured = {
        pitch: measure_regions(found, sight.needle, images, sight.sensor, pitch) for pitch in forest.pitches
    }
    return Asked(measured, ask_root(forest, measured))


def read(
    forest: PreparedForest, sight: Sight, asked: Asked, beam: Beam, only: Bool[np.ndarray, "regions"] | None = None
) -> list[Interpretation]:
    """What each tree makes of the regions that the root leaves to it; of some of them, if told."""
    said = asked.said
    if said is None:
        return []
    wanted = np.ones(sight.found.count, bool) if only is None else only
    answers = [
        interpret(prepared, part, those, said, asked.measured[prepared.pitch], sight, beam)
        for part, prepared in enumerate(forest.trees)
        if len(those := np.flatnonzero(said.left[:, part] & wanted & large_enough(sight.found, prepared, beam.least)))
    ]
    return compete(answers, sight)


def told(sight: Sight, answers: list[Interpretation]) -> Bool[np.ndarray, "regions"]:
    """Regions that poses which are surely right explain."""
    labels, known = sight.found.labels, explained(answers, sight)
    inside = labels >= 0
    share = np.bincount(labels[inside], known[inside], minlength=sight.found.count)
    return share > MOSTLY * sight.found.area_px


def read_topmost(forest: PreparedForest, sight: Sight, asked: Asked, picks: int) -> list[Interpretation] | None:
    """The highest regions alone, which are usually not occluded, `AT_ONCE` more at a time, until `picks` poses are
    sure. None if they never are.
    """
    found = sight.found
    smallest = min(FIRST.least * prepared.usual_area for prepared in forest.trees)
    order = np.argsort(-found.height, kind="stable")
    order = order[found.area_mm2[order] >= smallest]
    answers: list[Interpretation] = []
    while len(order):
        new = np.isin(np.arange(found.count), order[:AT_ONCE])
        answers = settled(compete([*answers, *read(forest, sight, asked, FIRST, new)], sight), sight)
        if count_of_sure(answers, sight) >= picks:
            return answers
        order = order[AT_ONCE:]
        order = order[~told(sight, answers)[order]]
    return None


def large_enough(found: Regions, prepared: Prepared, share: float) -> Bool[np.ndarray, "regions"]:
    """Regions of at least this share of the part's usual area of a region."""
    return found.area_mm2 >= share * prepared.usual_area
