"""Regions: connected pieces of surface that the needle map tells about (Ikeuchi 1987, sec. 4.2).

A region is an 8-connected set of interpretable pixels within the slant limit, cut at depth discontinuities, or where
there is no depth map at edges between surfaces (`region_cuts`), and larger than the sensor's smallest region. Floor and
bin make regions too: what a region belongs to is for recognition to say.
"""

from dataclasses import dataclass, fields

import cv2
import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Bool, Float, Int

from itree_jax.sensing.connected import NO_REGION, connected, cut_links
from itree_jax.sensing.depth_steps import depth_noise as depth_noise
from itree_jax.sensing.edges import SceneEdges
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.region_cuts import WITH_DEPTH, WITHOUT_DEPTH, Cuts, parting
from itree_jax.sensing.slant_limit import detectable
from itree_jax.sensor import Sensor

HEIGHT_PERCENTILE = 90.0  # the top of a region, without its few highest (noisiest) pixels


@dataclass(frozen=True)
class Regions:
    """The regions of one image, the highest first. NaN where there is no depth."""

    labels: Int[np.ndarray, "height width"]  # int32: index of the region, NO_REGION where none
    area_px: Int[np.ndarray, "regions"]
    area_mm2: Float[np.ndarray, "regions"]  # in the image plane, at the region's depth (else the working distance)
    centroid_uv: Float[np.ndarray, "regions 2"]  # [px]
    mean_normal: Float[np.ndarray, "regions 3"]  # unit, camera frame
    mean_depth: Float[np.ndarray, "regions"]  # z [mm]
    height: Float[np.ndarray, "regions"]  # [mm] above the plane at the working distance: 90th percentile
    bbox: Int[np.ndarray, "regions 4"]  # x, y, width, height [px]

    @property
    def count(self) -> int:
        return len(self.area_px)

    def take(self, kept: Int[np.ndarray, "kept"]) -> "Regions":
        """Some of the regions, numbered anew."""
        number = np.full(self.count + 1, NO_REGION, np.int32)  # the last one for NO_REGION itself
        number[kept] = np.arange(len(kept))
        rest = (getattr(self, f.name)[kept] for f in fields(self)[1:])
        return Regions(number[self.labels], *rest)

    def mask(self, region: int) -> Bool[np.ndarray, "height width"]:
        return self.labels == region


def regions(
    needle: NeedleMap,
    depth: Float[np.ndarray, "height width"] | None,
    sensor: Sensor,
    R_w2c: Float[np.ndarray, "3 3"] | None = None,
    edges: SceneEdges | None = None,
    cuts: Cuts | None = None,
    lit: Bool[np.ndarray, "height width"] | None = None,
) -> Regions:
    """The regions of a needle map, sorted by falling height. Runs on the host.

    `depth` is z [mm], 0 = none. Height is measured along the world's z axis if `R_w2c` (world z up) is given, else
    toward the camera, from the plane that the optical axis meets at the working distance. Without a depth map nothing
    is cut by depth, height and depth are NaN, and the largest region comes first: give the scene's `edges`
    (`sensing.edges.scene_edges`), or regions of several parts run together. `cuts` says which of them part regions;
    None: `WITHOUT_DEPTH` or `WITH_DEPTH`. Where a part touches a dark wall neither depth nor edge need tell them apart:
    no region has pixels that are `lit` and others. Raises `ItreeError` if the sizes of needle map, depth map and region
    of interest differ.
    """
    normals = np.asarray(needle.normals)
    _check_sizes(normals, depth, sensor)
    mask = detectable(needle, sensor)
    cuts = cuts or (WITHOUT_DEPTH if depth is None else WITH_DEPTH)
    labels = connected(mask, depth, sensor, None if edges is None else _links_cut(edges, cuts, mask), lit)
    depth = np.full(mask.shape, np.nan) if depth is None else np.where(depth > 0.0, depth, np.nan).astype(np.float64)
    members = _members(labels, _least_pixels(depth, sensor))
    found = [_describe(pixels, normals, depth, sensor, R_w2c) for pixels in members]
    kept = [k for k, region in enumerate(found) if region["area_mm2"] >= sensor.smallest_region]
    # NaN (no depth) last; then the larger, then the first in the image.
    kept.sort(key=lambda k: (-np.nan_to_num(found[k]["height"], nan=-np.inf), -found[k]["area_px"], k))
    return Regions(
        labels=_relabelled(mask.shape, [members[k] for k in kept]),
        area_px=np.array([found[k]["area_px"] for k in kept], dtype=np.int64),
        area_mm2=np.array([found[k]["area_mm2"] for k in kept], dtype=np.float64),
        centroid_uv=np.array([found[k]["centroid_uv"] for k in kept], dtype=np.float64).reshape(-1, 2),
        mean_normal=np.array([found[k]["mean_normal"] for k in kept], dtype=np.float64).reshape(-1, 3),
        mean_depth=np.array([found[k]["mean_depth"] for k in kept], dtype=np.float64),
        height=np.array([found[k]["height"] for k in kept], dtype=np.float64),
        bbox=np.array([found[k]["bbox"] for k in kept], dtype=np.int64).reshape(-1, 4),
    )


