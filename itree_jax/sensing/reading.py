"""Reading the needle map of a scene: photometric stereo, and the material's response where a depth map shows it."""

import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Float

from itree_jax.sensing.depth_camera import needles_of_depth
from itree_jax.sensing.depth_needles import depth_needles
from itree_jax.sensing.material_response import apply_response, fit_response
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.photometric import needle_map
from itree_jax.sensing.regions import depth_noise
from itree_jax.sensor import Sensor


def read_needles(
    images: Float[np.ndarray, "lights height width"], sensor: Sensor, depth: Float[np.ndarray, "height width"] | None
) -> NeedleMap:
    """The needle map of one image under each light, or of a depth camera's map, as NumPy arrays.

    A depth map [mm] (0 = none) tells normals too, coarsely but without a reflectance: what photometric stereo makes of
    the material is fitted to them (`material_response`), and used where that helps.
    """
    if sensor.is_depth_camera:
        if depth is None:
            raise ItreeError("a depth camera's needle map comes from its depth map, and there is none")
        return needles_of_depth(depth, sensor)
    needle = NeedleMap(*(np.asarray(a) for a in needle_map(images, sensor)))
    if depth is None:
        return needle
    of_depth = depth_needles(depth, sensor.camera, depth_noise(depth, depth > 0))
    return apply_response(needle, fit_response(needle, of_depth.normals, of_depth.known))
