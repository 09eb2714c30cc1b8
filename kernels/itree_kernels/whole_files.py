"""Files and folders that appear whole or not at all: a reader sees the old one or the new one, never half of one.

Content is written beside its place under another name and then renamed. A process that is killed in between leaves
that other name (`.NAME.*.tmp`), which the next one to write the same place clears away.
"""

import os
import secrets
import shutil
import socket
import stat
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from itree_kernels.errors import ItreeError


def write_whole(path: str | Path, content: bytes | str) -> None:
    """Writes one file; text as UTF-8 with the line ends it has.

    A link is followed. What is there and no regular file, such as /dev/stdout or a pipe, is written into. Raises
    ItreeError when the file cannot be written; what was there before is then still there.
    """
    data = content.encode() if isinstance(content, str) else content
    with _told(path):
        target = Path(path).resolve()
        if target.exists() and not target.is_file() and not target.is_dir():
            target.write_bytes(data)
            return
        _clear_leftovers(target)
        temporary = _beside(target)
        try:
            with temporary.open("xb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())  # a disk that is full may say so only here
            if target.is_file():
                temporary.chmod(stat.S_IMODE(target.stat().st_mode))
            os.replace(temporary, target)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise


@contextmanager
def whole_folder(path: str | Path) -> Iterator[Path]:
    """A new folder to be filled, which takes the place of `path` when the block ends well; else it goes.

    A folder that was at `path` goes with all that is in it; folders above it are made. Raises ItreeError when it cannot
    be written.
    """
    with _told(path):
        Path(path).parent.mkdir(parents=True, exist_ok=True)
    with _told(path), _stage(Path(path)) as stage:
        yield stage
        target = Path(path).resolve()
        with _undone_on_failure() as undo:
            if target.exists():
                _move(target, stage.with_name(f"{stage.name}.old"), undo)
            _move(stage, target, undo)
    shutil.rmtree(stage.with_name(f"{stage.name}.old"), ignore_errors=True)


@contextmanager
def whole_entries(path: str | Path) -> Iterator[Path]:
    """A folder to be filled, whose entries move into the folder `path` when the block ends well; else they go.

    Entries of `path` with the same names are replaced, others are left alone; when an entry cannot be moved, those
    before it move back. Raises ItreeError when that, or the folder, cannot be written.
    """
    with _told(path), _stage(Path(path)) as stage:
        yield stage
        target = Path(path).resolve()
        if not target.exists():
            os.replace(stage, target)
            return
        replaced = stage / ".replaced"
        entries = sorted(stage.iterdir())
        replaced.mkdir()
        with _undone_on_failure() as undo:
            for entry in entries:
                place = target / entry.name
                if place.exists() or place.is_symlink():
                    _move(place, replaced / entry.name, undo)
                _move(entry, place, undo)


@contextmanager
def folder_beside(path: str | Path) -> Iterator[Path]:
    """A new folder beside `path`, for what is needed until `path` can be written; gone after the block.

    Raises ItreeError when it cannot be made.
    """
    with _told(path), _stage(Path(path)) as stage:
        yield stage


@contextmanager
def _stage(path: Path) -> Iterator[Path]:
    """A folder beside `path`, gone after the block."""
    target = path.resolve()
    _clear_leftovers(target)
    stage = _beside(target)
    stage.mkdir()
    try:
        yield stage
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def _move(source: Path, target: Path, undo: list[Callable[[], None]]) -> None:
    os.replace(source, target)
    undo.append(lambda: os.replace(target, source))


@contextmanager
def _undone_on_failure() -> Iterator[list[Callable[[], None]]]:
    """A list of what takes each step back, in the order of the steps."""
    undo: list[Callable[[], None]] = []
    try:
        yield undo
    except BaseException:
        for step in reversed(undo):
            step()
        raise


@contextmanager
def _told(path: str | Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise ItreeError(f"{path}: cannot be written ({error.strerror or error})") from error


def _beside(target: Path) -> Path:
    """A free name in the same folder, so that it can be renamed; it tells the process that it belongs to."""
    return target.with_name(f"{_prefix(target)}{os.getpid()}.{secrets.token_hex(4)}.tmp")


def _prefix(target: Path) -> str:
    """Of names that this machine gives: a process number says nothing on another one that shares the disk."""
    return f".{target.name}.{zlib.crc32(socket.gethostname().encode()):08x}."


def _clear_leftovers(target: Path) -> None:
    """Removes what processes that are gone left beside `target`."""
    prefix = _prefix(target)
    with suppress(OSError):
        for entry in target.parent.iterdir():
            if entry.name.startswith(prefix) and entry.name.endswith(".tmp"):
                owner = entry.name.removeprefix(prefix).split(".")[0]
                if owner.isdecimal() and not _alive(int(owner)):
                    shutil.rmtree(entry) if entry.is_dir() else entry.unlink()


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True
