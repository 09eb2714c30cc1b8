"""Where outputs go: asked before the work, not after it."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from itree_kernels.errors import ItreeError
from itree_kernels.whole_files import whole_entries


def check_file(path: Path | None) -> None:
    """Raises ItreeError unless a file can be put there: asked before the work, not after it."""
    if path is None:
        return
    if path.is_dir():
        raise ItreeError(f"{path} is a folder; give the name of a file to write")
    if path.exists() and not path.is_file():
        return  # a pipe, or /dev/stdout
    if not path.parent.is_dir():
        raise ItreeError(f"there is no folder {path.parent} to write {path.name} into; make it first")
    _check_writable(path.parent)


def check_folder(path: Path | None) -> None:
    """Raises ItreeError unless `path` is a folder that can be written to, or can be made in the folder above it."""
    if path is None:
        return
    if path.exists() and not path.is_dir():
        raise ItreeError(f"{path} is a file; give the name of a folder")
    if not path.absolute().parent.is_dir():
        raise ItreeError(f"there is no folder {path.parent} to make {path.name} in; make it first")
    _check_writable(path.absolute().parent)  # where it is made whole before it is moved
    if path.is_dir():
        _check_writable(path)


def _check_writable(folder: Path) -> None:
    """By a file that is made and gone at once: permissions alone don't tell of disks mounted to be read only."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise ItreeError(f"the folder {folder} cannot be written to ({error.strerror})") from error


@contextmanager
def staged_folder(path: Path) -> Iterator[Path]:
    """`whole_entries` of a folder that is asked for on the command line."""
    check_folder(path)
    with whole_entries(path) as stage:
        yield stage
