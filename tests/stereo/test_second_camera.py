"""Two cameras' images on common epipolar lines: rows match rows, disparity tells depth, depth goes back."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import trimesh
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError
from itree_kernels.instances import Material
from scipy.spatial.transform import Rotation

from itree_jax.sensing.near_lights import near_light_field
from itree_jax.sensor import Sensor
from itree_jax.stereo.second_camera import EpipolarPair, SecondCamera, epipolar_pair, to_first_camera

from .two_views import (
    ASIDE,
    BASELINE,
    CAMERA,
    DISTANCE,
    PARALLEL,
    SHIFTED,
    as_mesh,
    converging,
    plane_depth,
    second_of,
    sensor_with,
    two_views,
)

TILTED = np.array([0.35, -0.5, -1.0]) / np.linalg.norm([0.35, -0.5, -1.0])


def own_places(camera: Camera) -> np.ndarray:
    """Images that hold their own pixels' u, v and 1, whatever the lights' strength: what is read tells from where."""
    v, u = np.indices((camera.height, camera.width)).astype(np.float32)
    strengths = sensor_with(camera).light_intensities[:, None, None]
    return (strengths * np.stack([u, v, np.ones_like(u)])).astype(np.float32)


def read(images: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Values of images at points [n, 2]."""
    u, v = uv.astype(np.float32).T[:, :, None]
    return np.stack([cv2.remap(image.astype(np.float32), u, v, cv2.INTER_LINEAR)[:, 0] for image in images], axis=-1)


def pair_of(R=PARALLEL, t=ASIDE, camera_2=SHIFTED) -> EpipolarPair:
    return epipolar_pair(own_places(CAMERA), sensor_with(CAMERA), second_of(own_places(camera_2), camera_2, R, t))


def test_parallel_cameras_keep_their_pixels():
    pair = pair_of()
    np.testing.assert_array_equal(pair.R_left_first, np.eye(3))
    assert pair.sensor.camera == CAMERA
    np.testing.assert_allclose(pair.left, pair.right, rtol=1e-6)  # both hold their own places
    np.testing.assert_allclose(pair.left[0, 7], np.arange(CAMERA.width), rtol=1e-6)
    X = np.random.default_rng(0).uniform([-40, -30, 700], [40, 30, 900], (50, 3))
    disparity = CAMERA.project(X)[:, 0] - SHIFTED.project(X + ASIDE)[:, 0]
    np.testing.assert_allclose(pair.disparity(X[:, 2]), disparity, rtol=0, atol=1e-9)
    np.testing.assert_allclose(pair.depth(disparity), X[:, 2], rtol=1e-12)
    assert pair.depth(np.array([pair.offset - 1.0])) == 0.0  # behind infinity


def test_rows_of_turned_cameras_match_rows():
    """The right image at a point's row and disparity shows what the second camera saw at that point."""
    ball = as_mesh(trimesh.creation.icosphere(subdivisions=3, radius=30.0))
    floor = as_mesh(trimesh.creation.box((900, 900, 10)))
    t = np.array([[4.0, -3.0, 860.0], [0.0, 0.0, 905.0]])
    R, t_2 = converging()
    seen = two_views([ball, floor], np.tile(np.eye(3), (2, 1, 1)), t, Material(np.array([0.7, 0.06])), CAMERA, R, t_2)
    pair = pair_of(R, t_2, CAMERA)
    v, u = np.indices(seen.lit.depth.shape)
    uv = np.stack([u, v], axis=-1)[5:-5:7, 5:-5:7].reshape(-1, 2).astype(float)
    X_first = CAMERA.unproject(uv, seen.lit.depth[5:-5:7, 5:-5:7].ravel().astype(float))
    X_left, X_second = X_first @ pair.R_left_first.T, X_first @ R.T + t_2
    left = pair.sensor.camera.project(X_left)
    right = left - np.stack([pair.disparity(X_left[:, 2]), np.zeros(len(left))], axis=-1)
    for images, at, place in ((pair.left, left, uv), (pair.right, right, CAMERA.project(X_second))):
        got = read(images, at)
        there = (got[:, 2] > 0.999) & (place > 1).all(1) & (place < [CAMERA.width - 2, CAMERA.height - 2]).all(1)
        assert there.mean() > 0.7
        assert np.abs(got[there, :2] - place[there]).max() < 0.1
    # and the lights turn with the frame
    turned_back = pair.sensor.light_directions @ pair.R_left_first
    np.testing.assert_allclose(turned_back, seen.sensor.light_directions, atol=1e-12)


