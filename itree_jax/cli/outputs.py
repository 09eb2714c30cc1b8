"""Outputs that are whole or not there."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from itree_kernels.errors import ItreeError


def check_file(path: Path | None) -> None:
    """Raises ItreeError unless a file can be put there: asked before the work, not after it."""
    if path is None:
        return
    if path.is_dir():
        raise ItreeError(f"{path} is a folder; give the name of a file to write")
    if not path.parent.is_dir():
        raise ItreeError(f"there is no folder {path.parent} to write {path.name} into; make it first")
    if not os.access(path.parent, os.W_OK):
        raise ItreeError(f"the folder {path.parent} cannot be written to")


def check_folder(path: Path | None) -> None:
    """Raises ItreeError unless `path` is a folder, or can be made in the folder above it."""
    if path is None or path.is_dir():
        return
    if path.exists():
        raise ItreeError(f"{path} is a file; give the name of a folder")
    if not path.absolute().parent.is_dir():
        raise ItreeError(f"there is no folder {path.parent} to make {path.name} in; make it first")


@contextmanager
def staged_folder(path: Path) -> Iterator[Path]:
    """A temporary folder whose entries move into `path` when the block ends well; else they go, and `path` stays.

    Entries of `path` with the same names are replaced, others are left alone.
    """
    check_folder(path)
    path = path.absolute()
    stage = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        stage.mkdir()
    except OSError as error:
        raise ItreeError(f"{path}: cannot be written ({error})") from error
    try:
        yield stage
        path.mkdir(exist_ok=True)
        for entry in sorted(stage.iterdir()):
            _move(entry, path / entry.name)
    except OSError as error:
        raise ItreeError(f"{path}: cannot be written ({error})") from error
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def _move(entry: Path, target: Path) -> None:
    if target.is_dir() and not target.is_symlink():
        shutil.rmtree(target)
    os.replace(entry, target)
