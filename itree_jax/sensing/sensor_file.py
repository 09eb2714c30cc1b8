"""Sensors as files: JSON (schema: `sensor.schema.json` beside this module), scene folders, bundled names."""

import hashlib
import json
from dataclasses import asdict
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError
from itree_kernels.json_file import read_json
from itree_kernels.whole_files import write_whole
from jaxtyping import Bool, Float

from itree_jax.sensing.bundled import SLANT_LIMIT, SMALLEST_REGION, bundled_sensor
from itree_jax.sensing.camera_check import check_camera
from itree_jax.sensing.depth_camera import depth_camera, depth_noise_of
from itree_jax.sensing.image_file import png_bytes, read_image
from itree_jax.sensing.json_check import check_json
from itree_jax.sensing.lights import NO_LIGHTS, Lights, check_intensities, lights_of_entry
from itree_jax.sensing.scene_folder import scene_folders, sensor_of_scene
from itree_jax.sensing.scene_writer import lights_entry
from itree_jax.sensor import Noise, Sensor

SENSOR_SCHEMA: dict[str, Any] = json.loads(
    resources.files("itree_jax.sensing").joinpath("sensor.schema.json").read_text(encoding="utf-8")
)
DISTORTION_LENGTHS = (0, 4, 5, 8, 12, 14)  # the ones that OpenCV knows


def load_sensor(source: str | Path) -> Sensor:
    """The sensor that `source` names: `bundled:NAME`, a JSON file, a scene folder, or a dataset (its first scene).

    Raises `ItreeError` that names the file and the key.
    """
    if str(source).startswith("bundled:"):
        return bundled_sensor(str(source).removeprefix("bundled:"))
    path = Path(source)
    if path.is_dir():
        return sensor_of_scene(scene_folders(path)[0])
    if not path.is_file():
        raise ItreeError(
            f"sensor '{source}' is neither a JSON file nor a scene folder nor bundled; try 'bundled:ikeuchi-1987'"
        )
    return sensor_from_json(read_json(path), str(path), path.parent)


def load_unlit_sensor(source: str | Path) -> Sensor:
    """`load_sensor` of a source whose lights are still to be found: a JSON file may leave out "lights".

    The three lights that the sensor then has stand for none. Raises `ItreeError` as `load_sensor` does.
    """
    path = Path(source)
    if not path.is_file():
        return load_sensor(source)
    data = read_json(path)
    if isinstance(data, dict) and "depth_camera" not in data:
        data.setdefault("lights", {"directions": bundled_sensor("bench").light_directions.tolist()})
    return sensor_from_json(data, str(path), path.parent)


def sensor_from_json(data: Any, where: str, folder: Path | None = None) -> Sensor:
    """The sensor that `data` (see `SENSOR_SCHEMA`) describes. `where` names it in errors; a mask lies in `folder`."""
    check_json(data, SENSOR_SCHEMA, where)
    camera = _camera(data["camera"], where)
    response, working_distance = data.get("response", "linear"), float(data["working_distance_mm"])
    if ("lights" in data) == ("depth_camera" in data):
        raise ItreeError(
            f"{where}: the key 'lights' is missing (or 'depth_camera', for a sensor without lights)"
            if "lights" not in data else f"{where}: give 'lights' or 'depth_camera', not both"
        )
    of_depth = "depth_camera" in data
    lights = NO_LIGHTS if of_depth else lights_of_entry(data["lights"], working_distance, f"{where}: lights")
    sensor = Sensor(
        camera=camera,
        light_directions=lights.directions,
        light_intensities=exposed(lights, data.get("lights", {}), where),
        light_positions=lights.positions,
        noise=Noise(**data.get("noise", {})),
        slant_limit=float(np.radians(data.get("slant_limit_deg", np.degrees(SLANT_LIMIT)))),
        smallest_region=float(data.get("smallest_region_mm2", SMALLEST_REGION)),
        working_distance=working_distance,
        distortion=_distortion(data["camera"], camera, where),
        gamma=1.0 if response == "linear" else float(response["gamma"]),
        region_of_interest=_region_of_interest(data.get("region_of_interest"), camera, where, folder),
        bit_depth=data.get("bit_depth"),
    )
    if not of_depth:
        return sensor
    limit = sensor.slant_limit if "slant_limit_deg" in data else None
    return depth_camera(sensor, float(data["depth_camera"]["noise_mm"]), limit)


def sensor_to_json(sensor: Sensor) -> dict[str, Any]:
    """The JSON object of a sensor, without its region of interest (`save_sensor` writes that too)."""
    c = sensor.camera
    camera = {"kind": c.kind, "matrix": [[c.fx, 0.0, c.cx], [0.0, c.fy, c.cy], [0.0, 0.0, 1.0]]}
    of_depth = {"depth_camera": {"noise_mm": depth_noise_of(sensor)}} if sensor.is_depth_camera else None
    data = {
        "camera": {**camera, "size": [c.width, c.height], "distortion": list(sensor.distortion)},
        **(of_depth or {"lights": lights_entry(sensor)}),
        "response": "linear" if sensor.gamma == 1.0 else {"gamma": sensor.gamma},
        "noise": asdict(sensor.noise),
        "slant_limit_deg": float(np.degrees(sensor.slant_limit)),
        "smallest_region_mm2": sensor.smallest_region,
        "working_distance_mm": sensor.working_distance,
    }
    return data if sensor.bit_depth is None else {**data, "bit_depth": sensor.bit_depth}


