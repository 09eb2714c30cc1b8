"""A bin whose settled poses come with the package, so that it can be imaged without a physics engine."""

import json
from dataclasses import asdict
from importlib import resources
from typing import Any, NamedTuple

import numpy as np
from itree_cad.bundled import bundled_part
from itree_kernels.errors import ItreeError
from jaxtyping import Float

from itree_jax.sensing.scene_folder import Scene
from itree_jax.sensing.scene_writer import TrueObject
from itree_jax.sensor import Sensor
from itree_jax.simulate.bin import Bin, camera_above
from itree_jax.simulate.imaging import image_bin

POSES_FILE = "bundled_poses.json"


class SettledBin(NamedTuple):
    part: str  # name of the bundled part
    bin: Bin
    T_bin_obj: Float[np.ndarray, "parts 4 4"]  # [mm]


def bundled_poses() -> SettledBin:
    """Eight of the paper's parts, settled in a bin of 192 x 144 mm."""
    data = json.loads(resources.files("itree_jax.simulate").joinpath(POSES_FILE).read_text(encoding="utf-8"))
    bin_ = Bin(tuple(data["bin"]["inner_size"]), data["bin"]["wall_height"], data["bin"]["wall_thickness"])
    return SettledBin(data["part"], bin_, np.array(data["T_bin_obj"]).reshape(-1, 4, 4))


def settled_to_json(settled: SettledBin, seed: int) -> dict[str, Any]:
    """The content of the file that `bundled_poses` reads."""
    poses = [np.round(T, 9).ravel().tolist() for T in settled.T_bin_obj]
    return {"part": settled.part, "seed": seed, "bin": asdict(settled.bin), "T_bin_obj": poses}


def demo_bin(sensor: Sensor, seed: int) -> tuple[Scene, tuple[TrueObject, ...]]:
    """The bundled bin as `sensor` sees it from above, with the truth; `seed` decides the noise.

    Raises ItreeError when the bin does not fit into the sensor's field of view.
    """
    part_name, bin_, T_bin_obj = bundled_poses()
    _check_in_view(sensor, bin_)
    return image_bin(bundled_part(part_name), T_bin_obj, bin_, sensor, seed=seed)


def demo_scene(sensor: Sensor, seed: int) -> Scene:
    """The scene of `demo_bin` without the truth."""
    return demo_bin(sensor, seed)[0]


def _check_in_view(sensor: Sensor, bin_: Bin) -> None:
    camera = sensor.camera
    corners = np.array([[x, y, bin_.wall_height] for x in (-0.5, 0.5) for y in (-0.5, 0.5)])
    corners[:, :2] *= bin_.inner_size
    T_cam_bin = camera_above(sensor)
    uv = camera.project(corners @ T_cam_bin[:3, :3].T + T_cam_bin[:3, 3])
    if (uv < 0).any() or (uv > np.array([camera.width - 1, camera.height - 1])).any():
        (x, y), scale = bin_.inner_size, sensor.mm_per_px
        raise ItreeError(
            f"the demo's bin, {x:.0f} x {y:.0f} mm, is larger than the field of view, "
            f"{camera.width * scale:.0f} x {camera.height * scale:.0f} mm; take a wider sensor."
        )
