"""Reading the needle map of a scene: photometric stereo, and the response of the material where it is known."""

import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Float

from itree_jax.sensing.depth_camera import needles_of_depth
from itree_jax.sensing.depth_needles import DepthNeedles, depth_needles
from itree_jax.sensing.depth_steps import depth_noise
from itree_jax.sensing.material_response import MaterialResponse, apply_response, fit_response
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.needles_by_chunks import needle_map_on_host
from itree_jax.sensor import Sensor


def read_needles(
    images: Float[np.ndarray, "lights height width"],
    sensor: Sensor,
    depth: Float[np.ndarray, "height width"] | None,
    response: MaterialResponse | None = None,
    of_depth: DepthNeedles | None = None,
) -> NeedleMap:
    """The needle map of one image under each light, or of a depth camera's map, as NumPy arrays.

    A depth map [mm] (0 = none) tells normals too, coarsely but without a reflectance: what photometric stereo makes of
    the material is fitted to them (`material_response`), and used where that helps. A `response` that is known already
    is used instead, and so are the normals `of_depth`.
    """
    return corrected(first_needles(images, sensor, depth), sensor, depth, response, of_depth)


def first_needles(
    images: Float[np.ndarray, "lights height width"], sensor: Sensor, depth: Float[np.ndarray, "height width"] | None
) -> NeedleMap:
    """The needle map before anything is known of the material's response."""
    if not sensor.is_depth_camera:
        return needle_map_on_host(images, sensor, depth)
    if depth is None:
        raise ItreeError("a depth camera's needle map comes from its depth map, and there is none")
    return needles_of_depth(depth, sensor)


def corrected(
    needle: NeedleMap, sensor: Sensor, depth: Float[np.ndarray, "height width"] | None,
    response: MaterialResponse | None, of_depth: DepthNeedles | None,
) -> NeedleMap:
    """The needle map as the material's response reads it, where one is known or a depth map tells it."""
    if sensor.is_depth_camera:
        return needle
    if response is None and depth is not None:
        response = response_of_depth(needle, depth, sensor, of_depth)
    return needle if response is None else apply_response(needle, response)


def response_of_depth(
    needle: NeedleMap, depth: Float[np.ndarray, "height width"], sensor: Sensor, of_depth: DepthNeedles | None = None
) -> MaterialResponse:
    """The response of the material, fitted to the normals of a depth map [mm] (0 = none); they may be known already."""
    if of_depth is None:
        of_depth = depth_needles(depth, sensor.camera, depth_noise(depth, depth > 0))
    return fit_response(needle, of_depth.normals, of_depth.known)


def turned_back(
    needle: NeedleMap, R_needle_camera: Float[np.ndarray, "3 3"], response: MaterialResponse | None
) -> NeedleMap:
    """A needle map in another frame than the response's camera: turned, read by the response, and turned again."""
    if response is None:
        return needle
    own = needle._replace(normals=np.asarray(needle.normals) @ R_needle_camera)
    read = apply_response(own, response)
    return read._replace(normals=np.asarray(read.normals) @ R_needle_camera.T)
