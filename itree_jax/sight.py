"""What one image shows, whatever part is looked for: regions, needles, depth and edges, of one camera or of two."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from itree_kernels.scene_maps import SeenBy
from jaxtyping import Bool, Float, Int

from itree_jax.batches import at_once
from itree_jax.kept_functions import on_device
from itree_jax.refinement.observed import NO_PART, ObservedMaps, filled_up, observe, observe_with_edges, seen_by
from itree_jax.refinement.optimise import OtherView
from itree_jax.refinement.schedule import NEEDLE_BIAS, NEEDLE_PIXEL, Schedule, depth_jump, schedule
from itree_jax.sensing.albedo import dominant_albedo
from itree_jax.sensing.depth_needles import DepthNeedles, depth_needles
from itree_jax.sensing.edges import SceneEdges, scene_edges
from itree_jax.sensing.folded_regions import parted_at_folds
from itree_jax.sensing.lit import lit_by_any
from itree_jax.sensing.material_response import MaterialResponse
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.reading import corrected, first_needles, read_needles
from itree_jax.sensing.regions import Regions, depth_noise, regions
from itree_jax.sensing.segments import HeldBy, held_by
from itree_jax.sensor import Sensor
from itree_jax.stereo.dual_stereo import WINDOW, Found, dual_photometric_stereo
from itree_jax.stereo.second_camera import SecondCamera

STEREO_NOISE = 0.1  # [mm] of one pixel beside its neighbours: needles carry depth from pixel to pixel
EDGE_REACH = 2.0  # [px] within which an edge is a contour's: half a pixel each of either's error, and the refinement's
CREASE = np.radians(25.0)  # a surface that turns by less is a curved one's facets


class ReadFrom(NamedTuple):
    """The images of two cameras, and their needle maps before anything is known of the material's response."""

    images: Float[np.ndarray, "lights height width"]
    second: SecondCamera
    needles: tuple[NeedleMap, NeedleMap]


@dataclass(frozen=True)
class Sight:
    """What one image shows, whatever part is looked for."""

    found: Regions  # of surface as bright as the parts, where that is told
    needle: NeedleMap
    observed: ObservedMaps
    held: HeldBy  # by the surface that hangs together with each region; without depth, by themselves
    noise: float  # of the depth map [mm]
    sensor: Sensor
    shared: float | None = None  # [mm] what neighbours' depths are off by together; None: as a depth camera's are
    others: tuple[OtherView, ...] = ()
    edge_reach: float = 0.0  # [px] of contours' edges in the images; 0: contours end where depth does
    beside: tuple[NeedleMap, ...] = ()  # needle maps of the other cameras
    crease: float | None = None  # [rad] from which on creases of the model are contours too
    depth: Float[np.ndarray, "height width"] | None = None  # [mm] that regions are placed by, 0 = none
    soft_depth: Float[np.ndarray, "height width"] | None = None  # [mm] also where two cameras only matched windows
    coarse: ObservedMaps | None = None  # what rough poses are held against: soft depth is good enough, floor is none
    faces_told: bool = True  # regions' needles tell which way they face
    edges: SceneEdges | None = None  # that part regions where there is no depth, or a soft one
    R_w2c: Float[np.ndarray, "3 3"] | None = None
    of_depth: DepthNeedles | None = None  # what the depth map alone tells of the surface
    lit: Bool[np.ndarray, "height width"] | None = None  # a light shows the parts' material; None: not told
    dark: Regions | None = None  # of bin and floor; None: not told
    stereo: Found | None = None  # what two cameras found, for a later look to begin from
    read_from: ReadFrom | None = None  # likewise

    @property
    def kind(self) -> str:
        """Where depth comes from: "depth" (a map), "stereo" (a second camera) or "none"."""
        return "depth" if self.edge_reach == 0.0 else "stereo" if self.others else "none"

    @cached_property
    def held_against(self) -> SeenBy:
        """What poses are held against, as the kernels read it."""
        return seen_by(self.observed, self.sensor.camera)

    @cached_property
    def roughly_held_against(self) -> SeenBy:
        """The same of rough poses."""
        return self.held_against if self.coarse is None else seen_by(self.coarse, self.sensor.camera)

    @cached_property
    def measured_against(self) -> ObservedMaps:
        """What the covariance of poses is measured by."""
        return filled_up(self.observed)

    def of(
        self, found: Regions, needle: NeedleMap, depth: Float[np.ndarray, "height width"] | None,
        segments: Int[np.ndarray, "height width"] | None = None,
    ) -> "Sight":
        """The same scene with other regions, placed by this depth map [mm]; what poses are held against stays.

        `segments`: those of the depth map, if they are known already.
        """
        alone = depth is None
        held = by_themselves(found, self.sensor) if alone else held_by(found.labels, depth, self.sensor, segments)
        return replace(self, found=found, needle=needle, held=held)

    def parted(self, longest: float) -> "Sight":
        """The same scene, regions of several parts cut at folds where a depth map tells that they are; `longest` [mm]:
        the diameter of the largest part.
        """
        if self.kind != "depth" or self.depth is None:
            return self
        normals = np.asarray(self.needle.normals)
        found = parted_at_folds(self.found, normals, self.depth, self.sensor, longest, self.R_w2c)
        return self if found is self.found else self.of(found, self.needle, self.depth)

    def plan(self, diameter: float, spacing: float) -> Schedule:
        """The rounds of refinement for a part of this diameter [mm] and a dome of this spacing [rad]."""
        return schedule(self.sensor, diameter, self.noise, spacing, self.shared, self.edge_reach)


