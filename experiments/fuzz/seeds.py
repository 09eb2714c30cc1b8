"""Small files of every kind, as the project writes them."""

import dataclasses
import json
import tempfile
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import cv2
import numpy as np
from jaxtyping import AbstractArray

from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.sensor_file import sensor_to_json
from itree_jax.tree.tree import InterpretationTree
from itree_jax.tree.tree_file import save_tree

SIDE = 2  # of every dimension that has a name
WIDTH, HEIGHT = 16, 12
SENSOR = sensor_to_json(bundled_sensor("bench"))
CAMERA = {
    "cam_K": [80.0, 0.0, 7.5, 0.0, 80.0, 5.5, 0.0, 0.0, 1.0], "depth_scale": 0.1, "cam_kind": "pinhole",
    "cam_R_w2c": [1, 0, 0, 0, -1, 0, 0, 0, -1], "cam_t_w2c": [0, 0, 900],
}  # fmt: skip
IDENTITY = [1, 0, 0, 0, 1, 0, 0, 0, 1]


def scene_files() -> dict[str, bytes]:
    """A scene folder with two cameras, a bin and the truth."""
    rng = np.random.default_rng(0)
    entry = {"obj_id": 1, "cam_R_m2c": IDENTITY, "cam_t_m2c": [0, 0, 880]}
    walls = {"inner_size": [200, 150], "wall_height": 60, "wall_thickness": 5}
    texts = {
        "scene_camera.json": {"0": CAMERA, "1": CAMERA},
        "scene_lights.json": {"0": SENSOR["lights"], "1": SENSOR["lights"]},
        "scene_stereo.json": {"0": {"right": 1}},
        "scene_bin.json": {"0": {**walls, "R_b2w": IDENTITY, "t_b2w": [0, 0, 0]}},
        "scene_gt.json": {"0": [entry]},
        "scene_gt_info.json": {"0": [{"visib_fract": 1.0}]},
    }
    files = {name: json.dumps(data).encode() for name, data in texts.items()}
    for image in range(2):
        for light in range(3):
            files[f"lit/{image:06d}_{light:02d}.png"] = _png(rng.integers(2000, 60000, (HEIGHT, WIDTH)))
    files["depth/000000.png"] = _png(rng.integers(8000, 9000, (HEIGHT, WIDTH)))
    return files


def lights_files() -> list[bytes]:
    """A sensor, its lights alone, near lights, and a depth camera."""
    near = {"positions_mm": [[0, -300, 400], [-300, 200, 400], [300, 200, 400]], "intensities": [1, 2, 1.5]}
    depth = {key: value for key, value in SENSOR.items() if key != "lights"} | {"depth_camera": {"noise_mm": 0.2}}
    more = SENSOR | {"response": {"gamma": 2.2}, "bit_depth": 12, "region_of_interest": [1, 1, 5, 5]}
    exposed = SENSOR | {"lights": {**SENSOR["lights"], "exposure": [1, 2, 3]}}
    return [json.dumps(data).encode() for data in (SENSOR, SENSOR["lights"], near, depth, more, exposed)]


def tree_file() -> bytes:
    """The smallest tree that there is: everything in it is of size two."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.tree"
        save_tree(smallest(InterpretationTree), path)
        return path.read_bytes()


def smallest(annotation: Any) -> Any:
    """A value of a type as the trees' dataclasses have it."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin in (Union, UnionType):
        (only,) = [one for one in arguments if one is not NoneType]
        return smallest(only)
    if origin is tuple:
        items = (arguments[0],) * SIDE if len(arguments) == 2 and arguments[1] is Ellipsis else arguments
        return tuple(smallest(item) for item in items)
    if origin is Literal:
        return arguments[0]
    if dataclasses.is_dataclass(annotation):
        hints = get_type_hints(annotation)
        return annotation(**{field.name: smallest(hints[field.name]) for field in dataclasses.fields(annotation)})
    if isinstance(annotation, type) and issubclass(annotation, AbstractArray):
        shape = [int(size) if size.isdecimal() else SIDE for size in annotation.dim_str.split()]
        return np.zeros(shape, next(kind for kind in ("float32", "int32", "bool") if kind in annotation.dtypes))
    return annotation(1)


def _png(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image.astype(np.uint16))[1].tobytes()
