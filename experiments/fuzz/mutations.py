"""Other files made from given ones: bytes for a fuzzer without a sense of form, JSON and tree files for one with it."""

import hashlib
import io
import json
import random
import zipfile
from collections.abc import Callable
from typing import Any

import numpy as np

SEPARATOR = b"\n\x1e\n"  # between the files of a folder; the JSON files come first, so that images may hold it
ODD: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2, 3, 10**6, 2**31, 2**63, 10**400, 1e-320, 1e308, -1e308, float("nan"), float("inf"),
    "", "a", "0", "\x00", "é" * 50, "../../etc/passwd", [], [[]], {}, [1, 2], [0] * 9, {"0": {}}, [[0, 0, -1]] * 3,
)  # fmt: skip
Mutate = Callable[[bytes, int], bytes]


def joined(files: list[bytes]) -> bytes:
    """Files as one input."""
    return SEPARATOR.join(files)


def parted(data: bytes, count: int) -> list[bytes]:
    """The files of an input; what is not there is empty."""
    found = data.split(SEPARATOR, count - 1)
    return found + [b""] * (count - len(found))


def mutated_json(data: bytes, rng: random.Random) -> bytes | None:
    """A JSON text with one or a few of its values changed; None if it is no JSON."""
    try:
        value = json.loads(data)
    except (ValueError, RecursionError):
        return None
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        value = _changed(value, rng)
    return json.dumps(value).encode()


def mutated_files(data: bytes, count: int, rng: random.Random, by_bytes: Mutate) -> bytes:
    """An input of several files with one of them changed, in form if it is JSON and chance has it, else in bytes."""
    files = parted(data, count)
    k = rng.randrange(count)
    changed = mutated_json(files[k], rng) if rng.random() < 0.8 else None
    files[k] = by_bytes(files[k], rng.randrange(2**31)) if changed is None else changed
    return joined(files)


def mutated_tree(data: bytes, rng: random.Random, by_bytes: Mutate) -> bytes:
    """A tree file with another header or array and the right checksums, as by someone who knows the format; or, by
    chance, with other bytes anywhere."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = {info.filename: archive.read(info) for info in archive.infolist()}
        header = json.loads(members["header.json"])
        sums = header["sha256"]
        if rng.random() < 0.1 or not members or not isinstance(sums, dict):
            raise ValueError("by bytes")
    except Exception:  # whatever zipfile and json trip over: it is no tree file whose form could be kept
        return by_bytes(data, rng.randrange(2**31))
    arrays = [name for name in members if name.endswith(".npy")]
    if arrays and rng.random() < 0.4:
        name = rng.choice(arrays)
        members[name] = by_bytes(members[name], rng.randrange(2**31)) if rng.random() < 0.5 else _other_array(rng)
    else:
        header = _changed(header, rng)
    return _zipped(members, header)


def _zipped(members: dict[str, bytes], header: Any) -> bytes:
    sums = header.get("sha256") if isinstance(header, dict) else None
    for name in list(sums) if isinstance(sums, dict) else []:
        if f"{name}.npy" in members:
            sums[name] = hashlib.sha256(members[f"{name}.npy"]).hexdigest()
    members["header.json"] = json.dumps(header).encode()
    members["header.sha256"] = hashlib.sha256(members["header.json"]).hexdigest().encode()
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, content in members.items():
            archive.writestr(zipfile.ZipInfo(name), content)
    return out.getvalue()


def _other_array(rng: random.Random) -> bytes:
    shape = tuple(rng.choice((0, 1, 2, 3)) for _ in range(rng.randrange(4)))
    out = io.BytesIO()
    np.save(out, np.zeros(shape, rng.choice(("f4", "f8", "i4", "i8", "?", "u1", "c8", "S3", "M8[s]", ">f4"))))
    return out.getvalue()


def _changed(value: Any, rng: random.Random) -> Any:
    """The value with a change somewhere in it."""
    if isinstance(value, dict) and value and rng.random() < 0.9:
        key = rng.choice(list(value))
        dice = rng.random()
        if dice < 0.1:
            return {k: v for k, v in value.items() if k != key}
        if dice < 0.15:
            return {**value, f"{key}{rng.choice(('', 'x', '0'))}": rng.choice(ODD)}
        return {**value, key: _changed(value[key], rng)}
    if isinstance(value, list) and value and rng.random() < 0.8:
        k = rng.randrange(len(value))
        dice = rng.random()
        if dice < 0.1:
            return value[:k] + value[k + 1 :]
        if dice < 0.2:
            return [*value, value[k]]
        return [*value[:k], _changed(value[k], rng), *value[k + 1 :]]
    if isinstance(value, (int, float)) and not isinstance(value, bool) and rng.random() < 0.5:
        return rng.choice((-value, 0.001 * value, 25.4 * value, 1000.0 * value)) if abs(value) < 1e300 else 1.0
    return rng.choice(ODD)
