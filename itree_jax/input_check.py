"""Whether arrays hold numbers that an image, a depth map and a rotation can hold, and picks are a number of poses."""

import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Float
from numpy.typing import ArrayLike

BRIGHTEST = 2.0  # of full scale: what a lens correction may make of 1.0; counts of a converter are far beyond
ROTATION_TOLERANCE = 1e-3  # of R R^T against I: printed with four digits


def check_numbers(
    images: Float[np.ndarray, "*batch lights height width"],
    depth: Float[np.ndarray, "*batch height width"] | None = None,
    R_w2c: Float[np.ndarray, "3 3"] | None = None,
) -> None:
    """Raises ItreeError where images or depth are not finite, images are far above full scale (1.0), depth is negative,
    or `R_w2c` is no rotation.
    """
    for name, values in (("images", images), ("the depth map", depth)):
        if values is not None and not np.isfinite(values).all():
            count = int((~np.isfinite(values)).sum())
            raise ItreeError(f"{name}: {count} values are not finite; put 0 where nothing was measured")
    if np.max(images, initial=0.0) > BRIGHTEST:
        raise ItreeError(f"images go up to {np.max(images):.4g}, but 1.0 is full scale; divide them by the camera's")
    if depth is not None and np.min(depth, initial=0.0) < 0.0:
        raise ItreeError(f"the depth map has a negative depth, {np.min(depth):.4g}; it is z in mm, 0 = none")
    if R_w2c is not None:
        R = np.asarray(R_w2c)
        if not _is_rotation(R):
            raise ItreeError(f"R_w2c is not a rotation matrix: {R.tolist()}")


def as_floats(name: str, values: ArrayLike) -> Float[np.ndarray, "*shape"]:
    """The values as float32. Raises ItreeError where they are no real numbers, or not as many in every row."""
    try:
        array = np.asarray(values)
    except ValueError:
        raise ItreeError(f"{name}: rows have different lengths; give one array of numbers") from None
    if array.dtype.kind not in "fiub":
        raise ItreeError(f"{name}: {array.dtype} is no type of real numbers; give one array of numbers")
    return array.astype(np.float32, copy=False)


def check_picks(picks: int | None) -> None:
    """Raises ItreeError where so many poses can't be asked for."""
    if picks is not None and (isinstance(picks, bool) or not isinstance(picks, int | np.integer) or picks < 1):
        raise ItreeError(f"picks is {picks!r}; give how many sure poses are enough, 1 or more, or None for all")


def _is_rotation(R: np.ndarray) -> bool:
    if R.shape != (3, 3) or R.dtype.kind not in "iuf" or not (np.abs(R) < 2.0).all():
        return False
    return bool(np.abs(R @ R.T - np.eye(3)).max() < ROTATION_TOLERANCE and np.linalg.det(R) > 0.0)
