"""Backtracking, the paper's "next step" (section 4): what is asked where the tree's first answers explain nothing.

A region's attitudes are tried in the order of their likelihood until they hold most of the posterior mass. What the
accepted poses explain is then taken out of the scene, and what is left is looked at again: regions that held two parts
fall apart, unlit surface that no needle told about becomes a region by its depth, and the search goes back to the root,
where every attitude of the dome is open.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from itree_jax.answers import Interpretation
from itree_jax.open_attitudes import all_attitudes
from itree_jax.prepared import Prepared
from itree_jax.refinement.hypotheses import RegionHypotheses, distinct
from itree_jax.refinement.optimise import Hypotheses
from itree_jax.sensing.depth_needles import depth_needles
from itree_jax.sensing.regions import added, regions
from itree_jax.sensing.segments import depth_segments, faces_of_segments
from itree_jax.shown_surface import facing, middle_of_all, turns_onto
from itree_jax.sight import Sight
from itree_jax.split_region import pieces_of
from itree_jax.stereo.dual_stereo import AGREES

SURE = 0.9  # probability from which on a pose's pixels need no other explanation
LEAST_OPEN = 0.5  # of the usual area of the part's regions: smaller places aren't worth every attitude
LEAST_FACING = 0.25  # of a region's area: an attitude 15 degrees off shows a steep face at a fraction of its size
NEARLY_OPEN = 0.06  # of the diameter: a third of the dome's step, as far apart as attitudes of it need to be
MOST_OPEN = 8  # places at which every attitude is asked for, the largest first
EDGE_OF_A_POSE = 2  # [px] beside an explained pixel: the raster and the pose's own error
TOWARD_VIEWER = np.array([0.0, 0.0, -1.0])  # the normal of what no needle tells about
SOFT = 5  # [px] of the median that takes single wrong matches out
MOST_TOLD = 0.6  # of a region's pixels with a needle: what has more was read already


@dataclass(frozen=True)
class Beam:
    """How much of a region's attitudes is looked at."""

    mass: float  # of the posterior, the likeliest first
    keep: tuple[int, ...]  # hypotheses per region after each round of refinement
    whole_dome: bool  # also attitudes that no rule of the tree named
    least: float = 0.0  # of the usual area of the part's regions: smaller ones are left alone


# Of the regions that have an attitude within reach of refinement at all, 71 % have it in the first three quarters of
# the mass, a quarter of the attitudes that hold 99 % (experiments/hypothesis_ranks.py); most parts show two regions.
FIRST = Beam(0.75, (24, 8, 3, 2, 2), whole_dome=False, least=0.15)
DEEP = Beam(0.99, (48, 14, 4, 2, 2), whole_dome=True, least=0.25)


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


class Places(NamedTuple):
    """Where a part may lie of which no rule tells the attitude."""

    region: Int[np.ndarray, "places"]  # that it holds
    alone: Bool[np.ndarray, "places"]  # the surface that hangs together with the region may be one part's


def open_places(prepared: Prepared, sight: Sight, asked: Int[np.ndarray, "asked"]) -> Places:
    """Every surface that hangs together and is no larger than what a part shows, by its largest region; in a pile of
    parts that touch, every region. The largest `MOST_OPEN` that are large enough.

    A surface that shadows and edges part into several regions is one place: its regions alone may be too small to be
    asked, and all of them would ask the same.
    """
    found, held = sight.found, sight.held
    alone = held.area_mm2[asked] <= prepared.largest_view
    area = np.where(alone, held.area_mm2[asked], found.area_mm2[asked])
    surface = np.where(alone, held.segment[asked], -1 - asked)
    largest_first = np.argsort(-found.area_mm2[asked], kind="stable")
    first = largest_first[np.sort(np.unique(surface[largest_first], return_index=True)[1])]
    first = first[area[first] >= LEAST_OPEN * prepared.usual_area]
    first = np.sort(first[np.argsort(-area[first], kind="stable")][:MOST_OPEN])
    return Places(asked[first], alone[first])


def every_attitude(
    prepared: Prepared, sight: Sight, places: Places, R_ray_cam: Float[np.ndarray, "regions 3 3"]
) -> RegionHypotheses:
    """The whole dome at every place. All attitudes that show a surface which faces about as the region does and isn't
    much smaller, turned so that it faces as the region does, with its middle on the region's, or on that of every piece
    of a region that is larger than such a surface. Where the surface that the region is of may be one part's, also the
    attitudes as they are, with the middle of all that they show on the middle of the surface.

    Each attitude stands for the appearance of the nearest one in the tree.
    """
    tree, found = prepared.tree, sight.found
    attitudes = np.asarray(tree.appearances.R_cam_obj, float).reshape(-1, 9)
    with_row = np.unique(tree.appearances.attitude, return_index=True)
    R_ray_obj, of_all = all_attitudes(), middle_of_all(prepared.shown)
    nearest = np.argmax(R_ray_obj.reshape(-1, 9) @ attitudes[with_row[0]].T, axis=1)
    places_of = []
    for region, alone in zip(*places, strict=True):
        R_cam_ray, kept = R_ray_cam[region].T, prepared.attitudes
        if sight.faces_told:
            way_ray = found.mean_normal[region] @ R_cam_ray
            shown = facing(prepared.shown, way_ray)
            kept = kept[shown.area[kept] >= LEAST_FACING * found.area_mm2[region]]
            R = turns_onto(shown.normal[kept], way_ray)
            middle = np.einsum("kab,kb->ka", R, shown.middle[kept])
            for own in middles(sight, region, np.median(shown.area[kept]) if len(kept) else np.inf):
                places_of.append((region, kept, R_cam_ray @ R @ R_ray_obj[kept], own - middle @ R_cam_ray.T))
        if alone or not sight.faces_told:
            centre = sight.held.centre[region] if alone else middles(sight, region, np.inf)[0]
            places_of.append((region, kept, R_cam_ray @ R_ray_obj[kept], centre - of_all[kept] @ R_cam_ray.T))
    region = np.concatenate([np.full(len(kept), region) for region, kept, _, _ in places_of])
    attitude, R, t = (np.concatenate([one[k] for one in places_of]) for k in (1, 2, 3))
    poses = Hypotheses(R.astype(np.float32), t.astype(np.float32))
    every = RegionHypotheses(
        poses, region, with_row[1][nearest[attitude]], np.full(len(region), -np.inf), np.zeros(len(region), bool)
    )
    return every.take(distinct(every, prepared.symmetries, prepared.model.diameter, NEARLY_OPEN))