def field_at(sensor: Sensor, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions and intensities of near lights at a point [mm]."""
    u, v = sensor.camera.project(X)
    window = sensor.camera.cropped(u, v, 1, 1)
    field = near_light_field(sensor.light_positions, sensor.light_intensities, X[2], window, sensor.working_distance)
    return np.asarray(field[0])[0, 0], np.asarray(field[1])[0, 0]


def test_near_lights_turn_with_the_frame():
    R, t = converging()
    positions = 700.0 * sensor_with(CAMERA).light_directions + np.array([0.0, 0.0, DISTANCE])
    first = replace(sensor_with(CAMERA), light_positions=positions)
    pair = epipolar_pair(own_places(CAMERA), first, second_of(own_places(CAMERA), CAMERA, R, t))
    X = CAMERA.unproject(np.array([60.0, 40.0]), np.array(880.0))
    lit, turned = (field_at(sensor, place) for sensor, place in ((first, X), (pair.sensor, pair.R_left_first @ X)))
    np.testing.assert_allclose(turned[0] @ pair.R_left_first, lit[0], atol=1e-6)
    np.testing.assert_allclose(turned[1], lit[1], rtol=1e-6)


@pytest.mark.parametrize("turned", [False, True])
def test_a_planes_depth_comes_back_to_the_first_camera(turned):
    R, t = converging() if turned else (np.eye(3), ASIDE)
    pair = pair_of(R, t, CAMERA if turned else SHIFTED)
    point = np.array([0.0, 0.0, 880.0])
    left = plane_depth(pair.sensor.camera, pair.R_left_first @ TILTED, pair.R_left_first @ point)
    back = to_first_camera(left.astype(np.float32), pair, CAMERA)
    known = back > 0
    assert known.mean() > 0.8
    assert np.abs(back - plane_depth(CAMERA, TILTED, point))[known].max() < 1e-3  # float32


def test_unknown_depth_stays_unknown_and_steps_stay_steps():
    R, t = converging()
    pair = pair_of(R, t, CAMERA)
    levels = [plane_depth(pair.sensor.camera, pair.R_left_first[:, 2], pair.R_left_first[:, 2] * z) for z in (880, 800)]
    row, column = np.indices(levels[0].shape)
    left = np.where(row < 60, 0.0, np.where(column < 100, *levels))
    back = to_first_camera(left.astype(np.float32), pair, CAMERA)
    assert not back[:30].any()
    near, far = np.abs(back - 800.0) < 1e-3, np.abs(back - 880.0) < 1e-3
    off = ~(near | far | (back == 0.0))
    assert near.sum() > 4000
    assert far.sum() > 4000
    # beside what is unknown and at the step it is the nearest pixel's, which lies on the same plane but for the turn
    assert np.minimum(np.abs(back - 800.0), np.abs(back - 880.0))[off].max(initial=0.0) < 0.1


def refused(match: str, second: SecondCamera, images=None, sensor=None) -> None:
    with pytest.raises(ItreeError, match=match):
        epipolar_pair(own_places(CAMERA) if images is None else images, sensor or sensor_with(CAMERA), second)


def test_what_does_not_fit_is_refused_with_what_to_do():
    images = own_places(CAMERA)
    refused("swap them", second_of(images, CAMERA, np.eye(3), -ASIDE))
    R, t = converging()
    refused("swap them", second_of(images, CAMERA, R.T, -R.T @ t))
    refused("at least 18 mm", second_of(images, CAMERA, np.eye(3), np.array([-5.0, 0.0, 0.0])))
    refused("3 images, the second 4", second_of(np.concatenate([images, images[:1]]), CAMERA, np.eye(3), ASIDE))
    flat = replace(CAMERA, kind="orthographic", fx=2.0, fy=2.0)
    refused("pinhole", second_of(images, flat, np.eye(3), ASIDE))
    refused("pinhole", second_of(images, CAMERA, np.eye(3), ASIDE), sensor=sensor_with(flat))


@pytest.mark.parametrize("way", [1, -1])
def test_a_camera_above_is_refused(way):
    t = np.array([-5.0, way * BASELINE, 0.0])
    refused("above or below", second_of(own_places(CAMERA), CAMERA, np.eye(3), t))


def test_a_rolled_camera_beside_it_is_not_above_it():
    R = Rotation.from_euler("z", 80.0, degrees=True).as_matrix()  # its x axis points down
    pair = pair_of(R, R @ ASIDE, SHIFTED)
    assert pair.focal_baseline > 0
