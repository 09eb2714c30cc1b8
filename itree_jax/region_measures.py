"""Work models of an image's regions, as the trees read them."""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from itree_jax.features.region import RegionFeatures, measure_batch, with_brothers
from itree_jax.features.relation import brothers
from itree_jax.features.window import Window, extract_images, extract_windows
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.regions import Regions
from itree_jax.sensor import Sensor
from itree_jax.tree.appearances import WINDOW_SIZE
from itree_jax.tree.sights import sensor_needle_deviation, window_edges

REGION_BATCH = 16  # regions are padded to a multiple, so that few shapes are compiled


class Measured(NamedTuple):
    """All regions of one image in windows of one pitch, brothers not yet looked for."""

    features: RegionFeatures  # padded to a batch by repeating the first region
    R_ray_cam: Float[np.ndarray, "regions 3 3"]


def measure_regions(
    found: Regions, needle: NeedleMap, images: Float[np.ndarray, "lights height width"], sensor: Sensor, pitch: float
) -> Measured:
    """Work models of all regions in windows of this pitch [mm]."""
    normals = np.asarray(needle.normals, np.float32)
    windows, R_ray_cam = extract_windows(
        found.labels, normals, np.arange(found.count), found.centroid_uv, found.mean_depth, sensor.camera, pitch,
        WINDOW_SIZE,
    )
    seen = extract_images(
        images / sensor.light_intensities[:, None, None].astype(np.float32), found.centroid_uv, found.mean_depth,
        sensor.camera, pitch, WINDOW_SIZE,
    )
    rows = padded_rows(np.arange(found.count))
    edges = window_edges(seen[rows], sensor.noise)
    windows = Window(*(np.asarray(a)[rows] for a in windows))
    return Measured(measure_batch(windows, edges, np.float32(sensor_needle_deviation(sensor))), R_ray_cam)


def padded_rows(index: Int[np.ndarray, "n"]) -> Int[np.ndarray, "padded"]:
    """The indices, the first one repeated up to a multiple of `REGION_BATCH`."""
    return np.concatenate([index, np.repeat(index[:1], -len(index) % REGION_BATCH)])


def features_of(
    measured: Measured, asked: Int[np.ndarray, "asked"], found: Regions, sensor: Sensor, reach: float
) -> RegionFeatures:
    """Work models of some of the regions (padded to a batch), with the regions that lie within reach of each [mm]."""
    rows = padded_rows(asked)
    features = jax.tree.map(lambda a: np.asarray(a)[rows], measured.features)
    beside = brothers_in_scene(found, measured, asked, sensor, reach)
    return with_brothers(features, beside[padded_rows(np.arange(len(asked)))])


def brothers_in_scene(
    found: Regions, measured: Measured, asked: Int[np.ndarray, "asked"], sensor: Sensor, reach: float
) -> Float[np.ndarray, "asked most fields"]:
    """Other regions of the image within reach of each that is asked for [mm], in the frame of its viewing ray."""
    features, R_ray_cam, count = measured.features, measured.R_ray_cam, found.count
    X_cam = sensor.camera.unproject(found.centroid_uv, found.mean_depth)
    normal_ray, area = np.asarray(features.mean_normal)[:count], np.asarray(features.area)[:count]
    normal_cam = np.einsum("rca,rc->ra", R_ray_cam, normal_ray)
    alpha = np.asarray(features.inertia.alpha)[:count]
    found_of = [
        brothers(X_cam @ R_ray_cam[k].T, normal_cam @ R_ray_cam[k].T, np.full(count, alpha[k]), area, reach)[k]
        for k in asked
    ]
    return np.stack(found_of)
