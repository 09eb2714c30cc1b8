"""The CAD files of the data folder: the unit of each, where it does not say so itself, and which solid is taken."""

import os
from pathlib import Path
from typing import NamedTuple

from itree_cad.load import load_part
from itree_cad.part import Part


class Given(NamedTuple):
    """What `load_part` must be told of a file."""

    units: str | None = None
    solid: str | int | None = None


GIVEN = {
    "featuretype.STL": Given("in"),
    "octagonal_pocket.stl": Given("m"),
    "regulator_collision.stl": Given("m"),
    "as1-oc-214.stp": Given(None, "plate"),
    "dm1-id-214.stp": Given(None, 0),  # l-bracket
    "dm1-pe-214.stp": Given("mm", 0),  # says inches
}


def cad_files() -> list[Path]:
    """Of the data folder, where there is one."""
    data = os.environ.get("ITREE_DATA")
    return [path for path in sorted((Path(data) / "cad").iterdir()) if path.is_file()] if data else []


def load_given(source: str | Path) -> Part:
    """`load_part` with what it must be told."""
    return load_part(source, *GIVEN.get(Path(source).name, Given()))


def label(source: str, part: Part) -> str:
    """One name per source: two files may hold parts of one name."""
    if source.startswith("bundled:"):
        return part.name
    name = Path(source).name
    return name if GIVEN.get(name, Given()).solid is None else f"{name}, {part.name}"
