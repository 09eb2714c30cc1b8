"""Folders of photographs, one under each light, as cameras and data sets leave them: with colour, in 8 or 16 bits.

`read_image` refuses colour, because a part's images must be one linear intensity. Photographs of calibration targets
and of data sets are read here, with an explicit choice of what becomes of their colour.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Bool, Float

from itree_jax.sensing.image_file import IMAGE_SUFFIXES, decoded, linear, read_intensity

# One channel, or the mean of the three: both are linear where the file is (luma of gamma-coded channels is not).
Channel = Literal["mean", "red", "green", "blue"]
SUFFIXES = (*IMAGE_SUFFIXES, ".jpg", ".jpeg")


@dataclass(frozen=True)
class PhotographFolder:
    """The files of one image per light."""

    folder: Path
    images: tuple[Path, ...]  # in the order of the lights
    mask: Path | None

    @property
    def names(self) -> list[str]:
        return [str(path) for path in self.images]


def photograph_folder(folder: Path) -> PhotographFolder:
    """The images that `folder` holds: those that its filenames.txt lists, else all but the mask by their numbers.

    The mask is the one image with "mask" in its name. Raises `ItreeError` if there is no image, one that is listed is
    missing, or there are several masks.
    """
    if not folder.is_dir():
        raise ItreeError(f"{folder}: there is no such folder of images")
    found = sorted((path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES), key=_by_number)
    masks = [path for path in found if "mask" in path.stem.lower()]
    if len(masks) > 1:
        raise ItreeError(f"{folder}: there are several masks ({', '.join(path.name for path in masks)}); leave one")
    listed = folder / "filenames.txt"
    if listed.is_file():
        images = [folder / name for name in listed.read_text(encoding="utf-8").split()]
        for path in images:
            if not path.is_file():
                raise ItreeError(f"{listed}: the image {path.name} that it lists is missing")
    else:
        images = [path for path in found if path not in masks]
    if not images:
        raise ItreeError(f"{folder}: no image is in it ({', '.join(SUFFIXES)}); one image under each light is needed")
    return PhotographFolder(folder, tuple(images), masks[0] if masks else None)


def _by_number(path: Path) -> list[tuple[int, str]]:
    """gray.2.png comes before gray.10.png."""
    return [(int(piece), "") if piece.isdigit() else (-1, piece) for piece in re.split(r"(\d+)", path.name)]


def read_photograph(
    path: Path,
    channel: Channel | None = "mean",
    bit_depth: int | None = None,
    gamma: float = 1.0,
    colour_intensity: Float[np.ndarray, "3"] | None = None,
) -> Float[np.ndarray, "height width"]:
    """Linear float32 intensity, 1.0 = full scale, of an image with colour or without.

    `channel`: what becomes of colour; None refuses it as `read_image` does. `colour_intensity` (red, green, blue of the
    light): channels are brought to a white light of their mean intensity before the mean is taken, so that the colour
    of a surface does not matter. A pixel with one saturated channel is saturated (1.0) in the mean.
    """
    stored = decoded(path)
    if channel is None or stored.ndim == 2:
        return read_intensity(path, bit_depth, gamma)
    if stored.ndim != 3 or stored.shape[2] < 3:
        raise ItreeError(f"{path}: an image with one, three or four channels is expected, its shape is {stored.shape}")
    rgb = linear(stored[..., 2::-1], path, bit_depth, gamma)
    if channel != "mean":
        return np.ascontiguousarray(rgb[..., ("red", "green", "blue").index(channel)])
    white = 1.0 if colour_intensity is None else colour_intensity.mean() / colour_intensity
    return np.where((rgb >= 1.0).any(-1), 1.0, (rgb * white).mean(-1)).astype(np.float32)


def read_photographs(
    photographs: PhotographFolder,
    channel: Channel | None = "mean",
    bit_depth: int | None = None,
    gamma: float = 1.0,
    colour_intensities: Float[np.ndarray, "lights 3"] | None = None,
) -> Float[np.ndarray, "lights height width"]:
    """All images of a folder by `read_photograph`. Raises `ItreeError` if their sizes differ."""
    colours = [None] * len(photographs.images) if colour_intensities is None else colour_intensities
    images = [
        read_photograph(path, channel, bit_depth, gamma, colour)
        for path, colour in zip(photographs.images, colours, strict=True)
    ]
    for path, image in zip(photographs.images, images, strict=True):
        if image.shape != images[0].shape:
            raise ItreeError(
                f"{path}: the image is {image.shape[1]} x {image.shape[0]} px, {photographs.images[0].name} is "
                f"{images[0].shape[1]} x {images[0].shape[0]} px"
            )
    return np.stack(images)


def read_mask(path: Path, shape: tuple[int, ...]) -> Bool[np.ndarray, "height width"]:
    """True where the mask is brighter than half of full scale. Raises `ItreeError` if it is not of `shape`."""
    mask = read_photograph(path) > 0.5
    if mask.shape != tuple(shape):
        raise ItreeError(
            f"{path}: the mask is {mask.shape[1]} x {mask.shape[0]} px, the images are {shape[1]} x {shape[0]} px"
        )
    return mask
