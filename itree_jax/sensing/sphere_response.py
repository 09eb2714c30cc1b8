"""The material's response from a sphere of the material, as Ikeuchi's lookup tables were measured."""

import numpy as np
from jaxtyping import Float

from itree_jax.sensing.light_calibration.sphere import Sphere
from itree_jax.sensing.material_response import MaterialResponse, fit_response
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.photometric import needle_map
from itree_jax.sensor import Sensor


def response_of_sphere(
    images: Float[np.ndarray, "lights height width"], sensor: Sensor, sphere: Sphere
) -> MaterialResponse:
    """The response of the material of a sphere whose place is known, under the sensor's lights.

    It reads needle maps of other things of that material, in other images of the same sensor (`apply_response`). Under
    a pinhole the viewing direction is another at each pixel, which the map leaves out: take the sphere where parts lie.
    """
    needle = NeedleMap(*(np.asarray(a) for a in needle_map(images, sensor)))
    v, u = np.indices(images.shape[-2:])
    _, normals, _ = sphere.at(np.stack([u, v], axis=-1).astype(np.float64))
    known = np.isfinite(normals[..., 2])
    return fit_response(needle, np.where(known[..., None], normals, 0.0), known)