def middles(sight: Sight, region: int, face_mm2: float) -> Float[np.ndarray, "pieces 3"]:
    """The middle of a region, or of its pieces if it is larger than a face of this area [mm^2], camera frame [mm]."""
    found = sight.found
    face_pixels = face_mm2 / found.area_mm2[region] * found.area_px[region]
    u_v_z = pieces_of(found.mask(region), sight.depth, face_pixels)
    z = np.where(np.isfinite(u_v_z[:, 2]), u_v_z[:, 2], found.mean_depth[region])
    return sight.sensor.camera.unproject(u_v_z[:, :2], z)


def left_over(sight: Sight, answers: list[Interpretation]) -> Sight | None:
    """The sight without what accepted poses explain; None if no region is left.

    Where there is a depth map, surface that a light reaches and no needle tells about makes regions too, by the depth's
    own normals.
    """
    known = explained(answers, (sight.sensor.camera.height, sight.sensor.camera.width))
    needle = sight.needle._replace(interpretable=np.asarray(sight.needle.interpretable) & ~known)
    depth = None if sight.depth is None else np.where(known, np.float32(0.0), sight.depth)
    found, segments = regions(needle, depth, sight.sensor, sight.R_w2c, sight.edges), None
    if sight.lit is not None and sight.depth is not None and depth is not None and sight.kind == "depth":
        normals = sight.of_depth or depth_needles(sight.depth, sight.sensor.camera, sight.noise)
        free = sight.lit & (depth > 0) & (found.labels < 0) & ~known & normals.known
        segments = depth_segments(depth, sight.sensor)
        labels = faces_of_segments(np.where(free, segments, 0), normals.normals)
        found = added(found, labels, normals.normals, depth, sight.sensor, sight.R_w2c)
        fill = (found.labels >= 0) & ~np.asarray(needle.interpretable)
        needle = needle._replace(normals=np.where(fill[..., None], normals.normals, np.asarray(needle.normals)))
    if not found.count:
        return None
    if depth is None:
        found = replace(
            found, mean_depth=np.full(found.count, sight.sensor.working_distance), height=np.zeros(found.count)
        )
    return sight.of(found, needle, depth, segments)


def unread(sight: Sight, answers: list[Interpretation]) -> Sight | None:
    """The lit surface that two cameras see, that no accepted pose explains and that needles hardly tell about, as
    regions of its own; None if there is none.

    One light in shadow leaves a surface without needles. Matched windows tell where it is, to some millimetres, and the
    images' edges where it ends. Which way it faces is left to the whole dome.
    """
    if sight.soft_depth is None or sight.lit is None:
        return None
    known = explained(answers, sight.lit.shape)
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


def soft_steps(depth: Float[np.ndarray, "height width"]) -> Bool[np.ndarray, "height width"]:
    """Where a soft depth map [mm] (0 = none) steps by more than the matching errs by."""
    smooth = cv2.medianBlur(np.ascontiguousarray(depth, np.float32), SOFT)
    around = np.ones((3, 3), np.uint8)
    nearest = cv2.erode(np.where(smooth > 0.0, smooth, np.float32(np.inf)), around)
    return (cv2.dilate(smooth, around) - nearest) > AGREES


def explained(answers: list[Interpretation], shape: tuple[int, int]) -> Bool[np.ndarray, "height width"]:
    """Pixels of poses that are surely right, less what hides them, and those beside."""
    mask = np.zeros(shape, np.uint8)
    for answer in answers:
        support = answer.judged.support
        for h in answer.selection.accepted[answer.selection.score[answer.selection.accepted] > SURE]:
            i, j = np.nonzero(support.pixels[h])  # what contradicts a sure pose is a reflection or a needle's error
            u, v = support.origin_uv[h].astype(int)
            rows, columns = v + support.stride * i, u + support.stride * j
            inside = (rows >= 0) & (rows < shape[0]) & (columns >= 0) & (columns < shape[1])
            mask[rows[inside], columns[inside]] = 1
            if support.stride > 1:
                mask = cv2.dilate(mask, np.ones((support.stride,) * 2, np.uint8), anchor=(support.stride - 1,) * 2)
    return cv2.dilate(mask, np.ones((2 * EDGE_OF_A_POSE + 1,) * 2, np.uint8)) > 0
