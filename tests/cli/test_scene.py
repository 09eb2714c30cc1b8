"""`itree scene`: a scene folder that reads back as it was taken, or a message and nothing written."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from itree_jax.sensing.scene_folder import load_scene
from itree_jax.sensing.sensor_file import load_sensor, save_sensor


@pytest.fixture(scope="module")
def taken(tmp_path_factory):
    """Three 12-bit images of the bundled bin, a depth map, an ambient frame, and the sensor's file."""
    from itree_jax.sensing.bundled import bundled_sensor
    from itree_jax.simulate import demo_bin

    folder = tmp_path_factory.mktemp("taken")
    sensor = bundled_sensor("bench")
    scene, _ = demo_bin(sensor, seed=3)
    assert scene.depth is not None
    for k, image in enumerate(scene.images):
        put(folder / f"im{k}.png", image * 4095)
    put(folder / "depth.png", scene.depth / 0.1)
    rng = np.random.default_rng(0)
    put(folder / "ambient.png", rng.normal(40.0, 4.0, scene.depth.shape))
    save_sensor(replace(sensor, bit_depth=12), folder / "sensor.json")
    return folder


def put(path, values):
    assert cv2.imwrite(str(path), np.round(np.clip(values, 0, 65535)).astype(np.uint16))


def stored(path):
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)


@pytest.fixture
def make(itree, taken, tmp_path):
    """`make(*options, images=...)` with the sensor and a new folder."""

    def run(*options, images=("im0.png", "im1.png", "im2.png"), sensor="sensor.json", folder="000007"):
        paths = [taken / name if isinstance(name, str) else name for name in images]
        where = taken / sensor if (taken / sensor).exists() else sensor
        return itree("scene", tmp_path / folder, *paths, "--sensor", where, *options)

    return run


def test_a_scene_reads_back_as_it_was_taken(make, taken, tmp_path):
    ran = make("--depth", taken / "depth.png", "--depth-scale", 0.1)
    assert (ran.code, ran.err) == (0, "")
    assert "000007: 3 lights, depth" in ran.out
    folder = tmp_path / "000007"
    assert sorted(p.name for p in folder.iterdir()) == ["depth", "lit", "scene_camera.json", "scene_lights.json"]
    for k in range(3):
        np.testing.assert_array_equal(stored(folder / f"lit/000000_{k:02d}.png"), stored(taken / f"im{k}.png"))
    np.testing.assert_array_equal(stored(folder / "depth/000000.png"), stored(taken / "depth.png"))
    sensor = load_sensor(taken / "sensor.json")
    scene = load_scene(folder, sensor=sensor)
    assert scene.scene_id == 7
    np.testing.assert_allclose(scene.images[1], stored(taken / "im1.png") / 4095, atol=1e-6)
    np.testing.assert_allclose(scene.sensor.light_directions, sensor.light_directions, atol=1e-12)
    # without a pose, the camera is taken to look straight down
    np.testing.assert_array_equal(scene.R_w2c, np.diag([1.0, -1.0, -1.0]))
    assert load_scene(folder).sensor.working_distance == sensor.working_distance
    assert list(tmp_path.iterdir()) == [folder]


def test_response_and_distortion_are_left_to_the_sensor(make, taken, tmp_path):
    """Images stay as the lens and the converter made them; the sensor JSON undoes both when they are read."""
    sensor = replace(load_sensor(taken / "sensor.json"), gamma=2.2, distortion=(-0.1, 0.02, 0.0, 0.0))
    save_sensor(sensor, tmp_path / "lens.json")
    coded = []
    for k in range(3):
        put(tmp_path / f"g{k}.png", 4095 * (stored(taken / f"im{k}.png") / 4095) ** (1 / 2.2))
        coded.append(tmp_path / f"g{k}.png")
    assert make(images=coded, sensor=tmp_path / "lens.json").code == 0
    for k, path in enumerate(coded):
        np.testing.assert_array_equal(stored(tmp_path / f"000007/lit/000000_{k:02d}.png"), stored(path))


def test_the_ambient_frame_is_subtracted(make, taken, tmp_path):
    lamps = [stored(taken / f"im{k}.png").astype(float) for k in range(3)]
    ambient = stored(taken / "ambient.png")
    with_ambient = []
    for k, image in enumerate(lamps):
        put(tmp_path / f"a{k}.png", image + ambient)
        with_ambient.append(tmp_path / f"a{k}.png")
    assert make("--ambient", taken / "ambient.png", images=with_ambient).code == 0
    np.testing.assert_array_equal(stored(tmp_path / "000007/lit/000000_01.png"), lamps[1])