def save_sensor(sensor: Sensor, path: str | Path) -> None:
    """Write a sensor as JSON, atomically; a region of interest that is no rectangle as `STEM.mask.png` beside it."""
    path = Path(path)
    data = sensor_to_json(sensor)
    if sensor.region_of_interest is not None:
        data["region_of_interest"] = _rectangle(sensor.region_of_interest) or f"{path.stem}.mask.png"
        if isinstance(data["region_of_interest"], str):
            mask = sensor.region_of_interest.astype(np.uint8) * 255
            write_whole(path.with_name(data["region_of_interest"]), png_bytes(mask))
    write_whole(path, json.dumps(data, indent=2) + "\n")


def fingerprint(sensor: Sensor) -> str:
    """Sixteen hex digits of what decides detectability: light directions (to 1e-6), camera model, slant limit, region;
    of a depth camera its noise too, which its needles come from.

    Light intensities, image size and noise are left out: a tree compiled for one holds for the others.
    """
    facts = {
        "directions": (np.round(sensor.light_directions, 6) + 0.0).tolist(),  # + 0.0 makes -0.0 0.0
        "camera": sensor.camera.kind,
        "slant_limit": round(sensor.slant_limit, 6),
        "smallest_region": round(sensor.smallest_region, 6),
    }
    if sensor.is_depth_camera:
        facts["depth_noise"] = round(depth_noise_of(sensor), 6)
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:16]


def _camera(data: dict[str, Any], where: str) -> Camera:
    if "matrix" in data:
        K = np.array(data["matrix"], dtype=np.float64)
        if (K[0, 1], K[1, 0], *K[2]) != (0.0, 0.0, 0.0, 0.0, 1.0) or K[0, 0] <= 0.0 or K[1, 1] <= 0.0:
            raise ItreeError(
                f"{where}: 'camera.matrix' must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with positive focal lengths, "
                f"it is {K.tolist()}"
            )
        fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    else:
        for name in ("fx", "fy", "cx", "cy"):
            if name not in data:
                raise ItreeError(f"{where}: 'camera' needs either 'matrix' or fx, fy, cx, cy; '{name}' is missing")
        fx, fy, cx, cy = (data[name] for name in ("fx", "fy", "cx", "cy"))
    camera = Camera(data["kind"], float(fx), float(fy), float(cx), float(cy), *data["size"])
    check_camera(camera, f"{where}: 'camera'")
    return camera


def _distortion(data: dict[str, Any], camera: Camera, where: str) -> tuple[float, ...]:
    values = tuple(float(value) for value in data.get("distortion", ()))
    if len(values) not in DISTORTION_LENGTHS:
        raise ItreeError(f"{where}: 'camera.distortion' must have {DISTORTION_LENGTHS} numbers, it has {len(values)}")
    if camera.is_orthographic and any(values):
        raise ItreeError(f"{where}: 'camera.distortion' is OpenCV's pinhole model; an orthographic camera has none")
    return values


def exposed(lights: Lights, told: dict[str, Any], where: str) -> Float[np.ndarray, "lights"]:
    """Intensities times the exposure of each light's image."""
    exposure, count = np.asarray(told.get("exposure", 1.0), dtype=np.float64), len(lights.directions)
    if exposure.shape not in ((), (count,)):
        raise ItreeError(f"{where}: 'lights.exposure' has {exposure.size} values for {count} lights")
    with np.errstate(over="ignore", under="ignore"):
        intensities = lights.intensities * exposure
    check_intensities(intensities, f"{where}: lights")
    return intensities


def _region_of_interest(
    value: str | list[int] | None, camera: Camera, where: str, folder: Path | None
) -> Bool[np.ndarray, "height width"] | None:
    if value is None:
        return None
    shape = (camera.height, camera.width)
    if isinstance(value, str):
        mask = read_image((folder or Path()) / value) != 0
        if mask.shape != shape:
            raise ItreeError(f"{where}: the mask '{value}' has shape {mask.shape}, images have {shape}")
    else:
        x, y, w, h = value
        mask = np.zeros(shape, dtype=bool)
        mask[y : y + h, x : x + w] = True
    if not mask.any():
        raise ItreeError(f"{where}: 'region_of_interest' {value} has no pixel in the {shape[1]} x {shape[0]} image")
    return mask


def _rectangle(mask: Bool[np.ndarray, "height width"]) -> list[int] | None:
    """[x, y, w, h] if the mask is one full rectangle."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if rows.size == 0:
        return None
    y, x = int(rows[0]), int(columns[0])
    h, w = int(rows[-1]) - y + 1, int(columns[-1]) - x + 1
    return [x, y, w, h] if mask.sum() == w * h else None
