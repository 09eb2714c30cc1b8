"""Finished units on disk: a record per unit, and the files that it made, each of them whole or not there.

    NAME.tree, ...      what the units made
    units/NAME.json     key of the unit's inputs, seconds, sha256 of its files, and its record

The record is written last, so that a unit that has one is finished. Seconds are in no other file: all others are the
same wherever and however often the work is done.
"""

import hashlib
import json
from pathlib import Path
from typing import Any, NamedTuple

from itree_kernels.errors import ItreeError
from itree_kernels.whole_files import write_whole

from itree_jax.cluster.keys import digest_of_file
from itree_jax.cluster.unit import Outcome, Product, Unit

RECORDS = "units"


class FinishedUnit(NamedTuple):
    """What is known of one."""

    name: str
    seconds: float
    cpu_seconds: float
    record: dict[str, Any]


class FinishedUnits:
    """Those of one folder, which is made if it is not there (the folder above it must be)."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        try:
            folder.mkdir(exist_ok=True)
            (folder / RECORDS).mkdir(exist_ok=True)
        except OSError as error:
            raise ItreeError(f"{folder}: cannot be written to ({error})") from error

    def finished(self, unit: Unit) -> FinishedUnit | None:
        """The unit as it was finished by an earlier run; None if it wasn't, or its inputs or files have changed."""
        try:
            said = json.loads(self._record(unit.name).read_text(encoding="utf-8"))
            key, files = said["key"], dict(said["files"])
            done = FinishedUnit(unit.name, said["seconds"], said["cpu_seconds"], said["record"])
        except (OSError, ValueError, KeyError, TypeError):
            return None
        whole = all(digest_of_file(self.folder / name) == digest for name, digest in files.items())
        return done if key == unit.key and whole else None

    def keep(self, unit: Unit, product: Product, outcome: Outcome) -> FinishedUnit:
        """Writes what a unit gave. Raises ItreeError when it cannot."""
        for name, content in product.files.items():
            (self.folder / name).parent.mkdir(exist_ok=True)
            write_whole(self.folder / name, content)
        files = {name: hashlib.sha256(content).hexdigest() for name, content in sorted(product.files.items())}
        spent = {"seconds": outcome.seconds, "cpu_seconds": outcome.cpu_seconds}
        said = {"key": unit.key, **spent, "files": files, "record": product.record}
        text = json.dumps(said, indent=1, allow_nan=False) + "\n"
        write_whole(self._record(unit.name), text.encode())
        return FinishedUnit(unit.name, **spent, record=json.loads(text)["record"])  # as a later run will read it

    def _record(self, name: str) -> Path:
        return self.folder / RECORDS / f"{name}.json"
