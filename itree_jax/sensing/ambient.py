"""Ambient light: a frame with every lamp off is what all images have too much of."""

import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Float


def subtract_ambient(
    images: Float[np.ndarray, "*batch lights height width"],
    ambient: Float[np.ndarray, "height width"] | Float[np.ndarray, "lights height width"],
    full_scale: float = 1.0,
) -> Float[np.ndarray, "*batch lights height width"]:
    """Images less the ambient frame, taken with their exposure (linear, 1.0 = full
    scale; `full_scale`: the least value that is saturated).

    Saturated pixels keep their value, so that they still count as saturated; where the ambient frame itself is
    saturated, so is every image. The ambient light's own shot noise is not added to the noise model. Raises
    `ItreeError` if the sizes differ or the frame is brighter than the images (then it is none, or was exposed longer).
    """
    if ambient.shape not in (images.shape[-2:], images.shape[-3:]):
        raise ItreeError(
            f"the ambient frame is {ambient.shape[-1]} x {ambient.shape[-2]} px, the images are {images.shape[-1]} x "
            f"{images.shape[-2]} px"
        )
    if ambient.mean() > images.mean():
        raise ItreeError(
            f"the ambient frame is brighter than the images (mean {ambient.mean():.3g}, theirs {images.mean():.3g} of "
            "full scale): it must show the same scene with every lamp off, at the same exposure"
        )
    less = np.where(images >= full_scale, images, images - ambient)
    return np.where(ambient >= full_scale, np.float32(1.0), less).astype(images.dtype)
