"""Scene folders in the BOP layout with the lights beside them -> `Scene`: what the cameras saw of one bin state.

Without `lit/` and scene_lights.json it is what a depth camera saw: `depth/` alone.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError
from itree_kernels.json_file import as_numbers, read_json
from jaxtyping import Float

from itree_jax.sensing.bundled import SMALLEST_REGION
from itree_jax.sensing.camera_check import check_camera, check_distances
from itree_jax.sensing.depth_camera import depth_camera
from itree_jax.sensing.depth_steps import depth_noise
from itree_jax.sensing.exposure import check_light
from itree_jax.sensing.image_file import IMAGE_SUFFIXES, read_image, read_intensity, undistorted, warn_of_gamma
from itree_jax.sensing.lights import NO_LIGHTS, Lights, lights_of_entry, slant_limit_of
from itree_jax.sensor import Noise, Sensor


@dataclass(frozen=True)
class Scene:
    """One image under each light of one bin state; of a depth camera no image, but depth."""

    scene_id: int
    im_id: int
    images: Float[np.ndarray, "lights height width"]  # float32, linear, 1.0 = full scale, undistorted
    depth: Float[np.ndarray, "height width"] | None  # float32 z [mm], 0 = none
    sensor: Sensor
    R_w2c: Float[np.ndarray, "3 3"] | None  # X_cam = R_w2c X_world + t_w2c, world z up
    folder: Path | None
    t_w2c: Float[np.ndarray, "3"] | None = None  # [mm]


def scene_folders(path: str | Path) -> list[Path]:
    """The scene folders at `path`, sorted: a dataset (its `test` folder), a folder of scenes, or one scene folder."""
    path = Path(path)
    if not path.is_dir():
        raise ItreeError(f"{path}: there is no such folder of scenes")
    if (path / "scene_camera.json").is_file():
        return [path]
    base = path / "test" if (path / "test").is_dir() else path
    found = sorted(camera_file.parent for camera_file in base.glob("*/scene_camera.json"))
    if not found:
        raise ItreeError(f"{base}: no scene folder with a scene_camera.json is in it")
    return found


def load_scene(
    folder: str | Path, noise: Noise | None = None, *, sensor: Sensor | None = None, im_id: int = 0
) -> Scene:
    """Images, depth, camera and lights of camera image `im_id` of a scene folder.

    The folder tells the camera matrix, the lights, and where the camera stands. What it cannot tell (distortion,
    response, bit depth, slant limit, smallest region, region of interest, noise) is taken from `sensor` if given, else
    it is the default of `sensor_of_scene`; `noise` overrides both. Images are linearised and undistorted, not divided
    by the light intensities. A depth map is undistorted as the images are (same camera). Raises `ItreeError`.
    """
    folder = Path(folder)
    own = sensor_of_scene(folder, im_id) if sensor is None else _with_response_of(folder, im_id, sensor)
    if noise is not None:
        own = replace(own, noise=noise)
    paths = [] if own.is_depth_camera else _image_paths(folder, im_id)
    if len(paths) != own.light_count:
        raise ItreeError(
            f"{folder}: scene_lights.json tells {own.light_count} lights for image {im_id}, but lit/ has {len(paths)} "
            "images of it"
        )
    nothing = np.zeros((0, own.camera.height, own.camera.width), np.float32)
    images = np.stack([_load_image(path, own) for path in paths]) if paths else nothing
    if paths:
        warn_of_gamma(paths[0], own.bit_depth, own.gamma)
        check_light(images, own.noise, [str(path) for path in paths])
    R_w2c, t_w2c = _camera_pose(folder, im_id)
    depth = _load_depth(folder, im_id)
    if depth is not None:
        _check_size(folder / "depth", depth, own.camera)
        _check_depth(folder, depth, own)
        depth = undistorted(depth, own.camera, own.distortion, nearest=True)
    scene_id = int(folder.name) if folder.name.isdecimal() else 0
    return Scene(scene_id, im_id, images, depth, own, R_w2c, folder, t_w2c)


def sensor_of_scene(folder: str | Path, im_id: int = 0) -> Sensor:
    """The sensor that a scene folder describes, with the defaults for what it cannot tell.

    Noise is `Noise()`, the slant limit `slant_limit_of` the lights, the smallest region 60 mm^2. The working distance
    is that of the world's plane z = 0 along the optical axis if the folder says where the camera stands, else the
    median of the depth map. Of a depth camera's scene the noise is that of the depth map, the slant limit follows from
    it (`depth_slant_limit`). Raises `ItreeError` if neither is there.
    """
    folder = Path(folder)
    camera = _camera(folder, im_id)
    working_distance = _working_distance(folder, im_id)
    lights = _lights(folder, im_id, working_distance)
    sensor = Sensor(
        camera=camera,
        light_directions=lights.directions,
        light_intensities=lights.intensities,
        noise=Noise(),
        slant_limit=slant_limit_of(lights.directions) if len(lights.directions) else 0.0,
        smallest_region=SMALLEST_REGION,
        working_distance=working_distance,
        light_positions=lights.positions,
    )
    return depth_camera(sensor, _noise_of_depth(folder, im_id)) if sensor.is_depth_camera else sensor


def _with_response_of(folder: Path, im_id: int, sensor: Sensor) -> Sensor:
    lights = _lights(folder, im_id, sensor.working_distance)
    camera = _camera(folder, im_id)
    told = _distance_by_pose(folder, im_id)
    if told is not None and not camera.is_orthographic:
        where = f"{folder / 'scene_camera.json'}: the distance of the world's z = 0 by 'cam_t_w2c'"
        check_distances(told, sensor.working_distance, f"{where} beside the sensor's working distance")
    seen, expected = (c.width * c.mm_per_px(sensor.working_distance) for c in (camera, sensor.camera))
    check_distances(seen, expected, f"{folder}: the field of view by 'cam_K' beside that of the sensor")
    size, sensor_size = (camera.width, camera.height), (sensor.camera.width, sensor.camera.height)
    if sensor.region_of_interest is not None and size != sensor_size:
        raise ItreeError(f"{folder}: images are {size} px, the sensor's region of interest is for {sensor_size} px")
    noise = None
    if not len(lights.directions):
        noise = _noise_of_depth(folder, im_id) if sensor.depth_noise is None else sensor.depth_noise
    return replace(
        sensor, camera=camera, light_directions=lights.directions, light_intensities=lights.intensities,
        light_positions=lights.positions, depth_noise=noise,
    )  # fmt: skip


def _load_image(path: Path, sensor: Sensor) -> Float[np.ndarray, "height width"]:
    image = read_intensity(path, sensor.bit_depth, sensor.gamma)
    _check_size(path, image, sensor.camera)
    return undistorted(image, sensor.camera, sensor.distortion)


def _check_size(path: Path, image: np.ndarray, camera: Camera) -> None:
    if image.shape != (camera.height, camera.width):
        size = f"{image.shape[1]} x {image.shape[0]}"
        raise ItreeError(f"{path}: the image is {size} px, the first lit image is {camera.width} x {camera.height} px")


def _check_depth(folder: Path, depth: Float[np.ndarray, "height width"], sensor: Sensor) -> None:
    """Raises ItreeError if a depth map tells nothing, or cannot be in mm."""
    known = depth[depth > 0.0]
    if not known.size:
        raise ItreeError(f"{folder / 'depth'}: the depth map has no depth (all values are 0); take it away")
    if not sensor.camera.is_orthographic:  # whose working distance is a label
        told = f"{folder}: the depth map's median beside the sensor's working distance (check 'depth_scale')"
        check_distances(float(np.median(known)), sensor.working_distance, told)


def _image_paths(folder: Path, im_id: int) -> list[Path]:
    lit = folder / "lit"
    paths = sorted(p for p in lit.glob(f"{im_id:06d}_*") if p.suffix in IMAGE_SUFFIXES)
    if not paths:
        raise ItreeError(
            f"{lit}: there is no image {im_id:06d}_00.png, the first of one image under each light (a depth camera's "
            f"scene has neither lit/ nor scene_lights.json, but depth/{im_id:06d}.png)"
        )
    for k, path in enumerate(paths):
        if path.stem != f"{im_id:06d}_{k:02d}":
            raise ItreeError(f"{lit}: image {im_id:06d}_{k:02d} (light {k}) is missing; found {path.name}")
    return paths


def _read_entry(folder: Path, name: str, im_id: int) -> dict[str, Any]:
    path = folder / name
    data = read_json(path)
    entry = data.get(str(im_id)) if isinstance(data, dict) else None
    if not isinstance(entry, dict):
        raise ItreeError(f"{path}: the key '{im_id}' (camera image {im_id}) is missing")
    return entry


def _numbers(path: Path, entry: dict[str, Any], key: str, count: int) -> np.ndarray:
    values = as_numbers(entry[key], f"{path}: '{key}'").reshape(-1)
    if values.shape != (count,) or not np.isfinite(values).all():
        raise ItreeError(f"{path}: '{key}' must be {count} finite numbers, it is {entry[key]!r:.80}")
    return values


def _camera(folder: Path, im_id: int) -> Camera:
    path = folder / "scene_camera.json"
    entry = _read_entry(folder, path.name, im_id)
    if "cam_K" not in entry:
        raise ItreeError(f"{path}: image {im_id} has no 'cam_K'")
    K = _numbers(path, entry, "cam_K", 9).reshape(3, 3)
    if K[0, 0] <= 0.0 or K[1, 1] <= 0.0 or (K[0, 1], K[1, 0], *K[2]) != (0.0, 0.0, 0.0, 0.0, 1.0):
        raise ItreeError(
            f"{path}: 'cam_K' must be fx 0 cx 0 fy cy 0 0 1 with positive fx, fy, it is {K.ravel().tolist()}"
        )
    kind = entry.get("cam_kind", "pinhole")  # our own key: BOP knows pinhole cameras only
    if kind not in ("pinhole", "orthographic"):
        raise ItreeError(f"{path}: 'cam_kind' must be pinhole or orthographic, it is {kind!r}")
    first = _depth_path(folder, im_id) if _is_of_depth_camera(folder, im_id) else _image_paths(folder, im_id)[0]
    height, width = read_image(first).shape
    camera = Camera(kind, K[0, 0].item(), K[1, 1].item(), K[0, 2].item(), K[1, 2].item(), width, height)
    check_camera(camera, f"{path}: 'cam_K'")
    return camera


def _is_of_depth_camera(folder: Path, im_id: int) -> bool:
    has_lights = (folder / "lit").exists() or (folder / "scene_lights.json").exists()
    return not has_lights and _depth_path(folder, im_id).is_file()


def _depth_path(folder: Path, im_id: int) -> Path:
    return folder / "depth" / f"{im_id:06d}.png"


def _noise_of_depth(folder: Path, im_id: int) -> float:
    """Of the depth map [mm], and no less than what its steps round off."""
    depth = _load_depth(folder, im_id)
    assert depth is not None
    return max(depth_noise(depth, depth > 0.0), _depth_scale(folder, im_id) / 12.0**0.5)


def _lights(folder: Path, im_id: int, working_distance: float) -> Lights:
    if _is_of_depth_camera(folder, im_id):
        return NO_LIGHTS
    entry = _read_entry(folder, "scene_lights.json", im_id)
    return lights_of_entry(entry, working_distance, f"{folder / 'scene_lights.json'}: image {im_id}")


def _camera_pose(folder: Path, im_id: int) -> tuple[np.ndarray | None, np.ndarray | None]:
    path = folder / "scene_camera.json"
    entry = _read_entry(folder, path.name, im_id)
    if "cam_R_w2c" not in entry:
        return None, None
    R = _numbers(path, entry, "cam_R_w2c", 9).reshape(3, 3)
    if np.abs(R @ R.T - np.eye(3)).max() > 1e-3 or np.linalg.det(R) < 0.0:
        raise ItreeError(f"{path}: 'cam_R_w2c' is not a rotation matrix: {R.ravel().tolist()}")
    return R, _numbers(path, entry, "cam_t_w2c", 3) if "cam_t_w2c" in entry else None


def _load_depth(folder: Path, im_id: int) -> Float[np.ndarray, "height width"] | None:
    path = _depth_path(folder, im_id)
    if not path.is_file():
        return None
    return (read_image(path) * _depth_scale(folder, im_id)).astype(np.float32)


def _depth_scale(folder: Path, im_id: int) -> float:
    entry = _read_entry(folder, "scene_camera.json", im_id)
    scale = _numbers(folder / "scene_camera.json", {"depth_scale": 1.0, **entry}, "depth_scale", 1)[0]
    if scale <= 0.0:
        raise ItreeError(f"{folder / 'scene_camera.json'}: 'depth_scale' must be positive, it is {scale}")
    return float(scale)


def _distance_by_pose(folder: Path, im_id: int) -> float | None:
    """Where the optical axis meets the world's plane z = 0 [mm]; None where it does not, or no pose is told."""
    R_w2c, t_w2c = _camera_pose(folder, im_id)
    if R_w2c is None or t_w2c is None or abs(R_w2c[2, 2]) <= 1e-3:
        return None
    distance = float(R_w2c[:, 2] @ t_w2c / R_w2c[2, 2])  # z_world of (0, 0, distance) is 0
    return distance if distance > 0.0 else None


def _working_distance(folder: Path, im_id: int) -> float:
    told = _distance_by_pose(folder, im_id)
    if told is not None:
        return told
    depth = _load_depth(folder, im_id)
    if depth is not None and (depth > 0).any():
        return float(np.median(depth[depth > 0]))
    raise ItreeError(
        f"{folder}: how far the parts are is told neither by 'cam_R_w2c' and 'cam_t_w2c' in scene_camera.json nor by a "
        "depth map; use a sensor JSON with 'working_distance_mm'"
    )