def look(
    images: Float[np.ndarray, "lights height width"],
    sensor: Sensor,
    depth: Float[np.ndarray, "height width"] | None,
    R_w2c: Float[np.ndarray, "3 3"] | None = None,
    second: SecondCamera | None = None,
    responses: Sequence[MaterialResponse | None] = (None, None),
    before: Sight | None = None,
) -> Sight:
    """Looks at one image under each light, with a depth map [mm] (0 = none), a second camera, or neither.

    `responses` of the material, as each camera sees it, if they are known. `before`: an earlier look at the same scene;
    with two cameras depth goes on from there.

    Raises `ItreeError` as `dual_photometric_stereo` does.
    """
    if depth is None and second is None:
        return look_with_one(images, sensor, R_w2c, responses[0])
    if depth is None:
        assert second is not None
        return look_with_two(images, sensor, second, R_w2c, responses, before)
    depth = np.asarray(depth, np.float32)
    noise = depth_noise(depth, depth > 0)

    def of_surface() -> DepthNeedles | None:
        return None if sensor.is_depth_camera else depth_needles(depth, sensor.camera, noise)

    needle, of_depth = at_once(lambda: first_needles(images, sensor, depth), of_surface)
    needle = corrected(needle, sensor, depth, responses[0], of_depth)
    lit = lit_by_any(images, sensor, needle)

    def found_and_held() -> tuple[Regions, Regions | None, HeldBy]:
        found, dark = by_light(regions(needle, depth, sensor, R_w2c, lit=lit), lit)
        return found, dark, held_by(found.labels, depth, sensor)

    def seen() -> ObservedMaps:
        observed = observe(*believed(needle), depth, depth_jump(sensor.camera, sensor.working_distance, noise))
        return observed if sensor.is_depth_camera else with_shading(observed, images, sensor, needle)

    (found, dark, held), observed = at_once(found_and_held, seen)
    return Sight(
        found, needle, observed, held, noise, sensor, depth=depth, R_w2c=R_w2c, of_depth=of_depth, lit=lit, dark=dark,
        coarse=None if lit is None else without_dark(observed, needle, lit),
    )


