"""Check a JSON value against a JSON Schema: the words that this project's schemas use, with clear messages."""

import math
from collections.abc import Mapping
from typing import Any

from itree_kernels.errors import ItreeError

_TYPES: dict[str, tuple[type, ...]] = {
    "object": (dict,), "array": (list,), "string": (str,), "number": (int, float), "integer": (int,),
}  # fmt: skip


def check_json(value: Any, schema: Mapping[str, Any], where: str, key: str = "") -> None:
    """Raise `ItreeError` naming the file (`where`) and the key if `value` does not follow `schema`.

    Understands type, enum, anyOf, required, properties, additionalProperties, items, minItems, maxItems, minLength,
    minimum, maximum, exclusiveMinimum and exclusiveMaximum (JSON Schema draft 2020-12).
    """
    if "anyOf" in schema:
        return _check_any(value, schema["anyOf"], where, key)
    if "type" in schema and not _is_type(value, schema["type"]):
        raise ItreeError(f"{where}: {_name(key)} must be of type {schema['type']}, it is {value!r:.80}")
    if "enum" in schema and value not in schema["enum"]:
        raise ItreeError(f"{where}: {_name(key)} must be one of {', '.join(schema['enum'])}, it is {value!r:.80}")
    if isinstance(value, dict):
        _check_object(value, schema, where, key)
    elif isinstance(value, list):
        _check_array(value, schema, where, key)
    elif isinstance(value, (int, float)):
        _check_number(value, schema, where, key)
    elif isinstance(value, str) and len(value) < schema.get("minLength", 0):
        raise ItreeError(f"{where}: {_name(key)} must not be empty")


def _name(key: str) -> str:
    return f"'{key}'" if key else "the file"


def _is_type(value: Any, type_name: str) -> bool:
    return isinstance(value, _TYPES[type_name]) and not isinstance(value, bool)


def _is_finite(value: int | float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond what a float holds
        return False


def _check_any(value: Any, alternatives: list[Mapping[str, Any]], where: str, key: str) -> None:
    for schema in alternatives:
        if _is_type(value, schema["type"]):
            return check_json(value, schema, where, key)
    types = " or ".join(schema["type"] for schema in alternatives)
    raise ItreeError(f"{where}: {_name(key)} must be of type {types}, it is {value!r:.80}")


def _check_object(value: dict[str, Any], schema: Mapping[str, Any], where: str, key: str) -> None:
    prefix = f"{key}." if key else ""
    known = schema.get("properties", {})
    for name in schema.get("required", ()):
        if name not in value:
            raise ItreeError(f"{where}: the key '{prefix}{name}' is missing")
    for name, item in value.items():
        if name in known:
            check_json(item, known[name], where, prefix + name)
        elif schema.get("additionalProperties", True) is False:
            raise ItreeError(f"{where}: the key '{prefix}{name}' is not known here; known are {', '.join(known)}")


def _check_array(value: list[Any], schema: Mapping[str, Any], where: str, key: str) -> None:
    least, most = schema.get("minItems", 0), schema.get("maxItems", math.inf)
    if not least <= len(value) <= most:
        wanted = f"{least}" if least == most else f"at least {least}" if len(value) < least else f"at most {most}"
        raise ItreeError(f"{where}: {_name(key)} must have {wanted} items, it has {len(value)}")
    for i, item in enumerate(value):
        check_json(item, schema.get("items", {}), where, f"{key}[{i}]")


def _check_number(value: int | float, schema: Mapping[str, Any], where: str, key: str) -> None:
    bounds = (
        ("minimum", "at least", lambda bound: value >= bound),
        ("maximum", "at most", lambda bound: value <= bound),
        ("exclusiveMinimum", "more than", lambda bound: value > bound),
        ("exclusiveMaximum", "less than", lambda bound: value < bound),
    )
    if not _is_finite(value):
        raise ItreeError(f"{where}: {_name(key)} must be a finite number, it is {value!s:.40}")
    for word, phrase, holds in bounds:
        if word in schema and not holds(schema[word]):
            raise ItreeError(f"{where}: {_name(key)} must be {phrase} {schema[word]}, it is {value}")
