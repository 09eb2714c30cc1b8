"""Images from a camera -> a scene: checked against the sensor that took them, one image for each of its lights."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from itree_kernels.errors import ItreeError
from itree_kernels.json_file import as_numbers, read_json_object
from jaxtyping import Float

from itree_jax.sensing.ambient import subtract_ambient
from itree_jax.sensing.exposure import check_different, check_exposure
from itree_jax.sensing.image_file import read_image, read_intensity, undistorted, warn_of_gamma
from itree_jax.sensing.light_order import light_order
from itree_jax.sensing.scene_folder import Scene
from itree_jax.sensing.scene_writer import DEPTH_SCALE
from itree_jax.sensor import Sensor

RIGHT_IM_ID = 1  # of the second camera; the first has 0
SAME_LAMPS = float(np.radians(10.0))  # beyond, the two sensors' lights are not the same lamps, or the pose is inverted
LIKELY_DEPTH = 3.0  # times the working distance, or a part of it: beyond, the depth map is in another unit
ROTATION_TOLERANCE = 1e-3  # of R R^T against I: printed with four digits


@dataclass(frozen=True)
class Pose:
    """X_target = R X_source + t."""

    R: Float[np.ndarray, "3 3"]
    t: Float[np.ndarray, "3"]  # [mm]


@dataclass(frozen=True)
class Captured:
    """A scene whose images are as the lens showed them (not undistorted, as scene folders keep them), and warnings."""

    scene: Scene
    warnings: tuple[str, ...]
    depth_scale: float = DEPTH_SCALE  # [mm] steps in which its depth map was stored


def capture(
    paths: Sequence[Path], sensor: Sensor, *, scene_id: int = 0, im_id: int = 0, ambient: Path | None = None,
    depth: Path | None = None, depth_scale: float = 1.0, camera_pose: Pose | None = None,
) -> Captured:
    """The scene that `sensor` took: image k is that of light k.

    `depth` is z, stored value * `depth_scale` = mm, 0 = none. `camera_pose` takes the world (z up) to the camera;
    without it the camera is taken to look straight down on the world's floor from its working distance.

    Raises ItreeError, naming the file: number or size of images, exposure, saturation, two images under one light,
    images in an order that clearly does not fit the lights, an ambient frame or a depth map that does not fit.
    """
    if len(paths) != sensor.light_count:
        raise ItreeError(
            f"the sensor has {sensor.light_count} lights, but {len(paths)} images are given; give one image for each "
            "light, in the order of the sensor's lights"
        )
    names = [str(path) for path in paths]
    warn_of_gamma(Path(paths[0]), sensor.bit_depth, sensor.gamma)
    taken = np.stack([_intensity(path, sensor) for path in paths])
    warnings = check_exposure(taken, np.asarray(sensor.light_intensities), sensor.noise, names)
    images = taken
    if ambient is not None:
        try:
            images = subtract_ambient(taken, _intensity(ambient, sensor), sensor.noise)
        except ItreeError as error:
            raise ItreeError(f"{ambient}: {error}") from error
    check_different(images, sensor.noise, names)
    z, step = (None, DEPTH_SCALE) if depth is None else read_depth(depth, depth_scale, sensor)
    warnings += check_order(images, sensor, z, names)
    pose = camera_pose or looking_down(sensor)
    return Captured(Scene(scene_id, im_id, images, z, sensor, pose.R, None, pose.t), tuple(warnings), step)


def check_order(
    images: Float[np.ndarray, "lights height width"], sensor: Sensor, depth: Float[np.ndarray, "height width"] | None,
    names: Sequence[str],
) -> list[str]:
    """A warning if the images leave it open which order of the lights they are in; ItreeError if another order clearly
    fits better. Images and depth as the lens showed them."""
    ideal = np.stack([undistorted(image, sensor.camera, sensor.distortion) for image in images])
    z = None if depth is None else undistorted(depth, sensor.camera, sensor.distortion, nearest=True)
    found = light_order(ideal, sensor, z)
    evidence = ", ".join(f"{name} {margin:+.1f}" for name, margin in found.cues.items())
    better = ", ".join(f"{names[k]} is of light {j}" for k, j in enumerate(found.rival) if j != k)
    if found.wrong:
        raise ItreeError(
            f"the images are not in the order of the lights: they fit better when {better} (by {-found.margin:.1f} "
            f"standard deviations; {evidence}). Give them in the order of the sensor's lights; if they are, the "
            "sensor's light directions are wrong (they point toward the light; x right, y down, z forward)."
        )
    if found.doubtful:
        return [
            f"whether the images are in the order of the lights cannot be told: the order as given is ahead by "
            f"{found.margin:+.1f} standard deviations of the one in which {better} ({evidence})."
        ]
    return []


def read_depth(path: Path, scale: float, sensor: Sensor) -> tuple[Float[np.ndarray, "height width"], float]:
    """z [mm], 0 = none, and the steps [mm] that keep it as it is (of floats: `DEPTH_SCALE`).

    Raises ItreeError about the scale, the size, an empty map, or depths far from the working distance.
    """
    if not (np.isfinite(scale) and scale > 0.0):
        raise ItreeError(f"--depth-scale must be positive (mm per stored step), it is {scale}")
    stored = read_image(path)
    depth = np.nan_to_num(stored.astype(np.float64) * scale, nan=0.0, posinf=0.0, neginf=0.0)
    _check_size(path, depth, sensor)
    known = depth[depth > 0.0]
    if not known.size:
        raise ItreeError(f"{path}: the depth map has no depth (all values are 0)")
    ratio = float(np.median(known)) / sensor.working_distance
    if not sensor.camera.is_orthographic and not 1.0 / LIKELY_DEPTH < ratio < LIKELY_DEPTH:
        raise ItreeError(
            f"{path}: its median depth is {np.median(known):.4g} mm with {scale:g} mm per step, but the sensor works "
            f"at {sensor.working_distance:.4g} mm; check --depth-scale"
        )
    return np.maximum(depth, 0.0).astype(np.float32), DEPTH_SCALE if stored.dtype.kind == "f" else scale


def looking_down(sensor: Sensor) -> Pose:
    """World -> camera of one that looks straight down on the origin of the floor from its working distance."""
    return Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, sensor.working_distance]))


def second_camera(left: Captured, right: Captured, right_from_left: Pose) -> Captured:
    """The right camera's scene with its pose in the world, X_right = R X_left + t.

    Raises ItreeError if its lights, turned into the left camera's frame, are not those of the left sensor.
    """
    a, b = left.scene.sensor.light_directions, right.scene.sensor.light_directions
    if len(a) != len(b):
        raise ItreeError(f"the left sensor has {len(a)} lights, the right one {len(b)}; both see the same lamps")
    apart = np.arccos(np.clip(np.sum((a @ right_from_left.R.T) * b, axis=1), -1.0, 1.0))
    worst = int(np.argmax(apart))
    if apart[worst] > SAME_LAMPS:
        raise ItreeError(
            f"light {worst} of the right sensor is {np.degrees(apart[worst]):.0f} degrees from the left sensor's when "
            "that is turned by --right-pose: give X_right = R X_left + t (not its inverse), and lights in the same "
            "order in each camera's own frame"
        )
    assert left.scene.R_w2c is not None
    assert left.scene.t_w2c is not None
    R = right_from_left.R @ left.scene.R_w2c
    t = right_from_left.R @ left.scene.t_w2c + right_from_left.t
    return replace(right, scene=replace(right.scene, R_w2c=R, t_w2c=t))


def read_pose(path: Path) -> Pose:
    """A pose from JSON: {"R": [9 numbers, row by row], "t": [3, mm]}. Raises ItreeError."""
    try:
        data = read_json_object(path)
        R, t = (as_numbers(data.get(key), f"'{key}'").ravel() for key in ("R", "t"))
    except ItreeError as error:
        raise ItreeError(f'{path}: a pose is JSON like {{"R": [9 numbers], "t": [3 numbers, mm]}} ({error})') from error
    if R.shape != (9,) or t.shape != (3,) or not (np.isfinite(R).all() and np.isfinite(t).all()):
        raise ItreeError(f"{path}: 'R' must be 9 and 't' 3 finite numbers, they are {R.size} and {t.size}")
    R = R.reshape(3, 3)
    if np.abs(R @ R.T - np.eye(3)).max() > ROTATION_TOLERANCE or np.linalg.det(R) < 0.0:
        raise ItreeError(f"{path}: 'R' is not a rotation matrix: {R.ravel().tolist()}")
    return Pose(R, t)


def _intensity(path: Path, sensor: Sensor) -> Float[np.ndarray, "height width"]:
    image = read_intensity(path, sensor.bit_depth, sensor.gamma)
    _check_size(path, image, sensor)
    return image


def _check_size(path: Path, image: np.ndarray, sensor: Sensor) -> None:
    expected = (sensor.camera.height, sensor.camera.width)
    if image.shape != expected:
        raise ItreeError(
            f"{path}: the image is {image.shape[1]} x {image.shape[0]} px, the sensor's are {expected[1]} x "
            f"{expected[0]} px; take it uncropped, or calibrate the sensor at this size"
        )
