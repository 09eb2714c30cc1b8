"""Which poses explain the scene together: hypotheses of one part, of several parts, and of several readings."""

from collections.abc import Callable, Sequence
from functools import cache
from math import dist

import numpy as np

from itree_jax.answers import Interpretation
from itree_jax.prepared import Prepared
from itree_jax.refinement.hypotheses import RegionHypotheses
from itree_jax.refinement.scoring import SCORINGS, Scoring
from itree_jax.refinement.select import Judged, Key, Selection, select_jointly
from itree_jax.refinement.solids import share_space
from itree_jax.sight import Sight


def select(judged: Judged, prepared: Prepared, hypotheses: RegionHypotheses, sight: Sight) -> Selection:
    """Which hypotheses of one part explain the scene together."""
    collide = collisions([(prepared, hypotheses, judged)])
    camera = sight.sensor.camera
    return select_jointly([judged], (camera.height, camera.width), collide, SCORINGS[sight.kind])[0]


def when_asked(
    judged: Judged, prepared: Prepared, hypotheses: RegionHypotheses, sight: Sight
) -> Callable[[], Selection]:
    """The same, selected as soon as it is asked for, and once."""
    return cache(lambda: select(judged, prepared, hypotheses, sight))


def compete(answers: list[Interpretation], sight: Sight) -> list[Interpretation]:
    """Several parts looked for in one bin, or one bin read twice: a place goes to the pose that explains it best."""
    if len(answers) < 2:
        return answers
    chosen = selections(answers, sight, SCORINGS[sight.kind])
    return [a.selected(s) for a, s in zip(answers, chosen, strict=True)]


def selections(answers: list[Interpretation], sight: Sight, scoring: Scoring) -> list[Selection]:
    """Which hypotheses of all answers explain the scene together, and how probable each is."""
    collide = collisions([(a.prepared, a.hypotheses, a.judged) for a in answers])
    camera = sight.sensor.camera
    return select_jointly([a.judged for a in answers], (camera.height, camera.width), collide, scoring)


def collisions(bodies: Sequence[tuple[Prepared, RegionHypotheses, Judged]]) -> Callable[[Key, Key], bool]:
    """Whether two hypotheses, keyed by (part, index), share space."""
    poses = [tuple(np.asarray(a, float) for a in hypotheses.poses) for _, hypotheses, _ in bodies]
    solids = [prepared.solid for prepared, _, _ in bodies]
    centres = [(R @ one.mesh.centre + t).tolist() for one, (R, t) in zip(solids, poses, strict=True)]
    found = [judged.totals.found for _, _, judged in bodies]

    def collide(a: Key, b: Key) -> bool:
        one, other = solids[a[0]], solids[b[0]]
        if dist(centres[a[0]][a[1]], centres[b[0]][b[1]]) > one.mesh.radius + other.mesh.radius:
            return False
        if not found[a[0]][a[1]].keeps(found[b[0]][b[1]]):
            a, b, one, other = b, a, other, one
        known, beside = found[a[0]][a[1]].shares_space, found[b[0]][b[1]]
        if beside not in known:
            (R_a, t_a), (R_b, t_b) = poses[a[0]], poses[b[0]]
            known[beside] = share_space(one, R_a[a[1]], t_a[a[1]], other, R_b[b[1]], t_b[b[1]])
        return known[beside]

    return collide
