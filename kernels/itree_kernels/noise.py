"""What a camera's sensor adds to an ideal image."""

import numpy as np
from jaxtyping import Float

from itree_kernels.errors import ItreeError


def sensor_noise(
    images: Float[np.ndarray, "*shape"], full_well_e: float, read_noise_e: float, bits: int, seed: int
) -> Float[np.ndarray, "*shape"]:
    """Images as the camera reports them: shot noise, read noise, quantisation, saturation at 1.0 (full scale).

    Electrons are Poisson distributed with mean `images * full_well_e`; read noise is Gaussian, `read_noise_e`
    [electrons]; the sum is clipped to [0, 1] and rounded to one of 2^bits levels. So the variance of an intensity I,
    away from both ends and where the noise exceeds a level, is
    I / full_well_e + (read_noise_e / full_well_e)^2 + (2^bits - 1)^-2 / 12.
    Returns float32. The same seed gives the same bytes.
    Raises ItreeError when a parameter is out of range or an image is not finite.
    """
    if not (full_well_e > 0 and read_noise_e >= 0 and 1 <= bits <= 24):
        raise ItreeError(
            f"sensor noise needs full_well_e > 0, read_noise_e >= 0 and 1 <= bits <= 24 (float32), "
            f"not {full_well_e}, {read_noise_e}, {bits}"
        )
    if not np.all(np.isfinite(images)):
        raise ItreeError("an image has values that are not finite; noise can't be added to it")
    rng = np.random.default_rng(seed)
    mean_e = np.maximum(np.asarray(images, dtype=np.float64), 0.0) * full_well_e
    electrons = rng.poisson(mean_e) + rng.normal(0.0, read_noise_e, size=mean_e.shape)
    levels = 2**bits - 1
    return (np.round(np.clip(electrons / full_well_e, 0.0, 1.0) * levels) / levels).astype(np.float32)
