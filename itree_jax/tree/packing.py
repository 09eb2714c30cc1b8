"""Frozen dataclasses as plain JSON data and named arrays, and back, checked against their annotations.

The fields of the classes are the format: a field that is added later needs no code here. An array's name is the path of
its field, such as `groups.labels`, and of its place in a tuple, such as `distributions.samples.0`.
"""

import dataclasses
import math
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
from jaxtyping import AbstractArray, jaxtyped

Arrays = dict[str, np.ndarray]


def pack(value: Any, arrays: Arrays, where: str = "") -> Any:
    """`value` as JSON data; its arrays are put into `arrays` under their names, and the data tells name, type, shape.

    Raises TypeError for what is neither a dataclass, a tuple, an array, a number, a string nor None.
    """
    if dataclasses.is_dataclass(value):
        return {f.name: pack(getattr(value, f.name), arrays, _inside(where, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, tuple):
        return [pack(item, arrays, _inside(where, str(k))) for k, item in enumerate(value)]
    if isinstance(value, np.ndarray):
        arrays[where] = value
        return {"array": where, **array_kind(value)}
    if isinstance(value, np.generic):
        return pack(value.item(), arrays, where)
    if isinstance(value, float):
        return value if math.isfinite(value) else repr(value)  # JSON has no word for nan and inf
    if value is None or isinstance(value, bool | int | str):
        return value
    raise TypeError(f"{where}: a {type(value).__name__} cannot be stored")


def array_kind(array: np.ndarray) -> dict[str, Any]:
    """Element type, such as "<f4", and shape."""
    return {"dtype": array.dtype.newbyteorder("<").str, "shape": list(array.shape)}


def unpack(annotation: Any, data: Any, arrays: Arrays, where: str = "") -> Any:
    """The value of type `annotation` that `pack` turned into `data` and `arrays`.

    Shapes that name the same dimension within one dataclass must agree. A field that is missing gets its default.

    Raises:
        ValueError: `data` or an array does not fit the annotation; the message begins with the name of the field.
    """
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin in (Union, UnionType):
        return None if data is None else _unpack_optional(arguments, data, arrays, where)
    if origin is tuple:
        return _unpack_tuple(arguments, data, arrays, where)
    if dataclasses.is_dataclass(annotation):
        return _unpack_dataclass(annotation, data, arrays, where)
    if isinstance(annotation, type) and issubclass(annotation, AbstractArray):
        return _unpack_array(annotation, data, arrays, where)
    return _unpack_plain(annotation, data, where)


def _unpack_dataclass(cls: Any, data: Any, arrays: Arrays, where: str) -> Any:
    if not isinstance(data, dict):
        raise ValueError(f"{where or cls.__name__} is not an object")
    hints, values = get_type_hints(cls), {}
    with jaxtyped("context"):  # binds the names of dimensions within the class
        for f in dataclasses.fields(cls):
            if f.name in data:
                values[f.name] = unpack(hints[f.name], data[f.name], arrays, _inside(where, f.name))
            elif f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING:
                raise ValueError(f"{_inside(where, f.name)} is missing")
    return cls(**values)


def _unpack_tuple(items: tuple[Any, ...], data: Any, arrays: Arrays, where: str) -> tuple[Any, ...]:
    if not isinstance(data, list):
        raise ValueError(f"{where} is not a list")
    if len(items) == 2 and items[1] is Ellipsis:
        items = (items[0],) * len(data)
    if len(items) != len(data):
        raise ValueError(f"{where} has {len(data)} entries, not {len(items)}")
    found = []
    for k, (item, entry) in enumerate(zip(items, data, strict=True)):
        with jaxtyped("context"):  # entries of a tuple may differ in their dimensions
            found.append(unpack(item, entry, arrays, _inside(where, str(k))))
    return tuple(found)


def _unpack_array(annotation: Any, data: Any, arrays: Arrays, where: str) -> np.ndarray:
    name = data.get("array") if isinstance(data, dict) else None
    if not isinstance(name, str):
        raise ValueError(f"{where} is not an array")
    if name not in arrays:
        raise ValueError(f"the array {name} is missing")
    array = arrays[name]
    said = {key: data.get(key) for key in ("dtype", "shape")}
    if array_kind(array) != said:
        raise ValueError(f"the array {name} is {array_kind(array)}, its entry says {said}")
    if not isinstance(array, annotation):
        kind = f"{annotation.__name__.split('[')[0]} [{annotation.dim_str}]"
        raise ValueError(f"the array {name} is {array.dtype} {list(array.shape)}, not {kind}")
    return array


def _unpack_optional(choices: tuple[Any, ...], data: Any, arrays: Arrays, where: str) -> Any:
    (only,) = [choice for choice in choices if choice is not NoneType]
    return unpack(only, data, arrays, where)


def _unpack_plain(annotation: Any, data: Any, where: str) -> Any:
    if get_origin(annotation) is Literal:
        fits = data in get_args(annotation)
    elif annotation is float:
        fits = type(data) in (int, float) or data in ("nan", "inf", "-inf")
        data = float(data) if fits else data
    else:
        fits = type(data) is annotation
    if not fits:
        raise ValueError(f"{where} is {data!r}, not {getattr(annotation, '__name__', annotation)}")
    return data


def _inside(where: str, name: str) -> str:
    return f"{where}.{name}" if where else name
