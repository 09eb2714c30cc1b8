"""Places where no rule of the tree names an attitude, and all that are possible there: the whole dome.

A region tells which way a face lies, so that what an attitude of the dome leaves open is a turn about the normal, and
where on the face the region is: in its middle, or in a corner where the rest is hidden.
"""

from itertools import chain, product
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from itree_jax.batches import on_all_cores
from itree_jax.open_attitudes import all_attitudes
from itree_jax.prepared import Prepared
from itree_jax.refinement.hypotheses import RegionHypotheses
from itree_jax.refinement.optimise import Hypotheses
from itree_jax.sensing.folded_regions import LONGER
from itree_jax.shown_surface import ends, facing, middle_of_all, turns_onto
from itree_jax.sight import Sight
from itree_jax.split_region import pieces_of

LEAST_OPEN = 0.5  # of the usual area of the part's regions: smaller places aren't worth every attitude
LEAST_FACING = 0.25  # of a region's area: an attitude 15 degrees off shows a steep face at a fraction of its size
NEARLY_OPEN = 0.06  # of the diameter: a third of the dome's step, as far apart as attitudes of it need to be
GRAZING = 0.1  # cosine: along a steeper face nothing is moved farther than along this one
MOST_OPEN = 8  # places at which every attitude is asked for, the largest first


class Places(NamedTuple):
    """Where a part may lie of which no rule tells the attitude."""

    region: Int[np.ndarray, "places"]  # that it holds
    alone: Bool[np.ndarray, "places"]  # the surface that hangs together with the region may be one part's


def open_places(prepared: Prepared, sight: Sight, asked: Int[np.ndarray, "asked"]) -> Places:
    """Every surface that hangs together and is neither larger than what a part shows nor longer than it, by its largest
    region; in a pile of parts that touch, every region. The largest `MOST_OPEN` that are large enough.

    A surface that shadows and edges part into several regions is one place: its regions alone may be too small to be
    asked, and all of them would ask the same.
    """
    found, held = sight.found, sight.held
    alone = held.area_mm2[asked] <= prepared.largest_view
    alone &= held.extent_mm[asked] <= (1.0 + LONGER) * prepared.model.diameter
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
    tree = prepared.tree
    attitudes = np.asarray(tree.appearances.R_cam_obj, float).reshape(-1, 9)
    with_row = np.unique(tree.appearances.attitude, return_index=True)
    R_ray_obj, of_all = all_attitudes(), middle_of_all(prepared.shown)
    nearest = np.argmax(R_ray_obj.reshape(-1, 9) @ attitudes[with_row[0]].T, axis=1)

    def of_place(place: tuple[int, bool]) -> list[tuple[int, np.ndarray, np.ndarray, np.ndarray]]:
        region, alone = place
        R_cam_ray, kept, places_of = R_ray_cam[region].T, prepared.attitudes, []
        if sight.faces_told:
            kept, placed = facing_as_seen(prepared, sight, region, R_cam_ray)
            places_of += [(region, kept[of], R_cam_ray @ R @ R_ray_obj[kept[of]], t) for of, R, t in placed]
        if alone or not sight.faces_told:
            centre = sight.held.centre[region] if alone else middles(sight, region, np.inf)[0]
            places_of.append((region, kept, R_cam_ray @ R_ray_obj[kept], centre - of_all[kept] @ R_cam_ray.T))
        return places_of

    places_of = list(chain.from_iterable(on_all_cores(of_place, zip(*places, strict=True))))
    region = np.concatenate([np.full(len(kept), region) for region, kept, _, _ in places_of])
    attitude, R, t = (np.concatenate([one[k] for one in places_of]) for k in (1, 2, 3))
    poses = Hypotheses(R.astype(np.float32), t.astype(np.float32))
    return RegionHypotheses(
        poses, region, with_row[1][nearest[attitude]], np.full(len(region), -np.inf), *np.zeros((3, len(region)), bool),
    )


