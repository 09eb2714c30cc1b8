"""How many turns about a part's own axis the image's own resolution has to be asked about: what fewer would lose.

    python experiments/validation_bins.py --out out/round_parts --scenes 4 --seed 11 --parts stepped-pin flange knob
    python experiments/turn_ranks.py [--bins DIR] [--depth file|stereo] [--trees DIR] [--every N]

Poses of parts that are nearly of revolution are turned all around, and every turn is held against the scene
(`own_axis`). Of the bins' accepted poses: how often the likeliest turn is not among the first so many at a half or a
quarter of the image's resolution, and how much less likely the likeliest of those is; the same of the likeliest turn
that is another pose, where it is a rival: less than `RIVAL` nats behind.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

import numpy as np
from quality.comparison import markdown_table
from true_scenes import TrueScene, bins_parser, true_scenes

from itree_jax import own_axis, settling
from itree_jax.cli.scene_answer import load_with_trees, with_depth_from
from itree_jax.own_axis import STEP, likelier_than_first, turned
from itree_jax.prepared import prepare_forest
from itree_jax.recognition import read_scene
from itree_jax.refinement.hypotheses import best_of_each_region
from itree_jax.refinement.likelihood import SIZE
from itree_jax.refinement.pose_distance import NEARLY_SAME, same_part_distance

SHARES = (2, 4)  # of the resolution
FIRST = (12, 18, 24, 36)  # turns
RIVAL = 50.0  # [nats]


class Turns(NamedTuple):
    """Of one pose."""

    nats: np.ndarray  # of every turn at the image's own resolution
    order: tuple[np.ndarray, ...]  # by share of the resolution
    likeliest: int
    rival: tuple[int, ...]  # empty: there is none
    another: np.ndarray  # which turns are another pose than the likeliest

    def lost(self, share: int, first: int) -> tuple[float, float | None]:
        """How much less likely [nats] the likeliest turn of the first so many is, and the likeliest rival."""
        taken = self.order[SHARES.index(share)][:first]
        likeliest = float(self.nats[self.likeliest] - self.nats[taken].max())
        if not self.rival:
            return likeliest, None
        others = taken[self.another[taken]]
        return likeliest, float(self.nats[self.rival[0]] - self.nats[others].max(initial=-np.inf))


def main(bins: Path, depth: str, trees: Path | None, every: int) -> None:
    taken = true_scenes(bins, Path("out/turn_ranks"), trees, every)
    turns = [turn for one in taken if one.prepared.own_axis is not None for turn in turns_of_scene(one, depth)]
    rows = []
    for share in SHARES:
        for first in FIRST:
            likeliest, rival = zip(*(one.lost(share, first) for one in turns), strict=True)
            of_rivals = [nats for nats in rival if nats is not None]
            rows.append([f"1/{share}", str(first), *told(likeliest), *told(of_rivals)])
    of = ("poses", "not among them", "lost, the most")
    print(markdown_table(["resolution", "first turns", *of, "rivals", *of[1:]], rows))


def told(lost: Sequence[float]) -> list[str]:
    """How many there are, how many lose anything, and the most that one does."""
    return [str(len(lost)), str(sum(nats > 0.0 for nats in lost)), f"{max(lost, default=0.0):.1f}"]


def turns_of_scene(one: TrueScene, depth: str) -> list[Turns]:
    """Recognises one scene and asks all turns of every pose that is turned on the way."""
    scene, _ = load_with_trees(one.folder, [one.prepared])
    scene, second = with_depth_from(depth, scene, one.prepared.tree.sensor)
    with asked() as turns:
        read_scene(prepare_forest([one.prepared]), scene.images, scene.sensor, scene.depth, scene.R_w2c, second)
    return turns


@contextmanager
def asked() -> Iterator[list[Turns]]:
    """Notes what every pose's turns are."""
    turns: list[Turns] = []
    likeliest_turns = own_axis.likeliest_turns

    def noted(pose, prepared, sight, plan):
        every = turned(pose, STEP * np.arange(round(2.0 * np.pi / STEP)), prepared)
        nats = likelier_than_first(every, prepared, sight, plan)
        first, *second = best_of_each_region(nats, every, 2, prepared.symmetries, prepared.model.diameter)
        second = [k for k in second if nats[k] > nats[first] - RIVAL]
        order = tuple(np.argsort(-likelier_than_first(every, prepared, sight, plan, SIZE // s)) for s in SHARES)
        R, t = (np.asarray(a, float) for a in every.poses)
        diameter = prepared.model.diameter
        apart = same_part_distance(R, t, R[first], t[first], prepared.symmetries, diameter)
        turns.append(Turns(nats, order, first, tuple(second), apart >= NEARLY_SAME * diameter))
        return likeliest_turns(pose, prepared, sight, plan)

    with (
        patch.object(own_axis, "likeliest_turns", noted),
        patch.object(settling, "on_all_cores", lambda step, answers: [step(a) for a in answers]),
    ):
        yield turns


if __name__ == "__main__":
    parser = bins_parser(__doc__, every=1)
    parser.set_defaults(bins=Path("out/round_parts"))
    parser.add_argument("--depth", choices=("file", "stereo"), default="file")
    given = parser.parse_args()
    main(given.bins, given.depth, given.trees, given.every)
