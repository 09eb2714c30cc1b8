"""Noisy draws: regions as the sensor would measure them, for distributions and error rates.

A draw is an attitude rendered under every light, given the sensor's noise, read by photometric stereo (or as a depth
camera does) and cut into regions again. Half of the draws stand alone (what recognition sees of a part that lies on
top), half beside another part that hides some of them and casts its shadow (what it sees of the rest of a bin).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import jax
import numpy as np
from itree_kernels.apparent import cast_apparent_shapes
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError
from itree_kernels.mesh import RayMesh
from jaxtyping import Bool, Float, Int

from itree_jax.batches import streamed
from itree_jax.features.region import RegionFeatures, with_brothers
from itree_jax.features.relation import MOST_BROTHERS, brothers
from itree_jax.sensor import Sensor
from itree_jax.tree.appearances import (
    VIEWS_AT_ONCE,
    PixelMaps,
    face_areas,
    measured,
    mesh_reach,
    pixels_of,
    window_camera,
)
from itree_jax.tree.depth_draws import depth_camera_needles
from itree_jax.tree.dome import camera_rotation, dome
from itree_jax.tree.groups import AttitudeGroups, group_of_label, roll_rotation
from itree_jax.tree.neighbours import alone, either, with_neighbours
from itree_jax.tree.sights import (
    NO_PIXELS,
    Region,
    describe_region,
    edges_of,
    largest_regions,
    noisy,
    read,
    sensor_needle_deviation,
    window_images,
)

NOTHING = pixels_of(NO_PIXELS, np.zeros((0, 0, 3), np.float32), np.zeros((0, 0, 2), np.float32))
BESIDE_REACH = 2.0  # of the part's reach: no region of the same part is farther away


@dataclass(frozen=True)
class Draws:
    """One target region (the largest of the part) per draw that shows any."""

    features: RegionFeatures  # leading axis draws, camera frame
    group: Int[np.ndarray, "draws"]  # true attitude group
    R_cam_obj: Float[np.ndarray, "draws 3 3"]  # true attitude
    cut: Bool[np.ndarray, "draws"]  # another part hides or shades some of it
    face_area: Float[np.ndarray, "draws faces"]  # really detectable, the neighbour left out [mm^2 in the image plane]
    empty: int  # draws that showed no region

    def take(self, index: Int[np.ndarray, "kept"]) -> "Draws":
        features = jax.tree.map(lambda a: np.asarray(a)[index], self.features)
        return Draws(
            features, self.group[index], self.R_cam_obj[index], self.cut[index], self.face_area[index], self.empty
        )

    def regrouped(self, group: Int[np.ndarray, "draws"]) -> "Draws":
        """The same draws with other true groups; -1 leaves a draw out."""
        return replace(self, group=group).take(np.flatnonzero(group >= 0))


def draw_regions(
    mesh: RayMesh, sensor: Sensor, groups: AttitudeGroups, count: int, rng: np.random.Generator
) -> Draws:
    """`count` noisy draws from the dome's cells of every group that is kept.

    A draw's true group is that of what is really detectable in it, which need not be its cell's; draws of pruned groups
    are left out. (A group that no draw shows by its label keeps those of its cells.)
    """
    usable = np.flatnonzero(~groups.pruned[groups.group_of_view])
    cells = dome(groups.frequency).triangles[usable]
    R_cam_obj, of_cell = random_attitudes(cells, groups.group_of_view[usable], count, rng)
    drawn = noisy_draws(mesh, sensor, R_cam_obj, of_cell, rng)
    group = group_of_label(groups, drawn.face_area)
    shown = np.bincount(group, minlength=groups.group_count)
    group = np.where(shown[drawn.group] == 0, drawn.group, group)
    return drawn.regrouped(np.where(groups.pruned[group], -1, group))


def random_attitudes(
    triangles: Float[np.ndarray, "cells 3 3"], group: Int[np.ndarray, "cells"], count: int, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "draws 3 3"], Int[np.ndarray, "draws"]]:
    """`count` attitudes of every group: a random point of a random cell of the group, turned at random about the line
    of sight. The appearances are cast at the middle of the cells, which no real part keeps to.
    """
    cell = np.concatenate([rng.choice(np.flatnonzero(group == g), count) for g in np.unique(group)])
    corner = rng.dirichlet(np.ones(3), len(cell))  # uniform over a triangle
    direction = np.einsum("dc,dcx->dx", corner, triangles[cell])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    roll = rng.uniform(0.0, 2.0 * np.pi, len(cell))
    return roll_rotation(roll) @ camera_rotation(direction), group[cell]


def noisy_draws(
    mesh: RayMesh, sensor: Sensor, R_cam_obj: Float[np.ndarray, "draws 3 3"], group: Int[np.ndarray, "draws"],
    rng: np.random.Generator, cut: bool = True,
) -> Draws:
    """Renders, adds noise, solves and measures the largest region of every draw; with `cut`, every second draw stands
    beside another one.

    Raises ItreeError when none shows a region: the sensor's noise hides the part.
    """
    reach = mesh_reach(mesh)
    camera, pitch = window_camera(reach)
    order = rng.permutation(len(R_cam_obj))  # a neighbour is a view of any group
    batches = [order[first : first + VIEWS_AT_ONCE] for first in range(0, len(order), VIEWS_AT_ONCE)]

    def of_batch(item: tuple[np.ndarray, np.random.Generator]) -> list[_Target]:
        return _targets(mesh, sensor, R_cam_obj, item[0], camera, pitch, reach, cut, item[1])

    found: list[_Target] = []

    def windows() -> Iterator[PixelMaps]:
        each = zip(batches, rng.spawn(len(batches)), strict=True)
        for batch in streamed(of_batch, each):
            for t in batch:
                found.append(t._replace(regions=[r.without_pixels() for r in t.regions], pixels=NOTHING))
                yield t.pixels

    features = measured(windows(), pitch, sensor_needle_deviation(sensor))
    if not found:
        raise ItreeError(
            f"Under the sensor's noise ({sensor.noise}) none of {len(R_cam_obj)} views of the part shows a region. "
            "Check the noise of the sensor, or lower its smallest region."
        )
    in_order = np.argsort([t.index for t in found])
    found = [found[k] for k in in_order]
    features = jax.tree.map(lambda a: a[in_order], features)
    index = np.array([t.index for t in found])
    beside = first_brothers([t.regions for t in found], np.asarray(features.inertia.alpha), BESIDE_REACH * reach)
    return Draws(
        with_brothers(features, beside), group[index], R_cam_obj[index], np.array([t.cut for t in found]),
        np.array([t.face_area for t in found]), len(R_cam_obj) - len(found),
    )


class _Target(NamedTuple):
    """The target region of one draw, first among the regions beside it."""

    index: int  # of the draw
    regions: list[Region]
    pixels: PixelMaps
    face_area: Float[np.ndarray, "faces"]
    cut: bool


def _targets(
    mesh: RayMesh, sensor: Sensor, R_cam_obj: Float[np.ndarray, "draws 3 3"], batch: Int[np.ndarray, "views"],
    camera: Camera, pitch: float, reach: float, cut: bool, rng: np.random.Generator,
) -> list[_Target]:
    """The draws of one batch that show a region."""
    R = R_cam_obj[batch]
    shapes = cast_apparent_shapes(mesh, R, np.zeros((len(R), 3)), camera, sensor.light_directions, sensor.slant_limit)
    views = alone(shapes)
    is_cut = (np.arange(len(R)) % 2 == 1) & cut & (len(R) > 1)
    if is_cut.any():
        beside = with_neighbours(views, sensor.light_directions, pitch, reach, rng)
        views = either(is_cut, beside, views)
    there, depth, normal, lit, own_pixels = map(np.asarray, views)
    images = noisy(window_images(there, normal, lit, sensor), sensor, int(rng.integers(2**31)))
    detectable, needles = np.zeros(there.shape, bool), np.zeros(normal.shape, np.float32)
    if sensor.is_depth_camera:
        detectable, needles = depth_camera_needles(there, normal, pitch, sensor, rng)
    else:
        detectable[there], needles[there] = read(images[:, there], sensor)
    edges, areas = edges_of(np.moveaxis(images, 0, 1), sensor), face_areas(shapes, mesh, pitch)
    least = sensor.smallest_region / pitch**2
    found = []
    for k in range(len(R)):
        own = largest_regions(detectable[k] & own_pixels[k], least)
        if own:
            foreign = largest_regions(detectable[k] & ~own_pixels[k], least, most=1)
            regions = [describe_region(m, needles[k], depth[k], camera) for m in (*own, *foreign)]
            pixels = pixels_of(own[0], needles[k], edges[k])
            found.append(_Target(int(batch[k]), regions, pixels, areas[k], bool(is_cut[k])))
    return found


def first_brothers(
    regions: list[list[Region]], alpha: Float[np.ndarray, "n"], reach: float
) -> Float[np.ndarray, "n most fields"]:
    """What stands beside the first region of every list."""
    found = []
    for one, direction in zip(regions, np.asarray(alpha), strict=True):
        centre, normal = np.array([r.centre for r in one]), np.array([r.normal for r in one])
        angles = np.full(len(one), direction)  # only the first region's own counts
        found.append(brothers(centre, normal, angles, np.array([r.area for r in one]), reach)[0])
    return np.array(found).reshape(-1, MOST_BROTHERS, found[0].shape[-1])