def look_with_two(
    images: Float[np.ndarray, "lights height width"],
    sensor: Sensor,
    second: SecondCamera,
    R_w2c: Float[np.ndarray, "3 3"] | None = None,
    responses: Sequence[MaterialResponse | None] = (None, None),
    before: Sight | None = None,
) -> Sight:
    """Dual photometric stereo instead of a depth map: depth where needles are, edges from the images of both cameras.

    Depth where no needle leads is a block matcher's: good enough to see and to lead rough poses, too soft at steps for
    a pose to be judged by.
    """

    read = read_from(images, sensor, second, before)
    needle, other = at_once(
        lambda: corrected(read.needles[0], sensor, None, responses[0], None),
        lambda: corrected(read.needles[1], second.sensor, None, responses[1], None),
    )

    def each_alone() -> tuple[SceneEdges, ObservedMaps]:
        beside = observe_images(
            second.images, second.sensor, other, np.zeros(other.albedo.shape, np.float32),
            scene_edges(second.images, second.sensor, other),
        )  # fmt: skip
        return scene_edges(images, sensor, needle), beside

    found_before = None if before is None else before.stereo
    stereo, (edges, beside) = at_once(
        lambda: dual_photometric_stereo(images, sensor, second, responses[0], found_before, needle), each_alone
    )
    depth = np.where(stereo.by_needles, stereo.depth, np.float32(0.0))
    placed = needle._replace(interpretable=np.asarray(needle.interpretable) & (depth > 0))
    lit = lit_by_any(images, sensor, needle)
    found, dark = by_light(regions(placed, depth, sensor, R_w2c, lit=lit), lit)
    observed = observe_images(images, sensor, needle, away_from_steps(depth, sensor), edges)
    soft = np.where((depth == 0.0) & (lit is None or lit), stereo.depth, depth)
    coarse = observed._replace(depth=on_device(soft, np.float32))
    coarse = coarse if lit is None else without_dark(coarse, needle, lit)
    view = OtherView(beside, second.sensor.camera, second.R_second_first, second.t_second_first)
    return Sight(
        found, placed, observed, held_by(found.labels, depth, sensor), STEREO_NOISE, sensor,
        shared=stereo.std, others=(view,), edge_reach=EDGE_REACH, beside=(other,), crease=CREASE, depth=depth,
        soft_depth=stereo.depth, coarse=coarse, edges=edges, R_w2c=R_w2c, lit=lit, dark=dark,
        stereo=stereo.found, read_from=read,
    )  # fmt: skip


def read_from(
    images: Float[np.ndarray, "lights height width"], sensor: Sensor, second: SecondCamera, before: Sight | None
) -> ReadFrom:
    """Both cameras' needle maps; those of an earlier look at the same images are good still."""
    known = None if before is None else before.read_from
    if known is not None and known.images is images and known.second is second:
        return known
    needles = at_once(
        lambda: first_needles(images, sensor, None), lambda: first_needles(second.images, second.sensor, None)
    )
    return ReadFrom(images, second, needles)


def away_from_steps(depth: Float[np.ndarray, "height width"], sensor: Sensor) -> Float[np.ndarray, "height width"]:
    """A depth map of matched windows [mm] (0 = none) without what lies within half a window of its steps.

    Where one of two parallel faces hides part of the other no light shows the border: windows that see both go with
    either, and needles carry that on. On which side such a pixel lies is not known.
    """
    there = depth > 0.0
    around = np.ones((3, 3), np.uint8)
    farthest = cv2.dilate(depth, around)
    nearest = cv2.erode(np.where(there, depth, np.float32(np.inf)), around)
    jump = depth_jump(sensor.camera, sensor.working_distance, STEREO_NOISE)
    step = there & (farthest - nearest > jump)
    unsure = cv2.dilate(step.astype(np.uint8), np.ones((WINDOW, WINDOW), np.uint8)) > 0
    return np.where(unsure, np.float32(0.0), depth)


