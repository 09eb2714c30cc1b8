"""The second camera of a scene, and both cameras' images on common epipolar lines."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError
from jaxtyping import Float

from itree_jax.sensing.box import Box
from itree_jax.sensing.lights import axis_point, directions_on_axis
from itree_jax.sensor import Sensor

ALIGNED = 1e-4  # [rad], and relative: a tenth of a pixel at the border of the image
ONE_SURFACE = 0.005  # of the depth, between pixels side by side: a surface that leans by 75 degrees differs by less
LEAST_BASELINE = 0.02  # of the working distance: under it a pixel of disparity is more than a tenth of a part


@dataclass(frozen=True, eq=False)
class SecondCamera:
    """What a second camera saw of the same bin state under the same lights."""

    images: Float[np.ndarray, "lights height width"]  # linear, 1.0 = full scale, undistorted
    sensor: Sensor  # its camera, and the lights in its own frame
    R_second_first: Float[np.ndarray, "3 3"]  # X_second = R X_first + t
    t_second_first: Float[np.ndarray, "3"]  # [mm]

    def with_lights_of(self, first: Sensor) -> "SecondCamera":
        """The same with the lights of the first camera's sensor, turned into this one's frame."""
        turned = _lights_turned(first, self.R_second_first)
        near = None if turned.light_positions is None else turned.light_positions + self.t_second_first
        sensor = replace(
            self.sensor, light_directions=turned.light_directions, light_positions=near,
            light_intensities=first.light_intensities,
        )
        return replace(self, sensor=sensor)


@dataclass(frozen=True, eq=False)
class EpipolarPair:
    """Both cameras' images over the strength of their lights, with rows as common epipolar lines.

    `sensor` and its frame are those of the left images; disparity is u_left - u_right = focal * baseline / z + offset.
    """

    left: Float[np.ndarray, "lights height width"]
    right: Float[np.ndarray, "lights height width"]
    left_stored: Float[np.ndarray, "lights height width"]  # not divided by the strength of the lights
    sensor: Sensor
    R_left_first: Float[np.ndarray, "3 3"]  # turns the first camera's frame into that of the left images
    focal_baseline: float  # [px mm]
    offset: float  # [px] between the principal points

    def within(self, box: Box) -> "EpipolarPair":
        """The same of a part of the left images; of the right ones, their rows."""
        return replace(
            self, left=box.of(self.left), right=self.right[:, box.top : box.bottom],
            left_stored=box.of(self.left_stored), offset=self.offset - box.left,
            sensor=replace(self.sensor, camera=box.seen_by(self.sensor.camera)),
        )  # fmt: skip

    def disparity(self, z: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """[px] at these depths [mm]."""
        return self.focal_baseline / np.maximum(z, 1e-3) + self.offset

    def depth(self, disparity: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """[mm] at these disparities [px]; 0 where a point would lie behind infinity."""
        ahead = disparity - self.offset
        return np.where(ahead > 1e-3, self.focal_baseline / np.maximum(ahead, 1e-3), 0.0)


def epipolar_pair(
    images: Float[np.ndarray, "lights height width"], sensor: Sensor, second: SecondCamera
) -> EpipolarPair:
    """The images of two pinhole cameras, turned about their centres so that rows match rows.

    Cameras that stand parallel and side by side already keep their pixels. Raises `ItreeError` for orthographic cameras
    (rows of theirs tell depth too, but the geometry here is a pinhole's), other numbers of lights, cameras that stand
    too close together or above one another, or a second one to the left.
    """
    _check(images, sensor, second)
    R, t = second.R_second_first, second.t_second_first
    cameras = (sensor.camera, second.sensor.camera)
    if _aligned(R, t, cameras):
        left, right, R_left, view = images, second.images, np.eye(3), sensor.camera
        baseline, offset = -float(t[0]), cameras[0].cx - cameras[1].cx
    else:
        size = (cameras[0].width, cameras[0].height)
        K = [_matrix(camera) for camera in cameras]
        R_left, R_right, P_left, P_right = cv2.stereoRectify(
            K[0], np.zeros(5), K[1], np.zeros(5), size, R, t.reshape(3, 1), flags=0
        )[:4]  # no flag: each image keeps its own middle, so that cameras that look at one point lose nothing
        left = _turned(images, K[0], R_left, P_left, size)
        right = _turned(second.images, K[1], R_right, P_right, size)
        fx, fy, cx, cy = P_left[0, 0], P_left[1, 1], P_left[0, 2], P_left[1, 2]
        view = Camera("pinhole", float(fx), float(fy), float(cx), float(cy), *size)
        baseline, offset = -float(P_right[0, 3] / P_right[0, 0]), float(P_left[0, 2] - P_right[0, 2])
    turned = replace(_lights_turned(sensor, R_left), camera=view, region_of_interest=None)
    strengths = (one.light_intensities[:, None, None].astype(np.float32) for one in (sensor, second.sensor))
    shown = [image / strength for image, strength in zip((left, right), strengths, strict=True)]
    if baseline < 0.0:
        raise ItreeError(
            "the second camera stands to the left of the first one; swap them, so that image 1 is the right camera's"
        )
    return EpipolarPair(shown[0], shown[1], left, turned, R_left, view.fx * baseline, offset)


def to_first_camera(
    depth: Float[np.ndarray, "height width"], pair: EpipolarPair, camera: Camera
) -> Float[np.ndarray, "height width"]:
    """A depth map of the left images as the first camera's own pixels have it [mm]; 0 stays 0."""
    if np.array_equal(pair.R_left_first, np.eye(3)) and pair.sensor.camera == camera:
        return depth
    v, u = np.indices((camera.height, camera.width))
    ray_first = camera.viewing_ray(np.stack([u, v], axis=-1).astype(np.float64))
    ray = ray_first / ray_first[..., 2:] @ pair.R_left_first.T
    view = pair.sensor.camera
    x, y = ray[..., 0] / ray[..., 2] * view.fx + view.cx, ray[..., 1] / ray[..., 2] * view.fy + view.cy
    return _read_depth(depth, x, y) / ray[..., 2]  # z along the turned axis is ray_z times z along the camera's own


def _read_depth(
    depth: Float[np.ndarray, "height width"], x: Float[np.ndarray, "h w"], y: Float[np.ndarray, "h w"]
) -> Float[np.ndarray, "h w"]:
    """Between four pixels of one surface inverse depth, which is linear on a plane, is interpolated; else the nearest
    pixel's depth is taken, 0 outside.
    """
    height, width = depth.shape
    i, j = (np.clip(np.floor(c).astype(int), 0, n - 2) for c, n in ((y, height), (x, width)))
    right, down = x - j, y - i
    corners = np.stack([depth[i, j], depth[i, j + 1], depth[i + 1, j], depth[i + 1, j + 1]]).astype(np.float64)
    shares = np.stack([(1 - right) * (1 - down), right * (1 - down), (1 - right) * down, right * down])
    nearest = np.take_along_axis(corners, shares.argmax(axis=0)[None], axis=0)[0]
    least, most = corners.min(axis=0), corners.max(axis=0)
    one = (least > 0.0) & (most - least < ONE_SURFACE * least)
    between = 1.0 / (shares / np.where(one, corners, 1.0)).sum(axis=0)
    inside = (x >= -0.5) & (x <= width - 0.5) & (y >= -0.5) & (y <= height - 0.5)
    return np.where(inside, np.where(one, between, nearest), 0.0)


def _lights_turned(sensor: Sensor, R: Float[np.ndarray, "3 3"]) -> Sensor:
    """The sensor with its lights in a turned frame. Near lights are told where the new optical axis meets the scene."""
    if sensor.light_positions is None:
        return replace(sensor, light_directions=sensor.light_directions @ R.T)
    positions, distance = sensor.light_positions @ R.T, sensor.working_distance
    before, after = (np.linalg.norm(p - axis_point(distance), axis=1) for p in (sensor.light_positions, positions))
    return replace(
        sensor, light_positions=positions, light_directions=directions_on_axis(positions, distance),
        light_intensities=sensor.light_intensities * (before / after) ** 2,
    )  # fmt: skip


def _check(images: np.ndarray, sensor: Sensor, second: SecondCamera) -> None:
    if sensor.camera.is_orthographic or second.sensor.camera.is_orthographic:
        raise ItreeError("depth from two cameras needs pinhole cameras; an orthographic one is given")
    if len(images) != len(second.images):
        raise ItreeError(f"the first camera has {len(images)} images, the second {len(second.images)}: one per light")
    distance = float(np.linalg.norm(second.t_second_first))
    if distance < LEAST_BASELINE * sensor.working_distance:
        raise ItreeError(
            f"the two cameras stand {distance:.1f} mm apart, too close for parts {sensor.working_distance:.0f} mm "
            f"away; at least {LEAST_BASELINE * sensor.working_distance:.0f} mm are needed"
        )
    x, y, _ = np.abs(second.R_second_first.T @ second.t_second_first)  # where it stands, in the first one's frame
    if y > x:
        raise ItreeError(
            "the second camera stands above or below the first one; turn the images of both by a quarter, with their "
            "cameras, lights and poses, so that it stands beside it"
        )


def _aligned(R: np.ndarray, t: np.ndarray, cameras: tuple[Camera, Camera]) -> bool:
    a, b = cameras
    same = (a.fx, a.fy, a.cy, a.width, a.height) == (b.fx, b.fy, b.cy, b.width, b.height) and a.fx == a.fy
    return same and np.abs(R - np.eye(3)).max() < ALIGNED and np.abs(t[1:]).max() < ALIGNED * abs(t[0])


def _matrix(camera: Camera) -> Float[np.ndarray, "3 3"]:
    return np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])


def _turned(images: np.ndarray, K: np.ndarray, R: np.ndarray, P: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    u, v = cv2.initUndistortRectifyMap(K, np.zeros(5), R, P[:, :3], size, cv2.CV_32FC1)
    return np.stack([cv2.remap(image, u, v, cv2.INTER_LINEAR) for image in images])
