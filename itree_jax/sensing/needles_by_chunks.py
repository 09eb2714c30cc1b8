"""The needle map of one image, chunks of its pixels side by side: on all cores, and with one compiled program whatever
the size of the image.
"""

import jax
import numpy as np
from jaxtyping import Float

from itree_jax.batches import multiple_above, on_all_cores
from itree_jax.sensing.albedo import confidence_of_pixels, dominant_of_maps
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.photometric import needle_map, read_pixels
from itree_jax.sensing.pixel_row import as_map, as_row
from itree_jax.sensor import Sensor

CHUNK = 5 * 4096  # pixels: about what every fourth row and column of 640 x 480 has


def needle_map_on_host(
    images: Float[np.ndarray, "lights height width"], sensor: Sensor, depth: Float[np.ndarray, "height width"] | None
) -> NeedleMap:
    """`needle_map` of one image, as NumPy arrays. Raises `ItreeError` as it does.

    Lights that stand near have another direction at each pixel: their images are read as a whole.
    """
    if sensor.light_positions is not None:
        return NeedleMap(*(np.asarray(a) for a in needle_map(images, sensor, depth)))
    height, width = images.shape[-2:]
    row = as_row(np.asarray(images), multiple_above(height * width, CHUNK))
    chunks = [slice(first, first + CHUNK) for first in range(0, row.shape[-1], CHUNK)]
    lights = sensor.light_directions, sensor.light_intensities

    def read(chunk: slice) -> tuple[NeedleMap, np.ndarray]:
        some = np.ascontiguousarray(row[..., chunk])
        return jax.device_get(read_pixels(some, *lights, sensor.noise, sensor.slant_limit))

    read_of = on_all_cores(read, chunks)
    albedo, interpretable = (
        as_map(np.concatenate([getattr(needle, name) for needle, _ in read_of], axis=-1), height, width)
        for name in ("albedo", "interpretable")
    )
    dominant = dominant_of_maps(albedo, interpretable)

    def with_confidence(one: tuple[NeedleMap, np.ndarray]) -> NeedleMap:
        needle, std = one
        found = confidence_of_pixels(needle.albedo, std, needle.interpretable, dominant)
        return needle._replace(confidence=np.asarray(found))

    parts = on_all_cores(with_confidence, read_of)
    normals = np.concatenate([needle.normals for needle in parts], axis=1)
    maps = (np.concatenate(of_chunks, axis=-1) for of_chunks in zip(*(needle[1:] for needle in parts), strict=True))
    return NeedleMap(
        normals[0, : height * width].reshape(height, width, 3), *(as_map(a, height, width) for a in maps)
    )