def facing_as_seen(
    prepared: Prepared, sight: Sight, region: int, R_cam_ray: Float[np.ndarray, "3 3"]
) -> tuple[Int[np.ndarray, "kept"], list[tuple[np.ndarray, np.ndarray, np.ndarray]]]:
    """The attitudes that show a surface which faces as the region does and isn't much smaller; and for every place of
    such a surface in the region: which of them, what turns each to face exactly so (in the ray's frame), and where the
    part's origin is then, camera frame [mm].
    """
    found, kept = sight.found, prepared.attitudes
    way_ray = found.mean_normal[region] @ R_cam_ray
    shown = facing(prepared.shown, way_ray)
    kept = kept[shown.area[kept] >= LEAST_FACING * found.area_mm2[region]]
    if not len(kept):
        return kept, [(kept, np.zeros((0, 3, 3)), np.zeros((0, 3)))]
    R = turns_onto(shown.normal[kept], way_ray)
    middle = np.einsum("kab,kb->ka", R, shown.middle[kept])
    everyone = np.arange(len(kept))
    own = middles(sight, region, float(np.median(shown.area[kept])))
    placed = [(everyone, R, one - middle @ R_cam_ray.T) for one in own]
    which, t_cam_obj = in_corners(
        sight, region, ends(prepared.shown, way_ray, kept, R), middle, way_ray, R_cam_ray,
        NEARLY_OPEN * prepared.model.diameter,
    )
    return kept, [*placed, (which, R[which], t_cam_obj)]


def in_corners(
    sight: Sight, region: int, face_ray: Float[np.ndarray, "kept 2 2"], middle_ray: Float[np.ndarray, "kept 3"],
    way_ray: Float[np.ndarray, "3"], R_cam_ray: Float[np.ndarray, "3 3"], apart: float,
) -> tuple[Int[np.ndarray, "placed"], Float[np.ndarray, "placed 3"]]:
    """Faces put into the four corners of a region: which face, and where the part's origin is then, camera frame [mm].

    What hides part of a face moves the middle of what is left, but rarely both its ends. A face slides in the region's
    plane. `face_ray`: the ends of each face, `middle_ray` its middle, from the part's origin in the ray's frame [mm].
    Those that lie within `apart` [mm] of where their middle is the region's are left out.
    """
    camera, found = sight.sensor.camera, sight.found
    v, u = np.nonzero(found.mask(region))
    X_cam = camera.unproject(np.stack([u, v], axis=-1).astype(float), np.full(len(u), found.mean_depth[region]))
    own = camera.unproject(found.centroid_uv[region], found.mean_depth[region])
    xy = ((X_cam - own) @ R_cam_ray)[:, :2]
    shift = np.stack([xy.min(axis=0), xy.max(axis=0)]) - (face_ray - middle_ray[:, None, :2])  # [kept, ends, xy]
    which, placed = [], []
    for i, j in product(range(2), repeat=2):
        across = np.stack([shift[:, i, 0], shift[:, j, 1]], axis=-1)
        away = np.flatnonzero(np.linalg.norm(across, axis=-1) > apart)
        deeper = -(across @ way_ray[:2]) / min(way_ray[2], -GRAZING)
        moved = np.concatenate([across, deeper[:, None]], axis=-1) - middle_ray
        which.append(away)
        placed.append(own + moved[away] @ R_cam_ray.T)
    return np.concatenate(which), np.concatenate(placed)


def middles(sight: Sight, region: int, face_mm2: float) -> Float[np.ndarray, "pieces 3"]:
    """The middle of a region, or of its pieces if it is larger than a face of this area [mm^2], camera frame [mm]."""
    found = sight.found
    face_pixels = face_mm2 / found.area_mm2[region] * found.area_px[region]
    u_v_z = pieces_of(found.mask(region), sight.depth, face_pixels)
    z = np.where(np.isfinite(u_v_z[:, 2]), u_v_z[:, 2], found.mean_depth[region])
    return sight.sensor.camera.unproject(u_v_z[:, :2], z)
