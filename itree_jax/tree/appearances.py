"""Appearances over view x roll: what each region of the part looks like from every attitude, without noise.

Cast shadows turn with the part under fixed lights, so that an attitude is a viewer direction and a rotation about it:
the paper's work models at representative attitudes, taken at many.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import jax
import numpy as np
from itree_kernels.apparent import ApparentShapes, cast_apparent_shapes
from itree_kernels.camera import Camera
from itree_kernels.mesh import RayMesh
from jaxtyping import Bool, Float, Int

from itree_jax.batches import groups_of, streamed
from itree_jax.features.region import RegionFeatures, measure_batch
from itree_jax.features.relation import BROTHER_FIELDS, brothers
from itree_jax.features.window import Window
from itree_jax.sensing.reaching import LIGHTS_NEEDED
from itree_jax.sensor import Sensor
from itree_jax.tree.groups import roll_rotation
from itree_jax.tree.sights import (
    Region,
    describe_region,
    edges_of,
    largest_regions,
    sensor_needle_deviation,
    window_images,
)

WINDOW_SIZE = 48  # pixels across the largest extent of the part: 2 % of its size, and a region has hundreds of them
WINDOW_MARGIN = 1.1  # the window is at least this much wider than the part, so that noise at its rim isn't cut
# Pitches are a quarter of an octave apart, so that parts of about one size share their windows, and a region is
# measured once for all of them. It costs a part a tenth of its pixels across on average, a sixth at most.
SIZES_PER_OCTAVE = 4
STORED_BROTHERS = 2  # other regions of an attitude: no more than three are kept
BATCH = 256  # windows measured at once
VIEWS_AT_ONCE = 256  # bounds memory: 48 x 48 pixels x 256 views x some 100 bytes, 60 MB a core


@dataclass(frozen=True)
class Appearances:
    """Regions seen from attitudes (view x roll); row k is one region of attitude `attitude[k]`.

    Features are in the camera frame of an orthographic camera that looks along +z at the part's origin.
    """

    R_cam_obj: Float[np.ndarray, "attitudes 3 3"]
    view: Int[np.ndarray, "attitudes"]  # cell of the compile's dome that holds the viewer direction
    group: Int[np.ndarray, "attitudes"]  # attitude group, by what is detectable at this view and roll
    attitude: Int[np.ndarray, "regions"]
    area: Float[np.ndarray, "regions"]  # surface [mm^2]
    mean_normal: Float[np.ndarray, "regions 3"]  # unit
    mass_centre: Float[np.ndarray, "regions 3"]  # of the EGI
    egi: Float[np.ndarray, "regions cells"]  # [mm^2]
    inertia: Float[np.ndarray, "regions 4"]  # I_max, I_min [mm^4], alpha [rad], uniqueness
    outline: Float[np.ndarray, "regions n_theta"]  # d(theta) [mm]
    centroid_obj: Float[np.ndarray, "regions 3"]  # mean of the region's surface points, part frame [mm]
    shares: Float[np.ndarray, "regions 5"]  # per surface characteristic
    characteristic_map: Float[np.ndarray, "regions 5 32 5"]  # [mm^2] per polar cell
    edge_map: Float[np.ndarray, "regions 5 32 3"]  # [mm] per polar cell
    brothers: Float[np.ndarray, "regions 2 6"]  # the attitude's other regions, see `features.relation`
    face_area: Float[np.ndarray, "attitudes faces"]  # detectable [mm^2 in the image plane]


def window_camera(reach: float) -> tuple[Camera, float]:
    """The orthographic camera of a window around a part of this reach [mm], and its pitch [mm], one of a few sizes."""
    pitch = _size_above(WINDOW_MARGIN * 2.0 * reach / WINDOW_SIZE)
    centre = (WINDOW_SIZE - 1) / 2.0
    return Camera("orthographic", 1.0 / pitch, 1.0 / pitch, centre, centre, WINDOW_SIZE, WINDOW_SIZE), pitch


def _size_above(pitch: float) -> float:
    """The least of the sizes 2^(k / 4) mm that is no smaller."""
    step = np.ceil(SIZES_PER_OCTAVE * np.log2(pitch) - 1e-9)  # rounding must not lift a pitch that is a size already
    return float(2.0 ** (step / SIZES_PER_OCTAVE))


def turned(R_cam_obj: Float[np.ndarray, "views 3 3"], rolls: int) -> Float[np.ndarray, "views rolls 3 3"]:
    """Every view turned about the line of sight by 2 pi k / rolls."""
    return np.einsum("kij,vjl->vkil", roll_rotation(2.0 * np.pi * np.arange(rolls) / rolls), R_cam_obj)


def interpretable(shapes: ApparentShapes, sensor: Sensor) -> Bool[np.ndarray, "views s s"]:
    """Pixels of orthographic views that get a needle: lit by three lights or more, slant under the limit; to a depth
    camera, the slant alone counts.

    With three lights these are the detectable ones (sec. 2.1.1). With more, photometric stereo does without one that is
    blocked, and a view that asked for all of them would show other regions than the sensor does.
    """
    facing = -shapes.normal[..., 2] > np.cos(sensor.slant_limit)
    return facing & (shapes.lit.sum(axis=1) >= min(LIGHTS_NEEDED, sensor.light_count))


def appearances(
    mesh: RayMesh,
    sensor: Sensor,
    R_cam_obj: Float[np.ndarray, "views 3 3"],
    view: Int[np.ndarray, "views"],
    rolls: int,
) -> Appearances:
    """Casts every view at every roll and measures its regions.

    `view` names the dome cell that each of the (finer) views belongs to. Regions under the sensor's smallest are left
    out.
    """
    reach = mesh_reach(mesh)
    camera, pitch = window_camera(reach)
    R_all = turned(R_cam_obj, rolls).reshape(-1, 3, 3)
    least = sensor.smallest_region / pitch**2

    def of_batch(first: int) -> list[SeenAttitude]:
        return seen_attitudes(mesh, sensor, R_all[first : first + VIEWS_AT_ONCE], camera, pitch, least)

    places, face_area = [], []

    def windows() -> Iterator[PixelMaps]:
        for batch in streamed(of_batch, range(0, len(R_all), VIEWS_AT_ONCE)):
            for a in batch:
                places.append([region.without_pixels() for region in a.regions])
                face_area.append(a.face_area)
                yield from (pixels_of(region.mask, a.normal, a.edges) for region in a.regions)

    features = measured(windows(), pitch, sensor_needle_deviation(sensor))
    every = [(k, region) for k, regions in enumerate(places) for region in regions]
    return Appearances(
        R_cam_obj=R_all.astype(np.float32),
        view=np.repeat(view, rolls).astype(np.int32),
        group=np.zeros(len(R_all), np.int32),  # until `grouped` names it
        attitude=np.array([k for k, _ in every], np.int32),
        area=np.asarray(features.area),
        mean_normal=np.asarray(features.mean_normal),
        mass_centre=np.asarray(features.mass_centre),
        egi=np.asarray(features.egi),
        inertia=inertia_table(features),
        outline=np.asarray(features.outline),
        centroid_obj=np.array([R_all[k].T @ region.centre for k, region in every], np.float32).reshape(-1, 3),
        shares=np.asarray(features.shares),
        # half precision: they are compared by correlation, and are most of a tree's bytes
        characteristic_map=np.asarray(features.characteristic_map, np.float16),
        edge_map=np.asarray(features.edge_map, np.float16),
        brothers=brothers_of_each(places, np.asarray(features.inertia.alpha)),
        face_area=np.array(face_area, np.float32),
    )


class SeenAttitude(NamedTuple):
    """One window with its regions."""

    regions: list[Region]  # the largest first
    normal: Float[np.ndarray, "s s 3"]
    edges: Float[np.ndarray, "s s 2"]
    face_area: Float[np.ndarray, "faces"]


def seen_attitudes(
    mesh: RayMesh, sensor: Sensor, R: Float[np.ndarray, "views 3 3"], camera: Camera, pitch: float, least: float
) -> list[SeenAttitude]:
    """What the sensor makes of some attitudes without noise."""
    shapes = cast_apparent_shapes(mesh, R, np.zeros((len(R), 3)), camera, sensor.light_directions, sensor.slant_limit)
    seen = interpretable(shapes, sensor)
    images = window_images(shapes.face >= 0, shapes.normal, shapes.lit, sensor)
    edges = edges_of(np.moveaxis(images, 0, 1), sensor)
    areas = face_areas(shapes, mesh, pitch)
    found = []
    for k in range(len(R)):
        regions = [
            describe_region(mask, shapes.normal[k], shapes.depth[k], camera)
            for mask in largest_regions(seen[k], least)
        ]
        found.append(SeenAttitude(regions, shapes.normal[k], edges[k], areas[k]))
    return found


def brothers_of_each(
    regions: list[list[Region]], alpha: Float[np.ndarray, "regions"]
) -> Float[np.ndarray, "regions 2 6"]:
    """The other regions of every region's attitude; `alpha` runs over all regions, attitude by attitude."""
    found, first = [np.zeros((0, STORED_BROTHERS, BROTHER_FIELDS), np.float32)], 0
    for one in regions:
        own = np.asarray(alpha)[first : first + len(one)]
        if one:
            centre, normal = np.array([r.centre for r in one]), np.array([r.normal for r in one])
            every = brothers(centre, normal, own, np.array([r.area for r in one]), np.inf)
            found.append(every[:, :STORED_BROTHERS])
        first += len(one)
    return np.concatenate(found)


