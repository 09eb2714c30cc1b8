"""The tree as one file: a zip of arrays (.npy) and a JSON header. It is data: no pickle, nothing in it is executed.

    header.json     format, version, who wrote it; part and sensor for a reader; the tree; sha256 of every array
    header.sha256   sha256 of header.json
    NAME.npy        one array of the tree each, named by its field

The same tree gives the same bytes.
"""

import hashlib
import io
import json
import zipfile
import zlib
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from itree_kernels.errors import ItreeError
from itree_kernels.npy_file import parse_npy
from itree_kernels.whole_files import write_whole

from itree_jax.sensing.sensor_file import sensor_to_json
from itree_jax.tree.packing import Arrays, pack, unpack
from itree_jax.tree.tree import InterpretationTree

FORMAT = "itree-jax interpretation tree"
# Raised when a reader of one version would misread files of the other; 3: windows about the middle of the part.
FORMAT_VERSION = 3
HEADER, HEADER_SUM = "header.json", "header.sha256"
FIRST_ZIP_TIME = (1980, 1, 1, 0, 0, 0)  # the time of writing must not change the bytes
ZIP_MAGIC = b"PK\x03\x04"
AGAIN = "Compile the part again (itree compile), or fetch the file again."


def save_tree(tree: InterpretationTree, path: str | Path) -> None:
    """Writes the tree, whole or not at all. Raises ItreeError when the file cannot be written."""
    write_whole(path, tree_bytes(tree))


def tree_bytes(tree: InterpretationTree) -> bytes:
    """The content of the tree's file."""
    arrays: Arrays = {}
    content = pack(tree, arrays)
    stored = {name: _npy_bytes(array) for name, array in sorted(arrays.items())}
    header = _json_bytes(_header(tree, content, stored))
    members = {HEADER: header, HEADER_SUM: _sha256(header).encode()}
    return _zip_bytes(members | {f"{name}.npy": data for name, data in stored.items()})


def load_tree(path: str | Path) -> InterpretationTree:
    """Reads a tree that `save_tree` wrote.

    Raises:
        ItreeError: there is no such file; it is no tree file, of another version, cut short or changed; or what is
            in it does not fit together. The message says which, and what to do.
    """
    path = Path(path)
    members = _read_members(path)
    header = _checked_header(path, members)
    arrays = {name: _checked_array(path, members, name, digest) for name, digest in header["sha256"].items()}
    try:
        return unpack(InterpretationTree, header["tree"], arrays)
    except ValueError as error:
        raise ItreeError(f"{path}: the tree in it is not whole: {error}. {AGAIN}") from error


def _header(tree: InterpretationTree, content: Any, stored: dict[str, bytes]) -> dict[str, Any]:
    part = tree.part
    return {
        "format": FORMAT,
        "version": FORMAT_VERSION,
        "producer": f"itree-jax {_producer_version()}",
        "part": {
            "name": part.name,
            "diameter_mm": part.diameter,
            "unit": part.unit,
            "triangles": len(part.triangles),
            "watertight": part.watertight,
        },
        "sensor": sensor_to_json(tree.sensor),
        "sha256": {name: _sha256(data) for name, data in stored.items()},
        "tree": content,
    }


def _checked_header(path: Path, members: dict[str, bytes]) -> dict[str, Any]:
    try:
        header = json.loads(members[HEADER])
    except (KeyError, ValueError, RecursionError):
        header = None
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise ItreeError(f"{path} is not a tree file: it has no header of one. {AGAIN}")
    found = header.get("version")
    if not isinstance(found, int) or found != FORMAT_VERSION:
        newer = isinstance(found, int) and found > FORMAT_VERSION
        advice = "Upgrade itree-jax, or compile" if newer else "Compile"
        raise ItreeError(
            f"{path} is a tree file of version {found}, written by {header.get('producer')}; this program reads "
            f"version {FORMAT_VERSION}. {advice} the part again with this one."
        )
    if members.get(HEADER_SUM) != _sha256(members[HEADER]).encode():
        raise ItreeError(f"{path}: the header was changed after it was written (checksum). {AGAIN}")
    if not isinstance(header.get("sha256"), dict):
        raise ItreeError(f"{path}: the header lacks the checksums of the arrays. {AGAIN}")
    if "tree" not in header:
        raise ItreeError(f"{path}: the header lacks the tree. {AGAIN}")
    return header


def _checked_array(path: Path, members: dict[str, bytes], name: str, digest: str) -> np.ndarray:
    data = members.get(f"{name}.npy")
    if data is None:
        raise ItreeError(f"{path}: the array {name} is missing. {AGAIN}")
    if _sha256(data) != digest:
        raise ItreeError(f"{path}: the array {name} was changed after it was written (checksum). {AGAIN}")
    try:
        return parse_npy(data, f"{name}.npy")
    except ItreeError as error:
        raise ItreeError(f"{path}: {name}.npy is not an array ({error}). {AGAIN}") from error


def _read_members(path: Path) -> dict[str, bytes]:
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        advice = "make one with `itree compile MODEL --sensor SENSOR -o TREE`"
        raise ItreeError(f"there is no tree file {path}; {advice}") from None
    except OSError as error:
        raise ItreeError(f"{path}: cannot be read ({error})") from error
    if not content.startswith(ZIP_MAGIC):
        raise ItreeError(f"{path} is not a tree file: it does not begin as one. {AGAIN}")
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            return {info.filename: archive.read(info) for info in archive.infolist()}
    except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, ValueError, OSError, LookupError) as error:
        raise ItreeError(f"{path}: the file is cut short or damaged ({error}). {AGAIN}") from error


def _zip_bytes(members: dict[str, bytes]) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_STORED) as archive:  # a compressor's bytes change with its version
        for name, data in members.items():
            info = zipfile.ZipInfo(name, FIRST_ZIP_TIME)
            info.create_system = 3  # Unix, wherever it is written
            info.external_attr = 0o644 << 16
            archive.writestr(info, data)
    return out.getvalue()


def _npy_bytes(array: np.ndarray) -> bytes:
    out = io.BytesIO()
    little = np.ascontiguousarray(array).reshape(array.shape).astype(array.dtype.newbyteorder("<"), copy=False)
    np.lib.format.write_array(out, little, version=(1, 0), allow_pickle=False)
    return out.getvalue()


def _json_bytes(data: Any) -> bytes:
    return (json.dumps(data, indent=1, sort_keys=True, allow_nan=False) + "\n").encode()


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _producer_version() -> str:
    try:
        return version("itree-jax")
    except PackageNotFoundError:  # run from a checkout that is not installed
        return "(not installed)"