def test_a_pose_of_the_camera_is_kept(make, tmp_path):
    pose = tmp_path / "pose.json"
    pose.write_text(json.dumps({"R": [0, 1, 0, 1, 0, 0, 0, 0, -1], "t": [5, 6, 900]}))
    assert make("--camera-pose", pose).code == 0
    scene = load_scene(tmp_path / "000007")
    np.testing.assert_array_equal(scene.R_w2c, [[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    np.testing.assert_array_equal(scene.t_w2c, [5, 6, 900])


def test_a_second_camera(make, taken, tmp_path):
    pose = tmp_path / "right.json"
    pose.write_text(json.dumps({"R": np.eye(3).ravel().tolist(), "t": [-120.0, 0.0, 0.0]}))
    right = [taken / f"im{k}.png" for k in range(3)]
    words = ["--right-images", *right, "--right-sensor", taken / "sensor.json", "--right-pose", pose]
    ran = make(*words, "--right-ambient", taken / "ambient.png")
    assert ran.code == 2  # the images hold no ambient light
    assert "ambient.png: the ambient frame is brighter than image" in ran.err
    ran = make(*words)
    assert (ran.code, ran.err) == (0, "")
    assert "two cameras" in ran.out
    folder = tmp_path / "000007"
    assert json.loads((folder / "scene_stereo.json").read_text()) == {"0": {"right": 1}}
    assert len(list((folder / "lit").iterdir())) == 6
    one, other = load_scene(folder), load_scene(folder, im_id=1)
    np.testing.assert_array_equal(other.images, one.images)
    np.testing.assert_allclose(other.t_w2c - one.t_w2c, [-120.0, 0.0, 0.0])
    # a pose that turns the lights away from where the right sensor has them
    pose.write_text(json.dumps({"R": [0, 1, 0, -1, 0, 0, 0, 0, 1], "t": [-120.0, 0.0, 0.0]}))
    ran = make(*words, folder="000008")
    assert ran.code == 2
    assert "of the right sensor is" in ran.err
    for some in (words[:4], words[4:6], words[6:], ["--right-ambient", taken / "ambient.png"]):
        assert make(*some, folder="000008").code == 2
    assert not (tmp_path / "000008").exists()


@pytest.mark.parametrize(("images", "message"), [
    (["im0.png", "im1.png"], "the sensor has 3 lights, but 2 images are given"),
    (["im0.png", "im1.png", "im2.png", "im2.png"], "the sensor has 3 lights, but 4 images are given"),
    ([], "no images are given"),
    (["im0.png", "im1.png", "im1.png"], "are the same image"),
    (["im1.png", "im0.png", "im2.png"], "the images are not in the order of the lights: they fit better when"),
    (["im0.png", "im1.png", "none.png"], "none.png: the image cannot be read"),
])  # fmt: skip
def test_wrong_images_are_refused(make, tmp_path, images, message):
    ran = make(images=images)
    assert (ran.code, ran.out) == (2, "")
    assert message in ran.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("scale", "message"), [
    (0.01, "too dark"),
    (2.5, "lit pixels are saturated, at most 25 % may be"),
    (0.05, "warning"),
])  # fmt: skip
def test_exposure(make, taken, tmp_path, scale, message):
    images = []
    for k in range(3):
        put(tmp_path / f"e{k}.png", np.minimum(stored(taken / f"im{k}.png") * scale, 4095))
        images.append(tmp_path / f"e{k}.png")
    ran = make(images=images)
    assert message in ran.err
    assert (tmp_path / "000007").exists() == (message == "warning")
    assert ran.code == (0 if message == "warning" else 2)


def test_a_lamp_that_is_off_and_a_lamp_not_switched(make, taken, tmp_path):
    put(tmp_path / "off.png", stored(taken / "im1.png") * 0.02)
    ran = make(images=["im0.png", tmp_path / "off.png", "im2.png"])
    assert ran.code == 2
    assert "Was lamp 1 on?" in ran.err
    rng = np.random.default_rng(1)
    image = stored(taken / "im0.png")
    put(tmp_path / "again.png", np.minimum(image + rng.normal(0.0, 3.0, image.shape), 4095))
    ran = make(images=["im0.png", tmp_path / "again.png", "im2.png"])
    assert ran.code == 2
    assert "show the same light" in ran.err


def test_sizes_depth_and_poses_that_do_not_fit(make, taken, tmp_path):
    small = tmp_path / "small.png"
    put(small, stored(taken / "im1.png")[::2])
    empty = tmp_path / "empty.png"
    put(empty, np.zeros((480, 640)))
    pose = tmp_path / "pose.json"
    pose.write_text('{"R": [1, 0, 0], "t": [0, 0, 1]}')
    mirror = tmp_path / "mirror.json"
    mirror.write_text('{"R": [1, 0, 0, 0, 1, 0, 0, 0, -1], "t": [0, 0, 1]}')
    depth = ["--depth", taken / "depth.png"]
    for words, images, message in (
        ([], ["im0.png", small, "im2.png"], "small.png: the image is 640 x 240 px, the sensor's are 640 x 480 px"),
        (["--depth", small], None, "small.png: the image is 640 x 240 px"),
        (depth, None, "depth.png: its median depth is"),
        ([*depth, "--depth-scale", -1], None, "--depth-scale must be positive"),
        (["--depth", empty], None, "empty.png: the depth map has no depth"),
        (["--ambient", small], None, "small.png: the image is 640 x 240 px"),
        (["--ambient", taken / "im0.png"], None, "im0.png: the ambient frame is brighter than image"),
        (["--camera-pose", pose], None, "pose.json: 'R' must be 9 and 't' 3 finite numbers"),
        (["--camera-pose", mirror], None, "mirror.json: 'R' is not a rotation matrix"),
        (["--camera-pose", small], None, "small.png: a pose is JSON like"),
    ):
        ran = make(*words) if images is None else make(*words, images=images)
        assert (ran.code, ran.out) == (2, "")
        assert message in ran.err
        assert not (tmp_path / "000007").exists()


def test_where_a_scene_cannot_be_written(make, tmp_path):
    (tmp_path / "000007").mkdir()
    assert "exists already" in make().err
    assert "there is no folder" in make(folder="missing/000001").err
    assert "is neither a JSON file nor a scene folder" in make(sensor="nothing.json", folder="000009").err
    assert [p.name for p in tmp_path.iterdir()] == ["000007"]
