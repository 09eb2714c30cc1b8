"""The symmetries of models_info.json as one finite set of transformations, as BOP does it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from itree_kernels.errors import ItreeError
from itree_kernels.json_file import as_numbers
from jaxtyping import Float
from scipy.spatial.transform import Rotation

SYMMETRY_STEP = 0.01  # of the diameter: how far a point may lie from its copy at the nearest step, as in BOP
FARTHEST = 1e6  # [mm] of what a symmetry moves or turns about: beyond a kilometre it is another unit


@dataclass(frozen=True)
class SymmetrySet:
    """Transformations of the model onto itself: every discrete one times steps about the continuous axes."""

    R: Float[np.ndarray, "symmetries 3 3"]  # the identity first
    t: Float[np.ndarray, "symmetries 3"]  # [mm]
    continuous_axis: Float[np.ndarray, "3"] | None  # the first one; a turn about it is no rotation error


def symmetry_set(info: Mapping[str, Any]) -> SymmetrySet:
    """From one object's entry of BOP's models_info.json (`symmetries_discrete`, `symmetries_continuous`)."""
    discrete = [(np.eye(3), np.zeros(3))]
    for values in _listed(info, "symmetries_discrete"):
        T = _matrix(values)
        discrete.append((T[:3, :3], T[:3, 3]))
    turns, axes = [(np.eye(3), np.zeros(3))], []
    for entry in _listed(info, "symmetries_continuous"):
        axis, offset = _axis(entry)
        axes.append(axis)
        turns += _steps(axis, offset)
    pairs = [(R_a @ R_b, R_a @ t_b + t_a) for R_a, t_a in discrete for R_b, t_b in turns]
    return SymmetrySet(np.array([R for R, _ in pairs]), np.array([t for _, t in pairs]), axes[0] if axes else None)


def _steps(axis: Float[np.ndarray, "3"], offset: Float[np.ndarray, "3"]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Turns about the axis through `offset`, without the identity, in steps of 1 % of the diameter."""
    count = int(np.ceil(np.pi / SYMMETRY_STEP))
    R = Rotation.from_rotvec(2 * np.pi * np.arange(1, count)[:, None] / count * axis).as_matrix()
    return [(r, offset - r @ offset) for r in R]


def _listed(info: Mapping[str, Any], key: str) -> list[Any]:
    listed = info.get(key, [])
    if not isinstance(listed, list):
        raise ItreeError(f"models_info.json: '{key}' must be a list, it is {listed!r:.60}.")
    return listed


def _matrix(values: Any) -> Float[np.ndarray, "4 4"]:
    T = as_numbers(values, "models_info.json: a discrete symmetry")
    if T.size != 16 or not np.all(np.abs(T) < FARTHEST):
        raise ItreeError(
            f"models_info.json: a discrete symmetry has {T.size} numbers; 16 are needed (4x4, [mm]), none beyond 1e6."
        )
    return T.reshape(4, 4)


def _axis(entry: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    try:
        axis, offset = (as_numbers(entry[key], f"models_info.json: '{key}'") for key in ("axis", "offset"))
    except KeyError as missing:
        raise ItreeError(f"models_info.json: a continuous symmetry lacks {missing}.") from None
    except TypeError:
        raise ItreeError(f"models_info.json: a continuous symmetry is {entry!r:.60}, not an object.") from None
    with np.errstate(over="ignore"):
        length = np.linalg.norm(axis)
    near = np.all(np.abs(offset) < FARTHEST)
    if axis.shape != (3,) or offset.shape != (3,) or not (0 < length < np.inf and near):
        raise ItreeError(
            "models_info.json: a continuous symmetry needs axis (not 0) and offset (mm, within a kilometre), 3 numbers "
            "each."
        )
    return axis / length, offset
