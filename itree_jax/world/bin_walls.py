"""The bin that parts lie in, as an obstacle: a floor and four walls."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from itree_kernels.errors import ItreeError
from itree_kernels.json_file import read_json_object
from itree_kernels.whole_files import write_whole
from jaxtyping import Float

from itree_jax.sensing.json_check import check_json
from itree_jax.sensing.scene_folder import Scene

BIN_FILE = "scene_bin.json"  # beside scene_camera.json; optional
_LENGTH = {"type": "number", "exclusiveMinimum": 0}
BIN_SCHEMA = {
    "type": "object",
    "required": ["inner_size", "wall_height", "wall_thickness"],
    "additionalProperties": False,
    "properties": {
        "inner_size": {"type": "array", "items": _LENGTH, "minItems": 2, "maxItems": 2},
        "wall_height": _LENGTH,
        "wall_thickness": _LENGTH,
        "R_b2w": {"type": "array", "items": {"type": "number"}, "minItems": 9, "maxItems": 9},
        "t_b2w": {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3},
    },
}


@dataclass(frozen=True)
class BinWalls:
    """An open box. Bin frame: origin in the middle of its inner floor, z up."""

    inner_size: tuple[float, float]  # x, y [mm]
    wall_height: float  # [mm] above the inner floor
    wall_thickness: float  # [mm] of walls and floor
    T_cam_bin: Float[np.ndarray, "4 4"]

    @property
    def boxes(self) -> dict[str, tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]]:
        """Lowest and highest corner [mm] of the floor and of each wall, in the bin's frame."""
        (x, y), w, h = np.asarray(self.inner_size) / 2, self.wall_thickness, self.wall_height
        corners = {
            "floor": ((-x - w, -y - w, -w), (x + w, y + w, 0.0)),
            "wall -x": ((-x - w, -y - w, 0.0), (-x, y + w, h)),
            "wall +x": ((x, -y - w, 0.0), (x + w, y + w, h)),
            "wall -y": ((-x, -y - w, 0.0), (x, -y, h)),
            "wall +y": ((-x, y, 0.0), (x, y + w, h)),
        }
        return {name: (np.array(low), np.array(high)) for name, (low, high) in corners.items()}


def load_bin(scene: Scene) -> BinWalls | None:
    """The bin that a scene's folder tells of in `scene_bin.json`; None when it tells none.

    By image number, {"0": {"inner_size": [x, y], "wall_height": h, "wall_thickness": w}} [mm], with "R_b2w" and "t_b2w"
    where the bin's frame isn't the world's. Raises ItreeError about the file, or when the scene doesn't tell where the
    camera stands in the world.
    """
    path = None if scene.folder is None else scene.folder / BIN_FILE
    if path is None or not path.is_file():
        return None
    if scene.R_w2c is None or scene.t_w2c is None:
        raise ItreeError(f"{path}: a bin's place needs the camera's: cam_R_w2c and cam_t_w2c in scene_camera.json")
    entries = read_json_object(path)
    entry = entries.get(str(scene.im_id))
    if entry is None:
        return None
    check_json(entry, BIN_SCHEMA, str(path))
    return bin_in_world(entry, np.asarray(scene.R_w2c), np.asarray(scene.t_w2c))


def bin_in_world(entry: dict, R_w2c: Float[np.ndarray, "3 3"], t_w2c: Float[np.ndarray, "3"]) -> BinWalls:
    """The bin of an entry of `scene_bin.json`, in the frame of a camera."""
    T_cam_world, T_world_bin = np.eye(4), np.eye(4)
    T_cam_world[:3, :3], T_cam_world[:3, 3] = R_w2c, t_w2c
    T_world_bin[:3, :3] = np.array(entry.get("R_b2w", np.eye(3).ravel())).reshape(3, 3)
    T_world_bin[:3, 3] = entry.get("t_b2w", np.zeros(3))
    x, y = entry["inner_size"]
    return BinWalls((float(x), float(y)), entry["wall_height"], entry["wall_thickness"], T_cam_world @ T_world_bin)


def write_bin(
    bin_: BinWalls, folder: Path, im_id: int = 0, T_world_bin: Float[np.ndarray, "4 4"] | None = None
) -> None:
    """Adds `scene_bin.json` to a scene folder; `T_world_bin` None: the world is the bin's frame."""
    entry = {"inner_size": list(bin_.inner_size), "wall_height": bin_.wall_height,
             "wall_thickness": bin_.wall_thickness}  # fmt: skip
    if T_world_bin is not None:
        entry |= {"R_b2w": T_world_bin[:3, :3].ravel().tolist(), "t_b2w": T_world_bin[:3, 3].tolist()}
    write_whole(folder / BIN_FILE, json.dumps({str(im_id): entry}, indent=1) + "\n")
