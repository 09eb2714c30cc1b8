"""Readers by name. Each takes the bytes of an input, puts them where a user would, and reads them."""

import random
import tempfile
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from itree_kernels.errors import ItreeError

from fuzz.mutations import Mutate, joined, mutated_files, mutated_tree, parted
from fuzz.seeds import lights_files, scene_files, tree_file

# Everything a target imports is imported here, before a fuzzer starts to count.
from itree_jax.report.truth_view import true_poses
from itree_jax.sensing.light_source import light_source
from itree_jax.sensing.needle_input import load_needle_input
from itree_jax.sensing.scene_folder import load_scene
from itree_jax.sensing.sensor_file import load_sensor
from itree_jax.stereo.second_file import load_second
from itree_jax.tree.tree_file import load_tree
from itree_jax.world.bin_walls import load_bin


@dataclass(frozen=True)
class Target:
    """A reader, inputs to begin with, and how others are made of them."""

    read: Callable[[bytes, Path], None]  # raises what the reader raises; the folder is its own
    seeds: Callable[[], list[bytes]]
    mutate: Callable[[bytes, random.Random, Mutate], bytes]


SCENE_NAMES = tuple(scene_files())


def crash_of(target: Target, data: bytes, folder: Path) -> Exception | None:
    """What the reader raised, unless it is an `ItreeError`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            target.read(data, folder)
        except ItreeError:
            return None
        except Exception as error:
            return error
    return None


def _read_tree(data: bytes, folder: Path) -> None:
    (folder / "a.tree").write_bytes(data)
    load_tree(folder / "a.tree")


def _read_lights(data: bytes, folder: Path) -> None:
    """As a sensor, and as lights alone."""
    path = folder / "lights.json"
    path.write_bytes(data)
    with suppress(ItreeError):
        load_sensor(path)
    light_source(path)


def _read_lights_of_text(data: bytes, folder: Path) -> None:
    for name, content in zip(("light_directions.txt", "light_intensities.txt"), parted(data, 2), strict=True):
        (folder / name).write_bytes(content)
    light_source(folder)


def _read_scene(data: bytes, folder: Path) -> None:
    """Each of the doors through which a scene folder is read."""
    scene_folder = folder / "000001"
    for name, content in zip(SCENE_NAMES, parted(data, len(SCENE_NAMES)), strict=True):
        path = scene_folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if content:
            path.write_bytes(content)
        else:
            path.unlink(missing_ok=True)
    scene = load_scene(scene_folder)
    for read in (load_second, load_bin, true_poses, lambda scene: load_needle_input(scene.folder)):
        with suppress(ItreeError):
            read(scene)


def _text_lights() -> list[bytes]:
    directions = b"0 0.6 0.8\n-0.48 -0.36 0.8\n0.48 -0.36 0.8\n"
    return [joined([directions, b"1 1 1\n2 2 2\n1 2 3\n"]), joined([directions, b"1\n2\n1\n"])]


TARGETS = {
    "tree file": Target(_read_tree, lambda: [tree_file()], mutated_tree),
    "scene folder": Target(
        _read_scene, lambda: [joined(list(scene_files().values()))],
        lambda data, rng, by_bytes: mutated_files(data, len(SCENE_NAMES), rng, by_bytes),
    ),
    "lights and sensors": Target(
        _read_lights, lights_files, lambda data, rng, by_bytes: mutated_files(data, 1, rng, by_bytes)
    ),
    "lights as text": Target(
        _read_lights_of_text, _text_lights, lambda data, rng, by_bytes: mutated_files(data, 2, rng, by_bytes)
    ),
}  # fmt: skip


def some_bytes(data: bytes, seed: int) -> bytes:
    """A change of a few bytes, for where there is no fuzzer to make it."""
    rng, changed = random.Random(seed), bytearray(data)
    for _ in range(rng.choice((1, 2, 8))):
        at = rng.randrange(len(changed) + 1)
        if rng.random() < 0.3:
            del changed[at : at + rng.choice((1, 4, 100))]
        elif rng.random() < 0.5:
            changed[at:at] = rng.randbytes(rng.choice((1, 4)))
        else:
            changed[at : at + 1] = rng.randbytes(1)
    return bytes(changed)


def without_guidance(name: str, count: int, seed: int = 0) -> dict[str, Exception]:
    """Crashes by where they come from, of `count` inputs made at random from the seeds and from one another."""
    target, rng = TARGETS[name], random.Random(seed)
    pool, found = target.seeds(), {}
    with tempfile.TemporaryDirectory() as folder:
        for data in list(pool):
            assert crash_of(target, data, Path(folder)) is None
        for _ in range(count):
            data = target.mutate(rng.choice(pool), rng, some_bytes)
            error = crash_of(target, data, Path(folder))
            if error is not None:
                found.setdefault(place_of(error), error)
            elif rng.random() < 0.05:
                pool.append(data)
    return found


def place_of(error: Exception) -> str:
    """Kind and line: crashes of one place count once."""
    import traceback

    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if "itree_" in frame.filename] or frames
    return f"{type(error).__name__} at {Path(own[-1].filename).name}:{own[-1].lineno}"
