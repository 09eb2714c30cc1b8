"""Backtracking, the paper's "next step" (section 4): what is asked where the tree's first answers explain nothing.

A region's attitudes are tried in the order of their likelihood until they hold most of the posterior mass. What the
accepted poses explain is then taken out of the scene, and what is left is looked at again: regions that held two parts
fall apart, surface that no needle told about becomes a region by its depth, by two lights or past the slant limit, and
the search goes back to the root, where every attitude of the dome is open.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float

from itree_jax.answers import Interpretation
from itree_jax.refinement.hypotheses import RegionHypotheses
from itree_jax.refinement.schedule import STEEPEST_SEEN
from itree_jax.sensing.depth_needles import depth_needles
from itree_jax.sensing.folded_regions import parted_at_folds
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.regions import Regions, added, regions
from itree_jax.sensing.segments import depth_segments, faces_of_segments
from itree_jax.sensing.slant_limit import detectable
from itree_jax.sensing.two_lights import two_light_needles
from itree_jax.sight import Sight
from itree_jax.stereo.dual_stereo import AGREES

# Probability from which on a pose's pixels need no other explanation: with a depth map, and by images alone. Of two
# cameras 99 % of the answers of a score from 0.8 on are right (calibrate_scores.py).
SURE, SURE_BY_IMAGES = 0.9, 0.98
EDGE_OF_A_POSE = 2  # [px] beside an explained pixel: the raster and the pose's own error
TOWARD_VIEWER = np.array([0.0, 0.0, -1.0])  # the normal of what no needle tells about
SOFT = 5  # [px] of the median that takes single wrong matches out
MOST_TOLD = 0.6  # of a region's pixels with a needle: what has more was read already


@dataclass(frozen=True)
class Beam:
    """How much of a region's attitudes is looked at."""

    mass: float  # of the posterior, the likeliest first
    keep: tuple[int, ...]  # hypotheses per region after each round of refinement, whose first rounds are cheap
    keep_by_images: tuple[int, ...]  # without a depth map
    whole_dome: bool  # also attitudes that no rule of the tree named
    least: float = 0.0  # of the usual area of the part's regions: smaller ones are left alone


# Of the regions that have an attitude within reach of refinement at all, 71 % have it in the first three quarters of
# the mass, a quarter of the attitudes that hold 99 % (experiments/hypothesis_ranks.py); most parts show two regions.
FIRST = Beam(0.75, (32, 12, 4, 2, 2), (24, 8, 3, 2, 2), whole_dome=False, least=0.15)
DEEP = Beam(0.99, (64, 20, 5, 2, 2), (48, 14, 4, 2, 2), whole_dome=True, least=0.25)


def likeliest(hypotheses: RegionHypotheses, mass: float) -> RegionHypotheses:
    """Of every region, the fewest hypotheses that hold this posterior mass, all attitudes equally likely before."""
    kept = []
    for region in np.unique(hypotheses.region):
        mine = np.flatnonzero(hypotheses.region == region)
        log_p = hypotheses.log_likelihood[mine]
        order = np.argsort(-log_p, kind="stable")
        p = np.exp(log_p[order] - log_p.max())
        before = (np.cumsum(p) - p) / p.sum()
        kept.append(mine[order[before < mass]])
    return hypotheses.take(np.sort(np.concatenate(kept)))


def left_over(sight: Sight, answers: list[Interpretation], longest: float = np.inf) -> Sight | None:
    """The sight without what accepted poses explain; None if no region is left.

    Where there is a depth map, surface that a light reaches and no needle tells about makes regions too, by the depth's
    own normals; where there is none, needles past the slant limit do (`with_steep`). `longest` [mm]: see
    `Sight.parted`.
    """
    known = explained(answers, sight)
    free = ~known if sight.lit is None else ~known & sight.lit
    needle = sight.needle._replace(interpretable=np.asarray(sight.needle.interpretable) & free)
    depth = None if sight.depth is None else np.where(known, np.float32(0.0), sight.depth)
    found, segments = regions(needle, depth, sight.sensor, sight.R_w2c, sight.edges), None
    if sight.kind != "depth":
        found = with_steep(found, needle, depth, sight)
    elif sight.lit is not None and sight.depth is not None and depth is not None:
        normals = sight.of_depth or depth_needles(sight.depth, sight.sensor.camera, sight.noise)
        untold = free & (depth > 0) & (found.labels < 0) & normals.known
        segments = depth_segments(depth, sight.sensor)
        labels = faces_of_segments(np.where(untold, segments, 0), normals.normals)
        found = added(found, labels, normals.normals, depth, sight.sensor, sight.R_w2c)
        fill = (found.labels >= 0) & ~np.asarray(needle.interpretable)
        needle = needle._replace(normals=np.where(fill[..., None], normals.normals, np.asarray(needle.normals)))
        found = parted_at_folds(found, np.asarray(needle.normals), depth, sight.sensor, longest, sight.R_w2c)
    return sight.of(somewhere(found, sight), needle, depth, segments) if found.count else None


def somewhere(found: Regions, sight: Sight) -> Regions:
    """The regions, at the working distance where nothing tells how far they are."""
    known = np.isfinite(found.mean_depth)
    distance = np.where(known, found.mean_depth, sight.sensor.working_distance)
    return replace(found, mean_depth=distance, height=np.where(known, found.height, 0.0))


