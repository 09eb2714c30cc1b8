"""Light directions: checked at the door, and what they say about slants and shadows."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from itree_kernels.errors import ItreeError
from itree_kernels.json_file import as_numbers
from jaxtyping import Float

UNIT_TOLERANCE = 1e-3  # a direction printed with four digits is unit to this
MAX_CONDITION = 100.0  # beyond, 1 % of error in an intensity could turn a normal anywhere: no three lights in space
MAX_RATIO = 1000.0  # of intensities: the weakest light is then lost in the 10 bits of the strongest
FARTHEST = 1e6  # [mm] of a near light: beyond a kilometre it is distant, or in another unit
STRONGEST = 1e6  # of intensities, or its inverse: single precision keeps what is made of them
SLANT_GUARD = np.radians(13.0)  # see `slant_limit_of`


class Lights(NamedTuple):
    """Three or more lights; with `positions` near ones, whose directions are those at `axis_point`."""

    directions: Float[np.ndarray, "lights 3"]  # unit, from the scene toward the light, camera frame
    intensities: Float[np.ndarray, "lights"]
    positions: Float[np.ndarray, "lights 3"] | None  # [mm], camera frame


NO_LIGHTS = Lights(np.zeros((0, 3)), np.zeros(0), None)  # those of a depth camera


def lights_of_entry(entry: Mapping[str, Any], working_distance: float | None, where: str) -> Lights:
    """The lights that a JSON object tells by 'directions' or by 'positions_mm', and 'intensities'.

    Raises `ItreeError` if it has both or neither, if near lights have no working distance [mm] to be told at, and as
    `checked_lights` does.
    """
    if ("directions" in entry) == ("positions_mm" in entry):
        found = "both are there" if "directions" in entry else "neither is there"
        raise ItreeError(
            f"{where}: lights are told by 'directions' (distant) or by 'positions_mm' (near): {found}, give one"
        )
    if "directions" in entry:
        return Lights(*checked_lights(entry["directions"], entry.get("intensities"), where), None)
    if working_distance is None:
        raise ItreeError(
            f"{where}: near lights ('positions_mm') need a camera and a working distance: put them into a sensor JSON"
        )
    positions, _ = _as_arrays(entry["positions_mm"], entry.get("intensities"), f"{where}: 'positions_mm'")
    for i, position in enumerate(positions):
        if not np.abs(position).max() < FARTHEST:
            raise ItreeError(f"{where}: 'positions_mm'[{i}] is {position.tolist()}, no place near the scene in mm")
        if not np.linalg.norm(position - axis_point(working_distance)) > 0.0:
            raise ItreeError(f"{where}: 'positions_mm'[{i}] must be a point [x, y, z] other than where the parts lie")
    directions = directions_on_axis(positions, working_distance)
    return Lights(*checked_lights(directions, entry.get("intensities"), where), positions)


def axis_point(working_distance: float) -> Float[np.ndarray, "3"]:
    """Where the optical axis meets the working distance [mm]: what near lights are told for."""
    return np.array([0.0, 0.0, working_distance])


def directions_on_axis(
    positions: Float[np.ndarray, "lights 3"], working_distance: float
) -> Float[np.ndarray, "lights 3"]:
    """Unit directions toward near lights from `axis_point`."""
    to_light = positions - axis_point(working_distance)
    return to_light / np.linalg.norm(to_light, axis=1, keepdims=True)


def checked_lights(directions: object, intensities: object, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Unit directions `[lights, 3]` toward the lights in the camera frame and intensities `[lights]`, or an error.

    Raises `ItreeError` with the file (`where`) and the light: fewer than three lights, not unit (beyond 1e-3; a
    smaller deviation is normalised away), behind the camera's back (z >= 0: it would light what the camera cannot
    see), directions in one plane through the scene or twice the same (normals could not be solved for).
    """
    L, e = _as_arrays(directions, intensities, where)
    with np.errstate(over="ignore"):  # an infinite norm is refused like any other
        norms = np.linalg.norm(L, axis=1)
    for i, (light, norm) in enumerate(zip(L, norms, strict=True)):
        if not abs(norm - 1.0) < UNIT_TOLERANCE:
            raise ItreeError(f"{where}: light direction {i} must be a unit vector, its norm is {norm:.6g}")
        if light[2] >= 0.0:
            raise ItreeError(
                f"{where}: light {i} is behind the scene (z = {light[2]:.4g}): directions point from the scene toward "
                "the light in the camera frame (z forward), so z must be negative"
            )
    condition = float(np.linalg.cond(L))
    if not condition < MAX_CONDITION:
        raise ItreeError(
            f"{where}: the light directions lie in one plane or coincide (condition number {condition:.3g}, at most "
            f"{MAX_CONDITION:.0f}); photometric stereo needs three lights that span space"
        )
    check_intensities(e, where)
    return L / norms[:, None], e


def check_intensities(intensities: Float[np.ndarray, "lights"], where: str) -> None:
    """Raises `ItreeError` unless all are positive and finite, and of one order: images would differ as much."""
    for i, value in enumerate(intensities):
        if not (np.isfinite(value) and value > 0.0):
            raise ItreeError(f"{where}: the intensity of light {i} must be positive, it is {value:.6g}")
    low, high = float(np.min(intensities, initial=np.inf)), float(np.max(intensities, initial=0.0))
    if len(intensities) and not 1.0 / STRONGEST < high < STRONGEST:
        raise ItreeError(f"{where}: the strongest light's intensity is {high:.3g}; intensities are relative, near 1")
    if high > MAX_RATIO * low:
        raise ItreeError(
            f"{where}: the lights' intensities go from {low:.3g} to {high:.3g}, exposure included; beyond a ratio of "
            f"{MAX_RATIO:.0f} no camera sees them all"
        )


def _as_arrays(directions: object, intensities: object, where: str) -> tuple[np.ndarray, np.ndarray]:
    L = as_numbers(directions, f"{where}: light directions")
    if L.ndim != 2 or L.shape[1] != 3:
        raise ItreeError(f"{where}: light directions must be a list of [x, y, z], their shape is {L.shape}")
    if len(L) < 3:
        raise ItreeError(f"{where}: photometric stereo needs three or more lights, there are {len(L)}")
    e = np.ones(len(L)) if intensities is None else as_numbers(intensities, f"{where}: light intensities")
    if e.shape != (len(L),):
        raise ItreeError(f"{where}: there are {len(L)} light directions but intensities of shape {e.shape}")
    return L, e


def slant_limit_of(light_directions: Float[np.ndarray, "lights 3"]) -> float:
    """A slant limit [rad] for a sensor that states none: the attached-shadow cone less a guard of 13 degrees.

    A surface slanted away from light i is in its attached shadow from 90 degrees minus the light's angle off the axis
    on, in the worst azimuth; so all lights see every azimuth up to 90 degrees minus the largest such angle. Near that
    cone the darkest light is a few hundredths of the brightest, within reach of interreflection. 13 degrees of
    guard keep it above a fifth (sin 13 = 0.22), where interreflection (8 % of full scale at its 90th percentile) stays
    below it, and give 42 degrees for lights 35 degrees off the axis, the setting of the paper's part.
    """
    off_axis = np.arccos(np.clip(-light_directions[:, 2], -1.0, 1.0)).max()
    limit = np.pi / 2 - off_axis - SLANT_GUARD
    if limit <= 0.0:
        raise ItreeError(
            f"a light is {np.degrees(off_axis):.0f} degrees off the optical axis: no slant is seen by all lights; "
            "state slant_limit_deg in a sensor JSON or move the light toward the camera"
        )
    return float(limit)