def face_areas(shapes: ApparentShapes, mesh: RayMesh, pitch: float) -> Float[np.ndarray, "views faces"]:
    """Detectable area of every component face in each view [mm^2 in the image plane]."""
    count = int(np.asarray(mesh.face_of_triangle).max()) + 1
    return np.array([
        np.bincount(face[mask], minlength=count) * pitch**2
        for face, mask in zip(shapes.face, shapes.detectable, strict=True)
    ])  # fmt: skip


def mesh_reach(mesh: RayMesh) -> float:
    """Largest distance of a vertex from the part's origin [mm]."""
    return float(np.linalg.norm(mesh.vertices, axis=1).max())


class PixelMaps(NamedTuple):
    """One region's pixels, as its features are measured from them."""

    mask: Bool[np.ndarray, "s s"]
    normal: Float[np.ndarray, "s s 3"]  # 0 outside the region
    edges: Float[np.ndarray, "s s 2"]


def pixels_of(
    mask: Bool[np.ndarray, "s s"], normal: Float[np.ndarray, "s s 3"], edges: Float[np.ndarray, "s s 2"]
) -> PixelMaps:
    return PixelMaps(mask, np.where(mask[..., None], normal, 0.0), edges)


def measured(windows: Iterable[PixelMaps], pitch: float, needle_std: float) -> RegionFeatures:
    """Features of any number of windows as NumPy arrays, measured in batches of one size so that one shape is compiled.

    Windows are asked for as they are measured: a few batches of them are in memory, however many there are.
    """
    size = WINDOW_SIZE

    def of_batch(batch: list[PixelMaps]) -> RegionFeatures:
        mask, normal = np.zeros((BATCH, size, size), bool), np.zeros((BATCH, size, size, 3), np.float32)
        line, count = np.zeros((BATCH, size, size, 2), np.float32), len(batch)
        if count:
            mask[:count], normal[:count], line[:count] = map(np.stack, zip(*batch, strict=True))
        window = Window(mask, normal, np.full(BATCH, pitch, np.float32))
        return jax.tree.map(lambda a: np.asarray(a)[:count], measure_batch(window, line, np.float32(needle_std)))

    parts = list(streamed(of_batch, groups_of(windows, BATCH)))
    return jax.tree.map(lambda *arrays: np.concatenate(arrays), *parts)


def inertia_table(features: RegionFeatures) -> Float[np.ndarray, "regions 4"]:
    """I_max, I_min, alpha, uniqueness."""
    inertia = features.inertia
    return np.stack([inertia.I_max, inertia.I_min, inertia.alpha, inertia.uniqueness], axis=-1)
