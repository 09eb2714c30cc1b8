"""A data set of simulated bins in the BOP layout with the lights beside it, as real scenes have it."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from itree_cad.part import Part
from itree_cad.symmetry import symmetries
from itree_kernels.errors import ItreeError
from itree_kernels.json_file import read_json_object
from itree_kernels.whole_files import write_whole
from jaxtyping import Float
from trimesh.exchange.ply import export_ply

from itree_jax.sensing.scene_writer import write_scene
from itree_jax.sensor import Sensor
from itree_jax.simulate.bin import Bin, bin_for, walls_of
from itree_jax.simulate.imaging import LOOKS, ImageNoise, Look, image_bin
from itree_jax.simulate.settle import settle
from itree_jax.world.bin_walls import write_bin

LEVEL = "S"  # of scenes.json: simulated here, by the renderer that also makes the trees' appearances
ATTEMPTS = 5  # to find a drop that leaves a part in the bin


def simulate(
    part: Part,
    sensor: Sensor,
    scenes: int,
    parts_per_scene: int,
    out: str | Path,
    *,
    seed: int = 0,
    look: Look = LOOKS["lambert"],
    noise: ImageNoise = ImageNoise(),  # noqa: B008 (frozen)
    obj_id: int = 1,
    second_camera: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Drops parts into bins and writes the data set `out`: models, scenes 1, 2, ... with their truth, scenes.json.

    `parts_per_scene` are dropped; those that fall past the bin are not in the truth. One part alone makes scenes of
    kind "isolated". `second_camera` [mm]: a camera like the first one stands so far to its right, parallel.
    `progress(done, scenes)` is called after each scene. The same seed gives the same data set.

    Raises ItreeError if the physics engine (extra `sim`) is missing, the part has no room in the field of view, a
    number is not positive, or `out` exists and is not empty.
    """
    out = Path(out)
    if scenes < 1 or parts_per_scene < 1:
        raise ItreeError(f"{scenes} scenes of {parts_per_scene} parts cannot be made; both numbers must be at least 1.")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise ItreeError(f"{out}: exists and is not an empty folder; remove it or choose another one.")
    bin_ = bin_for(sensor, part.diameter)
    records: dict[str, Any] = {}
    for scene_id, sequence in enumerate(np.random.SeedSequence(seed).spawn(scenes), start=1):
        drop_seed, image_seed, second_seed = sequence.generate_state(3).tolist()
        T_bin_obj = _drop(part, parts_per_scene, bin_, drop_seed)
        if scene_id == 1:
            write_model(part, obj_id, out / "models")  # not before the engine has proved to be there
            (out / "test").mkdir()
        scene, truth = image_bin(
            part, T_bin_obj, bin_, sensor, look, noise, seed=image_seed, scene_id=scene_id, obj_id=obj_id
        )
        right = None
        if second_camera is not None:
            right, _ = image_bin(
                part, T_bin_obj, bin_, sensor, look, noise, seed=second_seed, scene_id=scene_id, obj_id=obj_id,
                aside=second_camera, im_id=1,
            )
        write_scene(out / "test" / f"{scene_id:06d}", scene, truth, right=right)
        write_bin(walls_of(bin_, sensor), out / "test" / f"{scene_id:06d}")
        records[f"{scene_id:06d}"] = {
            "obj_id": obj_id, "part": part.name, "level": LEVEL, "kind": "isolated" if parts_per_scene == 1 else "bin",
            "lights": sensor.light_count, "material": look.name, "instances": len(truth),
            "physics": {"dropped": parts_per_scene, "kept": len(truth)},
        }  # fmt: skip
        if progress is not None:
            progress(scene_id, scenes)
    _write_json(out / "scenes.json", records)


def _drop(part: Part, count: int, bin_: Bin, seed: int) -> Float[np.ndarray, "kept 4 4"]:
    for attempt in range(ATTEMPTS):
        T_bin_obj = settle(part, count, bin_, seed + attempt)
        if len(T_bin_obj):
            return T_bin_obj
    raise ItreeError(f"none of {count} parts '{part.name}' stayed in the bin in {ATTEMPTS} drops; take a wider sensor.")


def write_model(part: Part, obj_id: int, folder: Path) -> None:
    """Adds a part's mesh and its entry of models_info.json to a data set's folder of models."""
    folder.mkdir(parents=True, exist_ok=True)
    mesh = trimesh.Trimesh(part.vertices, part.triangles, process=False)
    write_whole(folder / f"obj_{obj_id:06d}.ply", export_ply(mesh))
    path = folder / "models_info.json"
    known = read_json_object(path) if path.is_file() else {}
    _write_json(path, known | {str(obj_id): model_info(part)})


def model_info(part: Part) -> dict[str, Any]:
    """The part's entry of BOP's models_info.json [mm]."""
    low, high = part.vertices.min(axis=0), part.vertices.max(axis=0)
    info: dict[str, Any] = {"diameter": part.diameter}
    info |= {f"min_{axis}": float(low[i]) for i, axis in enumerate("xyz")}
    info |= {f"size_{axis}": float(high[i] - low[i]) for i, axis in enumerate("xyz")}
    found = symmetries(part)
    if len(found.discrete) > 1:  # the first is the identity, which BOP leaves out
        info["symmetries_discrete"] = [T.ravel().tolist() for T in found.discrete[1:]]
    if found.continuous:
        info["symmetries_continuous"] = [
            {"axis": axis.tolist(), "offset": offset.tolist()} for axis, offset in found.continuous
        ]
    return info


def _write_json(path: Path, data: dict[str, Any]) -> None:
    write_whole(path, json.dumps(data, indent=1) + "\n")
