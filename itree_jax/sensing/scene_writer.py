"""`Scene` and its true poses -> a scene folder in the BOP layout with the lights beside it."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from itree_kernels.errors import ItreeError
from itree_kernels.whole_files import whole_folder
from jaxtyping import Float

from itree_jax.sensing.image_file import png_bytes
from itree_jax.sensing.scene_folder import Scene
from itree_jax.sensor import Sensor

FULL_SCALE = 65535
DEPTH_SCALE = 0.1  # [mm] per step: up to 6.5 m


@dataclass(frozen=True)
class TrueObject:
    """One object of a scene whose pose is known."""

    obj_id: int
    R_cam_obj: Float[np.ndarray, "3 3"]
    t_cam_obj: Float[np.ndarray, "3"]  # [mm]
    px_count_all: int  # pixels of the object alone
    px_count_visib: int  # of these, pixels that nothing hides
    bbox_visib: tuple[int, int, int, int]  # x, y, width, height [px]; -1 -1 -1 -1 where nothing is visible

    @property
    def visib_fract(self) -> float:
        return self.px_count_visib / self.px_count_all if self.px_count_all else 0.0


def write_scene(
    folder: str | Path,
    scene: Scene,
    truth: Sequence[TrueObject] | None = (),
    *,
    depth_scale: float = DEPTH_SCALE,
    overwrite: bool = False,
    right: Scene | None = None,
) -> None:
    """Write a scene and the true poses of its objects. The folder appears whole or not at all.

    Images are stored as 16-bit PNG as their sensor would: 1.0 is the full scale of its bit depth (65535 if it tells
    none; beyond is clipped), with its response. Distortion is left as it is in the images. Depth is stored in steps of
    `depth_scale` [mm]. `right` is what a second camera saw (another `im_id`; both must tell their pose in the world).
    With `truth` None the files of the truth are left out: it is not known.
    The folder's name should be the scene id in six digits. Raises `ItreeError` if it exists (unless `overwrite`),
    cannot be written, a depth does not fit 16 bits, or the second camera's pose or number is missing.
    """
    folder = Path(folder)
    if folder.exists() and not overwrite:
        raise ItreeError(f"{folder}: exists already; remove it or choose another output folder")
    contents = _contents(scene, truth, depth_scale) if right is None else _both(scene, right, truth, depth_scale)
    with whole_folder(folder) as stage:
        for name, content in contents.items():
            path = stage / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)


def _both(scene: Scene, right: Scene, truth: Sequence[TrueObject] | None, depth_scale: float) -> dict[str, bytes]:
    """File content of a scene with two cameras; the truth is told in the first one's frame."""
    if right.im_id == scene.im_id or scene.t_w2c is None or right.t_w2c is None:
        raise ItreeError(
            f"scene {scene.scene_id}: a second camera needs an image number of its own (not {scene.im_id}), and both "
            "cameras their pose in the world (R_w2c, t_w2c)"
        )
    entries = [_entries(one, depth_scale) for one in (scene, right)]
    entries[0] |= _truth_entries(truth)
    named = {name: {str(one.im_id): part[name] for one, part in zip((scene, right), entries, strict=True)
                    if name in part} for name in entries[0]}  # fmt: skip
    named["scene_stereo.json"] = {str(scene.im_id): {"right": right.im_id}}
    files = {name: _json(data) for name, data in named.items()}
    return files | _image_files(scene, depth_scale) | _image_files(right, depth_scale)


def _contents(scene: Scene, truth: Sequence[TrueObject] | None, depth_scale: float) -> dict[str, bytes]:
    """File content by name, relative to the scene folder."""
    entries = _entries(scene, depth_scale) | _truth_entries(truth)
    files = {name: _json({str(scene.im_id): entry}) for name, entry in entries.items()}
    return files | _image_files(scene, depth_scale)


def _entries(scene: Scene, depth_scale: float) -> dict[str, Any]:
    """What the JSON files tell of one camera image, by file."""
    entries = {"scene_camera.json": _camera_entry(scene, depth_scale)}
    return entries if scene.sensor.is_depth_camera else entries | {"scene_lights.json": lights_entry(scene.sensor)}


def _truth_entries(truth: Sequence[TrueObject] | None) -> dict[str, Any]:
    if truth is None:
        return {}
    return {
        "scene_gt.json": [_pose_entry(true) for true in truth],
        "scene_gt_info.json": [_visibility_entry(true) for true in truth],
    }


def _image_files(scene: Scene, depth_scale: float) -> dict[str, bytes]:
    full_scale = FULL_SCALE if scene.sensor.bit_depth is None else 2**scene.sensor.bit_depth - 1
    files = {}
    for k, image in enumerate(scene.images):
        response = np.clip(image.astype(np.float64), 0.0, 1.0) ** (1.0 / scene.sensor.gamma)
        files[f"lit/{scene.im_id:06d}_{k:02d}.png"] = png_bytes(np.round(response * full_scale).astype(np.uint16))
    if scene.depth is not None:
        files[f"depth/{scene.im_id:06d}.png"] = png_bytes(_depth_steps(scene, depth_scale))
    return files


def _depth_steps(scene: Scene, depth_scale: float) -> np.ndarray:
    assert scene.depth is not None
    steps = np.round(np.nan_to_num(scene.depth.astype(np.float64)) / depth_scale)
    if steps.min(initial=0) < 0 or steps.max(initial=0) > FULL_SCALE:
        raise ItreeError(
            f"scene {scene.scene_id}: depths from {scene.depth.min():.4g} to {scene.depth.max():.4g} mm do not fit "
            f"16 bits in steps of {depth_scale} mm; choose a larger depth_scale"
        )
    return steps.astype(np.uint16)


def _camera_entry(scene: Scene, depth_scale: float) -> dict[str, Any]:
    c = scene.sensor.camera
    entry: dict[str, Any] = {"cam_K": [c.fx, 0.0, c.cx, 0.0, c.fy, c.cy, 0.0, 0.0, 1.0], "depth_scale": depth_scale}
    if c.is_orthographic:
        entry["cam_kind"] = c.kind  # BOP knows pinhole cameras only
    if scene.R_w2c is not None:
        entry["cam_R_w2c"] = np.ravel(scene.R_w2c).tolist()
    if scene.t_w2c is not None:
        entry["cam_t_w2c"] = np.ravel(scene.t_w2c).tolist()
    return entry


def lights_entry(sensor: Sensor) -> dict[str, Any]:
    """The JSON object of a sensor's lights: distant ones by direction, near ones by position."""
    near = sensor.light_positions
    place = {"directions": sensor.light_directions.tolist()} if near is None else {"positions_mm": near.tolist()}
    return {**place, "intensities": sensor.light_intensities.tolist()}


def _pose_entry(true: TrueObject) -> dict[str, Any]:
    R, t = np.ravel(true.R_cam_obj).tolist(), np.ravel(true.t_cam_obj).tolist()
    return {"obj_id": true.obj_id, "cam_R_m2c": R, "cam_t_m2c": t}


def _visibility_entry(true: TrueObject) -> dict[str, Any]:
    return {
        "visib_fract": true.visib_fract,
        "px_count_all": true.px_count_all,
        "px_count_visib": true.px_count_visib,
        "bbox_visib": list(true.bbox_visib),
    }


def _json(data: dict[str, Any]) -> bytes:
    return (json.dumps(data, indent=1) + "\n").encode()
