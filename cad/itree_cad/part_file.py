"""A part file: a small JSON beside a model that says what the model's file cannot."""

from dataclasses import dataclass, replace
from pathlib import Path

from itree_kernels.errors import ItreeError
from itree_kernels.json_file import read_json

from itree_cad.part import Part
from itree_cad.units import unit_factor

_KEYS = {"model", "units", "solid", "identifying_faces", "obj_id", "name"}


@dataclass(frozen=True)
class PartFile:
    """`{"model": "bolt.step", "units": "mm", "solid": "bolt", "identifying_faces": [0, 2], "obj_id": 1, "name": "b"}`

    Only `model` is needed; it is relative to the part file, or `bundled:NAME`.
    """

    path: Path
    model: str  # absolute, or bundled:NAME
    units: str | None = None
    solid: str | int | None = None
    identifying_faces: tuple[int, ...] | None = None  # component faces with a digit in the shape label, area order
    obj_id: int | None = None  # BOP's number of the object
    name: str | None = None


def read_part_file(path: str | Path) -> PartFile:
    """Reads and checks a part file; ItreeError names the entry that is wrong."""
    path = Path(path)
    try:
        entries = read_json(path)
    except ItreeError as error:
        raise ItreeError(f"no part file: {error}") from error
    if not isinstance(entries, dict) or not isinstance(entries.get("model"), str):
        raise ItreeError(f'{path} is no part file: it needs "model", the relative path of a CAD file')
    if unknown := sorted(set(entries) - _KEYS):
        raise ItreeError(f"{path} has unknown entries {', '.join(unknown)}; a part file has {', '.join(sorted(_KEYS))}")
    if entries["model"].endswith(".json"):
        raise ItreeError(f"{path}: the model of a part file is a CAD file, not another JSON file")
    _check(path, "units", entries.get("units"), str)
    if entries.get("units") is not None:
        unit_factor(entries["units"])
    _check(path, "solid", entries.get("solid"), (str, int))
    _check(path, "obj_id", entries.get("obj_id"), int)
    _check(path, "name", entries.get("name"), str)
    faces = entries.get("identifying_faces")
    _check(path, "identifying_faces", faces, list)
    for face in faces or []:
        _check(path, "identifying_faces", face, int)
    model = entries["model"] if entries["model"].startswith("bundled:") else str(path.parent / entries["model"])
    named = None if faces is None else tuple(faces)
    rest = {key: entries.get(key) for key in ("units", "solid", "obj_id", "name")}
    return PartFile(path=path, model=model, identifying_faces=named, **rest)


def _check(path: Path, key: str, value: object, kind: type | tuple[type, ...]) -> None:
    if value is not None and (not isinstance(value, kind) or isinstance(value, bool)):
        raise ItreeError(f'{path}: "{key}" cannot be {value!r}')


def with_identifying_faces(part: Part, file: PartFile) -> Part:
    """The part under the file's name and with its identifying faces, sorted into area order."""
    faces = part.identifying_faces
    if file.identifying_faces is not None:
        faces = tuple(sorted(set(file.identifying_faces)))
        if not faces or faces[0] < 0 or faces[-1] >= part.face_count:
            raise ItreeError(
                f"{file.path}: identifying_faces must be among the part's faces 0..{part.face_count - 1}, "
                f"not {list(file.identifying_faces)}"
            )
    return replace(part, name=file.name or part.name, identifying_faces=faces)
