"""Keys: what tells whether a result on disk is still that of its inputs."""

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

MISSING = "missing"  # in the place of a digest: the work itself says what is wrong


def key_of(**inputs: Any) -> str:
    """One key of inputs that are plain JSON data; the order in which they are named does not count."""
    return hashlib.sha256(json.dumps(inputs, sort_keys=True).encode()).hexdigest()


def digest_of_file(path: str | Path) -> str:
    """sha256 of a file's bytes."""
    try:
        with Path(path).open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return MISSING


def digest_of_listing(paths: Iterable[Path]) -> str:
    """Of names, sizes and times of change, as build tools tell whether a file is another: a dataset of a million scenes
    is not read to know what is left to do.
    """
    lines = []
    for path in sorted(paths):
        stat = path.stat()
        lines.append(f"{path.name} {stat.st_size} {stat.st_mtime_ns}")
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()
