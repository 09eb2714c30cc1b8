"""Work models of an image's regions, as the trees read them."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from itree_jax.batches import filled, on_all_cores
from itree_jax.features.region import RegionFeatures, measure_batch, with_brothers
from itree_jax.features.relation import brothers
from itree_jax.features.window import Window, extract_images, extract_windows
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.regions import Regions
from itree_jax.sensor import Sensor
from itree_jax.tree.appearances import WINDOW_SIZE
from itree_jax.tree.sights import sensor_needle_deviation, window_edges

REGION_BATCH = 4  # regions that a compiled function is given at a time


class Measured(NamedTuple):
    """All regions of one image in windows of one pitch, brothers not yet looked for."""

    features: RegionFeatures
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
    noise, deviation = sensor.noise, np.float32(sensor_needle_deviation(sensor))

    def measured(some: tuple[np.ndarray, Window]) -> RegionFeatures:
        images_of_some, windows_of_some = some
        return measure_batch(windows_of_some, window_edges(images_of_some, noise), deviation)

    return Measured(in_batches(measured, (seen, Window(*map(np.asarray, windows)))), R_ray_cam)


def in_batches(function: Callable[[Any], Any], regions: Any) -> Any:
    """What a compiled function makes of regions (leading axis of all arrays), `REGION_BATCH` at a time on all cores:
    whatever their number, one shape is compiled. Host arrays.
    """
    count = len(jax.tree.leaves(regions)[0])

    def of_batch(first: int) -> Any:
        some = jax.tree.map(lambda a: np.asarray(a)[first : first + REGION_BATCH], regions)
        return jax.device_get(function(filled(some, REGION_BATCH)))

    batches = on_all_cores(of_batch, range(0, count, REGION_BATCH))
    return jax.tree.map(lambda *parts: np.concatenate(parts)[:count], *batches)


def features_of(
    measured: Measured, asked: Int[np.ndarray, "asked"], found: Regions, sensor: Sensor, reach: float
) -> RegionFeatures:
    """Work models of some of the regions, with the regions that lie within reach of each [mm]."""
    features = jax.tree.map(lambda a: a[asked], measured.features)
    return with_brothers(features, brothers_in_scene(found, measured, asked, sensor, reach))


def brothers_in_scene(
    found: Regions, measured: Measured, asked: Int[np.ndarray, "asked"], sensor: Sensor, reach: float
) -> Float[np.ndarray, "asked most fields"]:
    """Other regions of the image within reach of each that is asked for [mm], in the frame of its viewing ray."""
    features, R_ray_cam, count = measured.features, measured.R_ray_cam, found.count
    X_cam = sensor.camera.unproject(found.centroid_uv, found.mean_depth)
    normal_cam = np.einsum("rca,rc->ra", R_ray_cam, features.mean_normal)
    area, alpha = np.asarray(features.area), features.inertia.alpha
    found_of = [
        brothers(X_cam @ R_ray_cam[k].T, normal_cam @ R_ray_cam[k].T, np.full(count, alpha[k]), area, reach)[k]
        for k in asked
    ]
    return np.stack(found_of)
