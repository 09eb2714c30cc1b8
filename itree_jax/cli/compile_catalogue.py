"""`itree compile` of several parts: a folder of trees, one unit of work per part."""

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from itree_kernels.errors import ItreeError

from itree_jax.cli.runtime import start_jax
from itree_jax.cluster import Product, Ran, Unit, digest_of_file, key_of

if TYPE_CHECKING:
    from itree_jax.sensor import Sensor

BUNDLED = "bundled:"


@dataclass(frozen=True)
class Options:
    """What is the same for all parts of a catalogue."""

    units: str | None = None
    policy: str = "measured"
    dome: int = 1
    label_faces: int | None = None
    seed: int = 0


@dataclass(frozen=True)
class CompileTask:
    """One part to compile."""

    model: str
    name: str  # of the tree file
    obj_id: int
    sensor: "Sensor"
    options: Options


def compile_part(task: CompileTask) -> Product:
    """The tree of a part as a file, and what `itree compile` says about it."""
    start_jax()
    from itree_cad.load import load_part

    from itree_jax.compile import compile_tree
    from itree_jax.tree.tree_file import tree_bytes

    options = task.options
    tree = compile_tree(
        load_part(task.model, options.units), task.sensor, obj_id=task.obj_id, policy=options.policy,
        dome_frequency=options.dome, label_faces=options.label_faces, seed=options.seed,
    )  # fmt: skip
    record = {
        "model": task.model, "part": tree.part.name, "obj_id": tree.obj_id, "triangles": len(tree.part.triangles),
        "diameter_mm": tree.part.diameter, "groups": tree.groups.group_count,
        "leaves": int((~tree.groups.pruned).sum()),
    }  # fmt: skip
    return Product({f"{task.name}.tree": tree_bytes(tree)}, record)


def compile_units(models: Sequence[str], sensor: "Sensor", options: Options) -> list[Unit]:
    """A unit per part; a folder stands for the CAD files in it.

    Raises ItreeError when two trees would have one name or one object number.
    """
    from itree_jax.sensing.sensor_file import sensor_to_json

    files = [model for given in models for model in models_in(given)]
    names, numbers = [name_of(model) for model in files], object_numbers(files)
    check_distinct(files, names, "tree of the name")
    check_distinct(files, numbers, "object")
    same = {"sensor": sensor_to_json(sensor), "options": asdict(options), "version": version("itree-jax")}
    return [
        Unit(
            name,
            key_of(model=digests_of_model(model), name=name, obj_id=number, **same),
            CompileTask(model, name, number, sensor, options),
        )
        for model, name, number in zip(files, names, numbers, strict=True)
    ]


def models_in(given: str) -> list[str]:
    """A model, or the CAD files of a folder, sorted. Raises ItreeError for a folder without any."""
    path = Path(given)
    if given.startswith(BUNDLED) or not path.is_dir():
        return [given]
    from itree_cad.load import MESH_SUFFIXES, STEP_SUFFIXES

    found = sorted(str(p) for p in path.iterdir() if p.suffix.lower() in (*STEP_SUFFIXES, *MESH_SUFFIXES))
    if not found:
        raise ItreeError(f"{path}: no CAD file is in this folder")
    return found


def name_of(model: str) -> str:
    return model.removeprefix(BUNDLED) if model.startswith(BUNDLED) else Path(model).stem


def number_in_name(model: str) -> int | None:
    """N of a file called obj_N."""
    named = re.fullmatch(r"obj_(\d+)", Path(model).stem)
    return int(named.group(1)) if named else None


def object_numbers(models: Sequence[str]) -> list[int]:
    """N of a file called obj_N; the others take the numbers that are left, in their order."""
    told = [number_in_name(model) for model in models]
    free = (n for n in range(1, 2 * len(models) + 1) if n not in set(told))
    return [next(free) if number is None else number for number in told]


def check_distinct(models: Sequence[str], values: Sequence[Any], what: str) -> None:
    """Raises ItreeError naming two models of one value."""
    first: dict[Any, str] = {}
    for model, value in zip(models, values, strict=True):
        if value in first:
            raise ItreeError(f"{first[value]} and {model} would both make the {what} {value}; rename one of them")
        first[value] = model


def digests_of_model(model: str) -> list[str]:
    """Of a model's file, and of the one that a part file refers to."""
    if model.startswith(BUNDLED):
        return [model]
    digests = [digest_of_file(model)]
    if Path(model).suffix.lower() == ".json":
        from itree_cad.part_file import read_part_file

        with suppress(ItreeError):  # the work says what is wrong with it
            digests.append(digest_of_file(read_part_file(Path(model)).model))
    return digests


def catalogue_line(ran: Ran, folder: Path) -> str:
    """What a run did, in one line."""
    earlier = f"{ran.resumed} of them by an earlier run, " if ran.resumed else ""
    mean = f", {ran.seconds / len(ran.done):.1f} s per part" if ran.done else ""
    return f"{folder}: {len(ran.done)} trees, {earlier}{ran.seconds:.0f} s of work{mean}"
