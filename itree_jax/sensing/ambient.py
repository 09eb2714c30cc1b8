"""Ambient light: a frame with every lamp off is what all images have too much of."""

import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Float

from itree_jax.sensing.noise_model import intensity_std, saturation_level
from itree_jax.sensor import Noise

NOISE_SIGMAS = 4.0  # a difference beyond is not noise
MOST_BRIGHTER = 0.01  # of the pixels: something small may have moved; more, and the frame is not of this scene


def subtract_ambient(
    images: Float[np.ndarray, "*batch lights height width"],
    ambient: Float[np.ndarray, "height width"] | Float[np.ndarray, "lights height width"],
    noise: Noise,
) -> Float[np.ndarray, "*batch lights height width"]:
    """Images less the frame that was taken with every lamp off and the same exposure (linear, 1.0 = full scale).

    One frame for all images, or one for each light's exposure. Pixels that are saturated in an image, or in the ambient
    frame, are saturated in the result (1.0). Differences of dark pixels may be negative: noise is not cut off. Raises
    `ItreeError` if the sizes differ, or if more than 1 % of an image's pixels are darker than the ambient frame by
    more than noise: light only adds.
    """
    if ambient.ndim not in (2, 3) or ambient.shape not in (images.shape[-2:], images.shape[-3:]):
        raise ItreeError(
            f"the ambient frame has shape {ambient.shape} (height, width last), the images {images.shape}; take it "
            "with the same camera and region"
        )
    level = saturation_level(noise)
    less = images - ambient
    std = (np.asarray(intensity_std(frames, noise)) for frames in (images, ambient))
    allowed = NOISE_SIGMAS * np.hypot(*std)
    brighter = (less < -allowed).mean(axis=(-2, -1)).reshape(-1)
    worst = int(np.argmax(brighter))
    if brighter[worst] > MOST_BRIGHTER:
        raise ItreeError(
            f"the ambient frame is brighter than image {worst % images.shape[-3]} at {100 * brighter[worst]:.0f} % of "
            f"the pixels (at most {100 * MOST_BRIGHTER:.0f} % may be); it must show the same scene, with the same "
            "exposure, with every lamp off"
        )
    saturated = (images >= level) | (ambient >= level)
    return np.where(saturated, 1.0, less).astype(images.dtype)
