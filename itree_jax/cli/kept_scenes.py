"""What `itree recognize` knows of the scenes that are done, on disk, so that a stopped run can be gone on with.

    run.json              what the run depends on beside the scenes: trees, options, version
    scenes/NAME.json      a scene's answers, grasps, corrected lights and its card for the index; key of its files
    pages/, models/       its page and its world model

A scene's record is written last: one that has it is done. All outputs are made of these files, whether a run was
stopped or not, so that both give the same bytes (but for the seconds that a scene took).
"""

import base64
import hashlib
import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from itree_kernels.errors import ItreeError
from itree_kernels.json_file import read_json_object
from itree_kernels.whole_files import folder_beside, write_whole

if TYPE_CHECKING:
    from itree_jax.refinement.self_calibration import SelfCalibration
    from itree_jax.report import IndexEntry

RUN = "run.json"


@dataclass(frozen=True)
class DoneScene:
    """One scene that is recognised."""

    name: str  # of its folder
    answers: dict[str, Any]  # results document of the scene alone
    grasps: dict[str, Any] | None
    card: "IndexEntry | None"
    lights: "SelfCalibration | None"  # without the parts that it is from


class KeptScenes:
    """The scenes that are done, in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.pages, self.models, self._records = folder / "pages", folder / "models", folder / "scenes"
        try:
            for each in (folder, self.pages, self.models, self._records):
                each.mkdir(exist_ok=True)
        except OSError as error:
            raise ItreeError(f"{folder}: cannot be written ({error.strerror})") from error

    def check_run(self, **inputs: Any) -> None:
        """Raises ItreeError if the folder holds what another run found: with other trees, options or version."""
        inputs = json.loads(json.dumps({**inputs, "version": version("itree-jax")}))
        path = self.folder / RUN
        if not path.exists():
            write_whole(path, json.dumps(inputs, indent=1) + "\n")
            return
        before = read_json_object(path)
        differs = [name for name in inputs if name not in before or before[name] != inputs[name]]
        if differs:
            raise ItreeError(
                f"{self.folder} keeps the scenes of a run that was stopped, with other {', '.join(differs)}. Give the "
                "same command again to go on with it, or remove that folder to begin anew"
            )

    def find(self, scene: Path) -> DoneScene | None:
        """A scene as an earlier run left it; None if it did not come so far, or the scene's files have changed."""
        path = self._record(scene)
        if not path.is_file():
            return None
        try:
            said = read_json_object(path)
            return _from_json(scene.name, said, self.pages) if said["key"] == key_of_files(scene) else None
        except (ItreeError, KeyError, TypeError, ValueError):  # not what `keep` wrote: the scene is done again
            return None

    def keep(self, scene: Path, done: DoneScene) -> None:
        """Raises ItreeError when it cannot be written."""
        write_whole(self._record(scene), json.dumps({"key": key_of_files(scene), **_to_json(done)}) + "\n")

    def _record(self, scene: Path) -> Path:
        return self._records / f"{scene.name}.json"


@contextmanager
def kept_scenes(output: Path, resume: bool) -> Iterator[KeptScenes]:
    """Beside `output`: a folder of its name and `.progress`, gone when the block ends well; or, if the run is not to be
    gone on with, one that is gone in any case."""
    if not resume:
        with folder_beside(output) as folder:
            yield KeptScenes(folder)
        return
    folder = output.with_name(f"{output.name}.progress")
    yield KeptScenes(folder)
    shutil.rmtree(folder)


def key_of_files(folder: Path) -> str:
    """Of the names and contents of all files in a scene's folder."""
    found = hashlib.sha256()
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        found.update(f"{path.relative_to(folder)}\0{digest_of(path)}\n".encode())
    return found.hexdigest()


def digest_of(path: Path) -> str:
    """sha256 of a file. Raises ItreeError if it cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise ItreeError(f"{path}: cannot be read ({error.strerror})") from error


def _to_json(done: DoneScene) -> dict[str, Any]:
    return {
        "answers": done.answers, "grasps": done.grasps,
        "card": None if done.card is None else _card_to_json(done.card),
        "lights": None if done.lights is None else _lights_to_json(done.lights),
    }  # fmt: skip


def _from_json(name: str, said: dict[str, Any], pages: Path) -> DoneScene:
    card = None if said["card"] is None else _card_from_json(said["card"], pages)
    lights = None if said["lights"] is None else _lights_from_json(said["lights"])
    return DoneScene(name, said["answers"], said["grasps"], card, lights)


def _card_to_json(card: "IndexEntry") -> dict[str, Any]:
    return {**asdict(card), "page": card.page.name, "thumbnail": _array_to_json(card.thumbnail)}


def _card_from_json(said: dict[str, Any], pages: Path) -> "IndexEntry":
    from itree_jax.report import IndexEntry

    return IndexEntry(**{**said, "page": pages / said["page"], "thumbnail": _array_from_json(said["thumbnail"])})


def _lights_to_json(found: "SelfCalibration") -> dict[str, Any]:
    from itree_jax.tree.packing import Arrays, pack

    arrays: Arrays = {}
    told = replace(found.told, region_of_interest=None)
    data = pack(replace(found, parts=(), told=told, sensor=told), arrays)
    return {"data": data, "arrays": {name: _array_to_json(array) for name, array in arrays.items()}}


def _lights_from_json(said: dict[str, Any]) -> "SelfCalibration":
    from itree_jax.refinement.self_calibration import SelfCalibration
    from itree_jax.tree.packing import unpack

    arrays = {name: _array_from_json(array) for name, array in said["arrays"].items()}
    return unpack(SelfCalibration, said["data"], arrays)


def _array_to_json(array: np.ndarray) -> dict[str, Any]:
    content = base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()
    return {"dtype": array.dtype.str, "shape": list(array.shape), "content": content}


def _array_from_json(said: dict[str, Any]) -> np.ndarray:
    content = np.frombuffer(base64.b64decode(said["content"]), said["dtype"])
    return content.reshape(said["shape"]).copy()
