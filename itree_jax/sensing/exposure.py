"""Whether images are exposed so that needles can be made of them, and were taken under different lights.

The limits come from the sensor's noise: an intensity that is known to 1 / s of itself turns a normal by about 1 / s
radians.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Bool, Float

from itree_jax.sensing.noise_model import intensity_std, saturation_level
from itree_jax.sensor import Noise

BRIGHT_PERCENTILE = 99.5  # what is brightest in an image, highlights of a few pixels left out
LEAST_SIGNAL = 10.0  # of its own noise in the brightest places: needles there turn by 6 degrees already
GOOD_SIGNAL = 27.0  # 2 degrees; with the raster's share that is the 3 degrees that refinement reckons with
OFF_SHARE = 0.1  # of the other images' brightness, each over its light's intensity: a lamp is off or misses the scene
LIT_SHARE = 0.2  # of the bright percentile: a dark bin, which is most of many images, is not counted
MOST_SATURATED = 0.25  # of the lit pixels: whole faces are lost, those that face a light best
SOME_SATURATED = 0.01  # highlights of glossy parts take less
DARK_SIGMAS = 5.0  # of the noise of a dark pixel: one pixel in three millions is beyond by chance
HOT_PIXELS = 1e-5  # of all pixels: those of a sensor that are bright without light
MOST_WHITE = 0.5  # of all pixels: no part and no bin is left to be seen
FLICKER = 0.01  # lamps and exposures repeat to 1 %
LEAST_DIFFERENT = 0.005  # of the lit pixels: two lights differ at every edge, by their shadows alone


def check_exposure(
    images: Float[np.ndarray, "lights height width"], intensities: Float[np.ndarray, "lights"], noise: Noise,
    names: Sequence[str],
) -> list[str]:
    """Warnings about images (linear, 1.0 = full scale, as taken: ambient light included), `names` their files.

    Raises `ItreeError` if the brightest image is too dark, one is far darker than the others beside its light's
    intensity, or too many pixels are saturated.
    """
    bright = np.percentile(images, BRIGHT_PERCENTILE, axis=(1, 2))
    floor = float(intensity_std(np.zeros(()), noise))
    signal = bright / np.asarray(intensity_std(bright, noise))
    best = int(np.argmax(bright))
    told = (
        f"{names[best]}, the brightest, has {bright[best]:.4f} of full scale at its {BRIGHT_PERCENTILE} percentile, "
        f"{signal[best]:.0f} times its noise (dark noise {floor:.5f})"
    )
    if signal[best] < LEAST_SIGNAL:
        raise ItreeError(
            f"the images are too dark: {told}; at least {LEAST_SIGNAL:.0f} times is needed. Expose longer, or check "
            "'bit_depth' and 'response' of the sensor."
        )
    relative = bright / intensities
    for k, value in enumerate(relative):
        others = float(np.median(np.delete(relative, k)))
        if value < OFF_SHARE * others:
            raise ItreeError(
                f"{names[k]} (light {k}) is dark: its {BRIGHT_PERCENTILE} percentile is {bright[k]:.4f} of full scale, "
                f"the others' is {others / max(value, 1e-9):.0f} times as much for their light's intensity. Was lamp "
                f"{k} on?"
            )
    warnings = []
    if signal.min() < GOOD_SIGNAL:
        dark = int(np.argmin(signal))
        warnings.append(
            f"{names[dark]} is dark: {bright[dark]:.4f} of full scale at its {BRIGHT_PERCENTILE} percentile, "
            f"{signal[dark]:.0f} times its noise; needles want {GOOD_SIGNAL:.0f} times. Expose longer."
        )
    return warnings + _check_saturation(images, bright, noise, names)


def _check_saturation(
    images: Float[np.ndarray, "lights height width"], bright: Float[np.ndarray, "lights"], noise: Noise,
    names: Sequence[str],
) -> list[str]:
    level, warnings = saturation_level(noise), []
    for k, image in enumerate(images):
        lit = image > LIT_SHARE * bright[k]
        share = float((image[lit] >= level).mean()) if lit.any() else 0.0
        told = f"{names[k]}: {100 * share:.1f} % of the lit pixels are saturated"
        if share > MOST_SATURATED:
            raise ItreeError(f"{told}, at most {100 * MOST_SATURATED:.0f} % may be; expose shorter.")
        if share > SOME_SATURATED:
            warnings.append(f"{told}; they carry no needle. Expose shorter, unless they are highlights.")
    return warnings


def check_light(images: Float[np.ndarray, "lights height width"], noise: Noise, names: Sequence[str]) -> None:
    """Raises `ItreeError` if an image (linear, 1.0 = full scale) has no light at all, has nothing but too much of it,
    or is another one once more: what no scene looks like, and needles cannot be made of."""
    dark = DARK_SIGMAS * float(intensity_std(np.zeros(()), noise))
    for k, image in enumerate(images):
        if not (image > dark).mean() > HOT_PIXELS:
            raise ItreeError(
                f"{names[k]} (light {k}) is black: no pixel is brighter than noise, {dark:.5f} of full scale. Was lamp "
                f"{k} on?"
            )
        share = float((image >= saturation_level(noise)).mean())
        if share > MOST_WHITE:
            raise ItreeError(
                f"{names[k]} (light {k}) is overexposed: {100 * share:.0f} % of its pixels are saturated; expose less."
            )
    for i, j in combinations(range(len(images)), 2):
        if np.array_equal(images[i], images[j]):
            raise _same_image(i, j, names)


def _same_image(i: int, j: int, names: Sequence[str]) -> ItreeError:
    return ItreeError(
        f"{names[i]} and {names[j]} (lights {i} and {j}) are the same image; give one image for each light"
    )


def check_different(
    images: Float[np.ndarray, "lights height width"], noise: Noise, names: Sequence[str]
) -> None:
    """Raises `ItreeError` if two images are the same file, or show the same lamp (one may be exposed longer)."""
    for i, j in combinations(range(len(images)), 2):
        if np.array_equal(images[i], images[j]):
            raise _same_image(i, j, names)
        share = differing_share(images[i], images[j], noise)
        if share < LEAST_DIFFERENT:
            raise ItreeError(
                f"{names[i]} and {names[j]} (lights {i} and {j}) show the same light: only {100 * share:.2f} % of the "
                f"lit pixels differ by more than noise, where two lights make {100 * LEAST_DIFFERENT:.1f} % and more. "
                "Were the lamps switched between them? (An empty scene has no shadows to tell lights by.)"
            )


def differing_share(
    a: Float[np.ndarray, "height width"], b: Float[np.ndarray, "height width"], noise: Noise
) -> float:
    """Share of the pixels lit in either image at which the two differ by more than noise and flicker, after one is
    scaled to the other where both are lit; 1 where nothing is lit in both."""
    lit_a, lit_b = _lit(a), _lit(b)
    both, either = lit_a & lit_b, lit_a | lit_b
    if not both.any():
        return 1.0
    scale = float(np.median(a[both].astype(float) / b[both]))
    x, y = a[either].astype(float), b[either].astype(float)
    std = np.hypot(np.asarray(intensity_std(x, noise), float), scale * np.asarray(intensity_std(y, noise), float))
    return float((np.abs(x - scale * y) > 4.0 * np.hypot(std, FLICKER * x)).mean())


def _lit(image: Float[np.ndarray, "height width"]) -> Bool[np.ndarray, "height width"]:
    return image > LIT_SHARE * np.percentile(image, BRIGHT_PERCENTILE)