def look_with_one(
    images: Float[np.ndarray, "lights height width"],
    sensor: Sensor,
    R_w2c: Float[np.ndarray, "3 3"] | None = None,
    response: MaterialResponse | None = None,
) -> Sight:
    """One camera and no depth: regions are taken to lie at the working distance until a pose says otherwise.

    Under a pinhole the size of a part tells how far it is, from its outline's and creases' edges: 1 % of size is 1 % of
    distance, so that half a pixel on the radius of a part 70 pixels wide is 13 mm at 900 mm. Under an orthographic
    camera nothing tells, and nothing depends on it.
    """
    needle = read_needles(images, sensor, None, response)
    edges = scene_edges(images, sensor, needle)
    lit = lit_by_any(images, sensor, needle)
    found = regions(needle, None, sensor, R_w2c, edges, lit=lit)
    level = np.full(found.count, sensor.working_distance)
    found = replace(found, mean_depth=level, height=np.zeros(found.count))  # nothing tells which one is higher
    found, dark = by_light(found, lit)
    none = np.zeros(np.asarray(needle.albedo).shape, np.float32)
    return Sight(
        found, needle, observe_images(images, sensor, needle, none, edges), by_themselves(found, sensor),
        STEREO_NOISE, sensor, edge_reach=EDGE_REACH, crease=CREASE, edges=edges, R_w2c=R_w2c, lit=lit, dark=dark,
    )


def by_themselves(found: Regions, sensor: Sensor) -> HeldBy:
    """Regions of which nothing tells what hangs together with them."""
    centre = sensor.camera.unproject(found.centroid_uv, found.mean_depth)
    return HeldBy(np.arange(found.count), np.asarray(found.area_mm2), centre, np.zeros(found.count))


def by_light(found: Regions, lit: Bool[np.ndarray, "height width"] | None) -> tuple[Regions, Regions | None]:
    """Regions that a light shows, and those of dark bin and floor, which no part is looked for in."""
    if lit is None:
        return found, None
    inside = found.labels >= 0
    bright = np.bincount(found.labels[inside], lit[inside], minlength=found.count) > 0
    return found.take(np.flatnonzero(bright)), found.take(np.flatnonzero(~bright))


def observe_images(
    images: Float[np.ndarray, "lights height width"], sensor: Sensor, needle: NeedleMap,
    depth: Float[np.ndarray, "height width"], edges: SceneEdges,
) -> ObservedMaps:
    """What a camera's images show beside its needles: edges, and shading by the parts' albedo."""
    observed = observe_with_edges(*believed(needle), depth, edges)
    return with_shading(observed, images, sensor, needle)


def with_shading(
    observed: ObservedMaps, images: Float[np.ndarray, "lights height width"], sensor: Sensor, needle: NeedleMap
) -> ObservedMaps:
    """Intensities over the lights' strengths and the parts' albedo: n . l on a lit Lambertian surface."""
    albedo = float(dominant_albedo(needle)) or 1.0
    shading = np.moveaxis(images / (albedo * sensor.light_intensities[:, None, None]), 0, -1)
    return observed._replace(
        shading=on_device(shading, np.float32), light_directions=on_device(sensor.light_directions, np.float32)
    )


def without_dark(
    observed: ObservedMaps, needle: NeedleMap, lit: Bool[np.ndarray, "height width"]
) -> ObservedMaps:
    """What rough poses are held against: a surface that three lights reach and none shows is bin or floor. Rough poses
    are off by as much as flat parts are high, and would agree with what these lie on. Later rounds tell that by depth,
    and leave open what casts dark shadows on parts.
    """
    dark = np.asarray(needle.interpretable) & ~lit
    return observed._replace(
        needle_weight=on_device(np.where(dark, NO_PART, np.asarray(observed.needle_weight)), np.float32)
    )


def believed(needle: NeedleMap) -> tuple[Float[np.ndarray, "height width 3"], Float[np.ndarray, "height width"]]:
    """Needles, 0 where there are none, and how far each is believed: interpretable, bright as the material is, and less
    where noise and the model's error turn it by more than refinement reckons with.
    """
    interpretable = np.asarray(needle.interpretable)
    variance = np.square(needle.normal_std) + np.square(needle.normal_bias)
    reckoned = NEEDLE_PIXEL**2 + NEEDLE_BIAS**2
    weight = np.where(interpretable, needle.confidence * reckoned / np.maximum(variance, reckoned), 0.0)
    weight = weight.astype(np.float32)
    return np.asarray(needle.normals) * interpretable[..., None], weight
