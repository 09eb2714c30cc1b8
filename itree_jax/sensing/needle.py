"""The needle map: what photometric stereo makes of an image under each light."""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

Array = jax.Array | np.ndarray


class NeedleMap(NamedTuple):
    """Normals of one image (or a batch of images) with what is known about their trustworthiness."""

    normals: Float[Array, "*batch height width 3"]  # unit, camera frame, toward the camera (z < 0); 0 where none
    albedo: Float[Array, "*batch height width"]  # of full scale under a light of intensity 1 that meets it; 0 = none
    interpretable: Bool[Array, "*batch height width"]  # the normal can be believed
    shadowed: Bool[Array, "*batch lights height width"]  # the light does not reach the pixel
    saturated: Bool[Array, "*batch lights height width"]
    confidence: Float[Array, "*batch height width"]  # 1 = albedo as the parts' dominant one, falls to 0
    normal_std: Float[Array, "*batch height width"]  # rms angle [rad] by which sensor noise turns the normal; 0 = none
    # rms angle [rad] by which the model's error turns it: reflectance and interreflection, shared by a face's pixels
    normal_bias: Float[Array, "*batch height width"]
    shadow_probability: Float[Array, "*batch lights height width"]  # that the light does not reach the pixel
    reaching: Bool[Array, "*batch lights height width"]  # the lights that the normal is made from