def added(
    found: Regions,
    segments: Int[np.ndarray, "height width"],
    normals: Float[np.ndarray, "height width 3"],
    depth: Float[np.ndarray, "height width"],
    sensor: Sensor,
    R_w2c: Float[np.ndarray, "3 3"] | None = None,
) -> Regions:
    """The regions, and after them further pieces of surface: pixels of equal positive label, if they are large enough.

    `normals` tell which way the new ones face (0 = unknown), `depth` z [mm] (0 = none) where they lie.
    """
    z = np.where(depth > 0.0, depth, np.nan).astype(np.float64)
    members = _members(np.where(segments > 0, segments, NO_REGION), _least_pixels(z, sensor))
    if not members:
        return found
    new = [(pixels, _describe(pixels, normals, z, sensor, R_w2c)) for pixels in members]
    new = [(pixels, region) for pixels, region in new if region["area_mm2"] >= sensor.smallest_region]
    labels = found.labels.copy()
    for k, (pixels, _) in enumerate(new):
        labels.flat[pixels] = found.count + k
    joined = {
        name: np.concatenate([getattr(found, name), np.array([region[name] for _, region in new]).reshape(
            -1, *getattr(found, name).shape[1:]).astype(getattr(found, name).dtype)])
        for name in ("area_px", "area_mm2", "centroid_uv", "mean_normal", "mean_depth", "height", "bbox")
    }  # fmt: skip
    return Regions(labels=labels, **joined)


def _links_cut(
    edges: SceneEdges, cuts: Cuts, mask: Bool[np.ndarray, "height width"]
) -> Bool[np.ndarray, "neighbours height width"] | None:
    """Links that the parting edges cross; of these only the ones beside the mask are looked at."""
    near = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    u, v = np.round(edges.uv).astype(int).T
    part = parting(edges, cuts) & near[v, u]
    return cut_links(edges.uv[part], edges.direction[part], mask.shape) if part.any() else None


def _check_sizes(normals: np.ndarray, depth: np.ndarray | None, sensor: Sensor) -> None:
    shape = (sensor.camera.height, sensor.camera.width)
    if normals.shape != (*shape, 3):
        raise ItreeError(f"the needle map has shape {normals.shape}, the sensor's images {shape}; give one at a time")
    if depth is not None and depth.shape != shape:
        raise ItreeError(f"the depth map has shape {depth.shape}, the sensor's images {shape}")
    if sensor.region_of_interest is not None and sensor.region_of_interest.shape != shape:
        raise ItreeError(f"the region of interest has shape {sensor.region_of_interest.shape}, the images {shape}")


def _least_pixels(depth: Float[np.ndarray, "height width"], sensor: Sensor) -> float:
    """Fewer pixels are no region even at the greatest depth."""
    greatest = np.nanmax(depth) if np.isfinite(depth).any() else sensor.working_distance
    return sensor.smallest_region / sensor.camera.mm_per_px(float(greatest)) ** 2


def _members(labels: Int[np.ndarray, "height width"], least_pixels: float) -> list[np.ndarray]:
    """Flat pixel indices of each label that has enough of them, in image order."""
    flat = labels.ravel()
    inside = np.flatnonzero(flat >= 0)
    order = inside[np.argsort(flat[inside], kind="stable")]
    ends = np.flatnonzero(np.diff(flat[order])) + 1
    return [pixels for pixels in np.split(order, ends) if pixels.size and pixels.size >= least_pixels]


def _heights(
    uv: Int[np.ndarray, "pixels 2"], z: Float[np.ndarray, "pixels"], sensor: Sensor,
    R_w2c: Float[np.ndarray, "3 3"] | None,
) -> Float[np.ndarray, "pixels"]:
    """Of points at depth z [mm], above the plane at the working distance [mm]."""
    up = np.array([0.0, 0.0, -1.0]) if R_w2c is None else R_w2c[:, 2]
    return (sensor.camera.unproject(uv.astype(np.float64), z) - np.array([0.0, 0.0, sensor.working_distance])) @ up


def _describe(
    pixels: Int[np.ndarray, "pixels"], normals: np.ndarray, depth: np.ndarray, sensor: Sensor,
    R_w2c: Float[np.ndarray, "3 3"] | None,
) -> dict:
    v, u = np.unravel_index(pixels, depth.shape)
    z = depth[v, u]
    known = np.isfinite(z)
    mean_depth = float(z[known].mean()) if known.any() else np.nan
    total = normals[v, u].sum(axis=0, dtype=np.float64)
    scale = sensor.camera.mm_per_px(mean_depth if known.any() else sensor.working_distance)
    heights = _heights(np.stack([u, v], axis=-1)[known], z[known], sensor, R_w2c)
    return {
        "area_px": len(pixels),
        "area_mm2": len(pixels) * scale**2,
        "centroid_uv": (u.mean(), v.mean()),
        "mean_normal": total / np.linalg.norm(total),
        "mean_depth": mean_depth,
        "height": float(np.percentile(heights, HEIGHT_PERCENTILE)) if known.any() else np.nan,
        "bbox": (u.min(), v.min(), np.ptp(u) + 1, np.ptp(v) + 1),
    }


def _relabelled(shape: tuple[int, ...], members: list[np.ndarray]) -> Int[np.ndarray, "height width"]:
    labels = np.full(shape, NO_REGION, dtype=np.int32)
    for k, pixels in enumerate(members):
        labels.flat[pixels] = k
    return labels