def with_steep(
    found: Regions, needle: NeedleMap, depth: Float[np.ndarray, "height width"] | None, sight: Sight
) -> Regions:
    """The regions, and after them those of needles past the slant limit, of which no rule of the tree tells: parts that
    stand or lean steeply may show nothing else.
    """
    past = np.asarray(needle.interpretable) & ~detectable(needle, sight.sensor)
    to_grazing = replace(sight.sensor, slant_limit=STEEPEST_SEEN)
    steep = regions(needle._replace(interpretable=past), depth, to_grazing, sight.R_w2c, sight.edges)
    where = np.zeros(past.shape, np.float32) if depth is None else depth
    return added(found, steep.labels + 1, np.asarray(needle.normals), where, sight.sensor, sight.R_w2c)


def unread(sight: Sight, answers: list[Interpretation]) -> Sight | None:
    """The lit surface that two cameras see, that no accepted pose explains and that needles hardly tell about, as
    regions of its own; None if there is none.

    One light in shadow leaves a surface without needles. Matched windows tell where it is, to some millimetres, and the
    images' edges where it ends. Which way it faces is left to the whole dome.
    """
    if sight.soft_depth is None or sight.lit is None:
        return None
    known = explained(answers, sight)
    free = sight.lit & (sight.soft_depth > 0.0) & ~known & ~soft_steps(sight.soft_depth)
    told = np.asarray(sight.needle.interpretable)
    depth = np.where(free, sight.soft_depth, np.float32(0.0))
    normals = np.where(told[..., None], np.asarray(sight.needle.normals), TOWARD_VIEWER).astype(np.float32)
    needle = sight.needle._replace(interpretable=free, normals=normals)
    flat = regions(needle, None, sight.sensor, sight.R_w2c, sight.edges)
    found = added(flat.take(np.arange(0)), flat.labels + 1, normals, depth, sight.sensor, sight.R_w2c)
    inside = found.labels >= 0
    with_needle = np.bincount(found.labels[inside], told[inside], minlength=found.count)
    found = found.take(np.flatnonzero(with_needle < MOST_TOLD * found.area_px))
    return replace(sight.of(found, needle, depth), faces_told=False) if found.count else None


def by_two_lights(sight: Sight, answers: list[Interpretation], which: int) -> Sight | None:
    """The surface without a needle that no accepted pose explains and that two lights reach, as regions that face one
    of the two ways which the lights leave (`which`: 0 or 1); None if there is none. For scenes without a depth map.
    """
    if sight.kind == "depth" or sight.lit is None:
        return None
    free = sight.lit & ~explained(answers, sight) & ~np.asarray(sight.needle.interpretable)
    v, u = np.nonzero(free)
    shading, lights = np.asarray(sight.observed.shading)[v, u], np.asarray(sight.observed.light_directions)
    toward_viewer = -sight.sensor.camera.viewing_ray(np.stack([u, v], axis=-1).astype(float))
    normals = np.zeros((*free.shape, 3), np.float32)
    normals[v, u], free[v, u] = two_light_needles(shading, lights, toward_viewer)[which]
    needle = sight.needle._replace(interpretable=free, normals=normals)
    to_grazing = replace(sight.sensor, slant_limit=STEEPEST_SEEN)
    flat = regions(needle, None, to_grazing, sight.R_w2c, sight.edges)
    faces = faces_of_segments(flat.labels + 1, normals)
    soft = np.zeros(free.shape, np.float32) if sight.soft_depth is None else sight.soft_depth
    depth = np.where(free, soft, np.float32(0.0))
    found = added(flat.take(np.arange(0)), faces, normals, depth, sight.sensor, sight.R_w2c)
    return sight.of(somewhere(found, sight), needle, depth if depth.any() else None) if found.count else None


def soft_steps(depth: Float[np.ndarray, "height width"]) -> Bool[np.ndarray, "height width"]:
    """Where a soft depth map [mm] (0 = none) steps by more than the matching errs by."""
    smooth = cv2.medianBlur(np.ascontiguousarray(depth, np.float32), SOFT)
    around = np.ones((3, 3), np.uint8)
    nearest = cv2.erode(np.where(smooth > 0.0, smooth, np.float32(np.inf)), around)
    return (cv2.dilate(smooth, around) - nearest) > AGREES


def sure_from(sight: Sight) -> float:
    """The score above which a pose is surely right."""
    return SURE if sight.kind == "depth" else SURE_BY_IMAGES


def count_of_sure(answers: list[Interpretation], sight: Sight) -> int:
    """Accepted poses that are surely right."""
    return sum(int((a.selection.score[a.selection.accepted] > sure_from(sight)).sum()) for a in answers)


def explained(
    answers: list[Interpretation], sight: Sight, sure: float | None = None
) -> Bool[np.ndarray, "height width"]:
    """Pixels of poses that are surely right, less what hides them, and those beside. `sure`: the score that they
    exceed; None: what is sure by where depth comes from.
    """
    shape = sight.sensor.camera.height, sight.sensor.camera.width
    sure = sure_from(sight) if sure is None else sure
    mask = np.zeros(shape, np.uint8)
    for answer in answers:
        stride = answer.judged.support.stride
        for h in answer.selection.accepted[answer.selection.score[answer.selection.accepted] > sure]:
            seen = answer.judged.explains(int(h), shape)  # what contradicts a sure pose is a reflection or an error
            own = np.zeros(shape, np.uint8)
            own[seen.rows, seen.columns] = seen.nats > 0.0
            if stride > 1:
                own = cv2.dilate(own, np.ones((stride,) * 2, np.uint8), anchor=(stride - 1,) * 2)
            mask[own > 0] = 1
    return cv2.dilate(mask, np.ones((2 * EDGE_OF_A_POSE + 1,) * 2, np.uint8)) > 0
