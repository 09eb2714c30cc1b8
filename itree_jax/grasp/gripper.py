"""Grippers: a parallel jaw or a suction cup, read from a small TOML file (`gripper.schema.json` tells its keys).

Gripper frame: z along the approach, toward the part; x along the jaw's closing; the origin in the middle between the
two pads, or in the middle of the cup's rim.
"""

import json
import tomllib
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from itree_kernels.errors import ItreeError

from itree_jax.sensing.json_check import check_json

BUNDLED_GRIPPERS = ("jaw", "cup")
_FILES = resources.files("itree_jax.grasp")
GRIPPER_SCHEMA: dict[str, Any] = json.loads(_FILES.joinpath("gripper.schema.json").read_text(encoding="utf-8"))
# Defaults of what a file may leave out
OPEN_BY = 3.0  # [mm]: some thirty times the deviation of a pose
TILT = 60.0  # [degrees]: flatter, a gripper works from the side, and a bin has walls
CLEARANCE = 1.0  # [mm]: 5 % of MSSD of a small part


@dataclass(frozen=True)
class Jaw:
    """Two parallel fingers that close on a part from both sides. Lengths in [mm]."""

    opening_min: float  # between the pads
    opening_max: float
    open_by: float  # each finger's distance from the part before it closes
    finger_width: float  # along y
    finger_thickness: float  # along x
    finger_length: float  # along z, from the palm to the tip
    pad_length: float  # along z, ending at the tip


@dataclass(frozen=True)
class Cup:
    """A suction cup on a stem. Lengths in [mm]."""

    diameter: float
    length: float
    lip: float  # sagitta of a cylinder that it still seals on
    stem_diameter: float
    stem_length: float


@dataclass(frozen=True)
class Gripper:
    """What takes a part out of the bin, along a straight path that ends at the grasp."""

    name: str
    tool: Jaw | Cup
    palm: tuple[float, float, float]  # x, y, z [mm]
    distance: float  # [mm] of the straight approach
    tilt: float  # [rad], the largest angle between the approach and straight down
    clearance: float  # [mm], the least distance from everything but the part


def load_gripper(source: str | Path) -> Gripper:
    """The gripper of a TOML file or `bundled:NAME`. Raises ItreeError that names the file and the key."""
    name = str(source)
    if name.startswith("bundled:"):
        name = name.removeprefix("bundled:")
        if name not in BUNDLED_GRIPPERS:
            raise ItreeError(f"no bundled gripper is called '{name}'; there are {', '.join(BUNDLED_GRIPPERS)}")
        return gripper_from_toml(_FILES.joinpath(f"{name}.toml").read_text(encoding="utf-8"), f"bundled:{name}")
    try:
        text = Path(source).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ItreeError(
            f"gripper '{source}' is neither a readable TOML file nor bundled ({error}); try 'bundled:jaw'"
        ) from error
    return gripper_from_toml(text, name)


def gripper_from_toml(text: str, where: str) -> Gripper:
    """The gripper that `text` describes. `where` names it in errors."""
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # of syntax, or a number of thousands of digits
        raise ItreeError(f"{where}: this is not TOML ({error})") from error
    check_json(data, GRIPPER_SCHEMA, where)
    if ("jaw" in data) == ("cup" in data):
        raise ItreeError(f"{where}: give one of the tables [jaw] and [cup], not {'both' if 'jaw' in data else 'none'}")
    approach = data["approach"]
    tool = _jaw(data["jaw"], where) if "jaw" in data else _cup(data["cup"])
    x, y, z = data["palm"]["size"]
    tilt = float(np.radians(approach.get("tilt", TILT)))
    return Gripper(
        data["name"], tool, (float(x), float(y), float(z)), float(approach["distance"]), tilt,
        float(approach.get("clearance", CLEARANCE)),
    )  # fmt: skip


def _jaw(table: dict[str, Any], where: str) -> Jaw:
    jaw = Jaw(**({"opening_min": 0.0, "open_by": OPEN_BY} | {key: float(value) for key, value in table.items()}))
    if jaw.opening_min >= jaw.opening_max:
        raise ItreeError(
            f"{where}: 'jaw.opening_min' is {jaw.opening_min:g} mm; it must be less than 'jaw.opening_max', "
            f"{jaw.opening_max:g} mm"
        )
    if jaw.pad_length > jaw.finger_length:
        raise ItreeError(
            f"{where}: 'jaw.pad_length' is {jaw.pad_length:g} mm; it cannot be more than the finger's length, "
            f"{jaw.finger_length:g} mm"
        )
    return jaw


def _cup(table: dict[str, Any]) -> Cup:
    return Cup(**({"lip": 0.0} | {key: float(value) for key, value in table.items()}))
