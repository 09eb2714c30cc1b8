"""The second camera of a scene folder: written and read back, and refused with the file that is wrong."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError

from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.scene_folder import Scene, load_scene
from itree_jax.sensing.scene_writer import write_scene
from itree_jax.stereo.second_file import load_second

from .two_views import converging

CAMERA = Camera("pinhole", 100.0, 101.0, 19.5, 14.5, 40, 30)
R_W2C, T_W2C = np.diag([1.0, -1.0, -1.0]), np.array([10.0, -20.0, 850.0])


@pytest.fixture
def scenes() -> tuple[Scene, Scene]:
    """What two cameras saw, as they are written; images are noise."""
    rng = np.random.default_rng(0)
    images = rng.uniform(0, 1, (2, 3, 30, 40)).astype(np.float32)
    R, t = converging()
    sensor = replace(bundled_sensor("bench"), camera=CAMERA, working_distance=850.0)
    first = Scene(7, 0, images[0], None, sensor, R_W2C, None, T_W2C)
    directions = sensor.light_directions @ R.T
    turned = replace(sensor, light_directions=directions, light_intensities=np.array([1.0, 0.9, 1.1]))
    return first, Scene(7, 3, images[1], None, turned, R @ R_W2C, None, R @ T_W2C + t)


@pytest.fixture
def folder(scenes, tmp_path) -> Path:
    write_scene(tmp_path / "000007", scenes[0], right=scenes[1])
    return tmp_path / "000007"


def test_written_and_read_back(scenes, folder):
    second = load_second(load_scene(folder))
    assert second is not None
    R, t = converging()
    np.testing.assert_allclose(second.R_second_first, R, atol=1e-12)
    np.testing.assert_allclose(second.t_second_first, t, atol=1e-9)
    np.testing.assert_allclose(second.images, scenes[1].images, rtol=0, atol=0.5 / 65535 + 1e-7)
    np.testing.assert_allclose(second.sensor.light_directions, scenes[1].sensor.light_directions, atol=1e-12)
    np.testing.assert_array_equal(second.sensor.light_intensities, [1.0, 0.9, 1.1])
    assert second.sensor.camera == CAMERA


def test_what_a_folder_cannot_tell_comes_from_the_sensor(scenes, folder):
    noise = replace(scenes[0].sensor.noise, read_noise_e=9.0)
    second = load_second(load_scene(folder), replace(scenes[0].sensor, noise=noise))
    assert second is not None
    assert second.sensor.noise == noise
    np.testing.assert_allclose(second.sensor.light_directions, scenes[1].sensor.light_directions, atol=1e-12)


def test_no_second_camera_is_none(scenes, folder, tmp_path):
    write_scene(tmp_path / "alone", scenes[0])
    assert load_second(load_scene(tmp_path / "alone")) is None
    assert load_second(scenes[0]) is None  # not from a folder
    (folder / "scene_stereo.json").write_text('{"5": {"right": 1}}')
    assert load_second(load_scene(folder)) is None


@pytest.mark.parametrize(
    "text",
    ["", "[]", "3", '"0"', '{"0": 1}', '{"0": {}}', '{"0": null}', '{"0": {"right": null}}', '{"0": {"right": "x"}}',
     '{"0": {"right": 1e999}}', '{"0": {"right": 1.5}}', '{"0": {"right": true}}', "\xff"],
)  # fmt: skip
def test_a_malformed_file_is_refused(folder, text):
    (folder / "scene_stereo.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(ItreeError, match=r'scene_stereo\.json: should be \{"0": \{"right": N\}\}'):
        load_second(load_scene(folder))


def test_an_image_that_is_not_there_is_named(folder):
    (folder / "scene_stereo.json").write_text('{"0": {"right": 4}}')
    with pytest.raises(ItreeError, match=r"000004_00\.png|'4'"):
        load_second(load_scene(folder))


@pytest.mark.parametrize("image", ["0", "3"])
@pytest.mark.parametrize("keys", [("cam_t_w2c",), ("cam_R_w2c", "cam_t_w2c")])
def test_poses_that_are_missing_are_asked_for(scenes, folder, image, keys):
    path = folder / "scene_camera.json"
    cameras = json.loads(path.read_text())
    for key in keys:
        del cameras[image][key]
    path.write_text(json.dumps(cameras))
    sensor = scenes[0].sensor  # without a pose a folder can't tell how far the parts are
    with pytest.raises(ItreeError, match=r"scene_camera\.json: .* needs cam_R_w2c and cam_t_w2c of images 0 and 3"):
        load_second(load_scene(folder, sensor=sensor), sensor)
