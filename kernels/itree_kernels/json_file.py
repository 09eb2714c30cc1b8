"""JSON from disk, and lists in it as arrays of numbers; what cannot be read is told with the file's name."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from itree_kernels.errors import ItreeError


def read_json(path: Path) -> Any:
    """What a JSON file holds. Raises ItreeError if it cannot be read."""
    try:
        return parse_json(path.read_bytes(), str(path))
    except OSError as error:
        raise ItreeError(f"{path}: cannot be read as JSON ({error.strerror})") from error


def read_json_object(path: Path) -> dict[str, Any]:
    """Raises ItreeError if the file cannot be read, or holds anything but an object."""
    data = read_json(path)
    if not isinstance(data, dict):
        raise ItreeError(f"{path}: a JSON object is expected, it is {data!r:.80}")
    return data


def parse_json(text: bytes | str, where: str) -> Any:
    """The value of a JSON text in UTF-8, with or without a byte order mark. Raises ItreeError; `where` names it."""
    try:
        return json.loads(text.decode("utf-8-sig") if isinstance(text, bytes) else text)
    except RecursionError:
        raise ItreeError(f"{where}: cannot be read as JSON (it is nested too deeply)") from None
    except ValueError as error:  # of syntax, of UTF-8, or a number of thousands of digits
        raise ItreeError(f"{where}: cannot be read as JSON ({error})") from error


def as_numbers(value: object, where: str) -> Float[np.ndarray, "..."]:
    """`value` (nested lists) as an array. Raises ItreeError if it is none of numbers; they may be infinite or NaN."""
    try:
        found = np.asarray(value)
        if found.dtype.kind not in "iufO":
            raise ValueError(f"it is {value!r:.60}")
        return found.astype(np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ItreeError(f"{where} must be numbers ({error})") from error
