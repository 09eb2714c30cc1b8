"""Scene folders: written and read back, linearised, undistorted, and refused with the file that is wrong."""

import json
import shutil
from contextlib import nullcontext
from dataclasses import replace

import cv2
import numpy as np
import pytest
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError, ItreeWarning

from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.scene_folder import Scene, load_scene, scene_folders, sensor_of_scene
from itree_jax.sensing.scene_writer import TrueObject, write_scene
from itree_jax.sensing.sensor_file import load_sensor
from itree_jax.sensor import Noise

R_W2C = np.diag([1.0, -1.0, -1.0])
WIDTH, HEIGHT = 40, 30


def make_scene(kind="pinhole", **changes):
    rng = np.random.default_rng(5)
    sensor = bundled_sensor("bench" if kind == "pinhole" else "ikeuchi-1987")
    f = 100.0 if kind == "pinhole" else 2.0
    sensor = replace(sensor, camera=Camera(kind, f, f + 1, 19.5, 14.5, WIDTH, HEIGHT), working_distance=850.0)
    depth = rng.uniform(700, 900, (HEIGHT, WIDTH)).astype(np.float32)
    depth[0] = 0.0
    images = rng.uniform(0, 1, (3, HEIGHT, WIDTH)).astype(np.float32)
    t_w2c = np.array([10.0, -20.0, 850.0])
    scene = Scene(12, 0, images, depth, sensor, R_W2C, None, t_w2c)
    return replace(scene, **changes)


@pytest.mark.parametrize("kind", ["pinhole", "orthographic"])
def test_written_and_read_back(kind, tmp_path):
    scene = make_scene(kind)
    write_scene(tmp_path / "test" / "000012", scene)
    again = load_scene(tmp_path / "test" / "000012")
    assert (again.scene_id, again.im_id) == (12, 0)
    np.testing.assert_allclose(again.images, scene.images, rtol=0, atol=0.5 / 65535 + 1e-7)
    np.testing.assert_allclose(again.depth, scene.depth, rtol=0, atol=0.051)
    np.testing.assert_array_equal(again.R_w2c, scene.R_w2c)
    np.testing.assert_array_equal(again.t_w2c, scene.t_w2c)
    assert again.sensor.camera == scene.sensor.camera
    np.testing.assert_allclose(again.sensor.light_directions, scene.sensor.light_directions, atol=1e-15)
    np.testing.assert_array_equal(again.sensor.light_intensities, scene.sensor.light_intensities)
    assert again.sensor.working_distance == pytest.approx(850.0, abs=1e-9)
    assert np.degrees(again.sensor.slant_limit) == pytest.approx(42.0)
    assert load_sensor(tmp_path).camera == scene.sensor.camera
    assert [p.name for p in (tmp_path / "test").iterdir()] == ["000012"]  # nothing temporary left


def test_true_poses_are_written_as_bop_has_them(tmp_path):
    R, t = np.eye(3)[[1, 2, 0]], np.array([1.0, 2.0, 800.0])
    write_scene(tmp_path / "000000", make_scene(), [TrueObject(4, R, t, 200, 50, (3, 4, 5, 6))])
    poses = json.loads((tmp_path / "000000" / "scene_gt.json").read_text())
    visibility = json.loads((tmp_path / "000000" / "scene_gt_info.json").read_text())
    assert poses == {"0": [{"obj_id": 4, "cam_R_m2c": [0, 1, 0, 0, 0, 1, 1, 0, 0], "cam_t_m2c": [1, 2, 800]}]}
    expected = {"visib_fract": 0.25, "px_count_all": 200, "px_count_visib": 50, "bbox_visib": [3, 4, 5, 6]}
    assert visibility == {"0": [expected]}


def test_what_exists_is_not_overwritten_unless_asked(tmp_path):
    folder = tmp_path / "000000"
    write_scene(folder, make_scene())
    with pytest.raises(ItreeError, match="exists already"):
        write_scene(folder, make_scene())
    write_scene(folder, make_scene(depth=None), overwrite=True)
    assert load_scene(folder).depth is None
    assert [p.name for p in tmp_path.iterdir()] == ["000000"]


def test_a_depth_beyond_16_bits_is_refused_and_nothing_is_left(tmp_path):
    with pytest.raises(ItreeError, match="larger depth_scale"):
        write_scene(tmp_path / "000000", make_scene(depth=np.full((HEIGHT, WIDTH), 7000.0, np.float32)))
    assert list(tmp_path.iterdir()) == []


def test_scene_folders_of_dataset_of_test_folder_and_of_one_scene(tmp_path):
    for name in ("000002", "000001"):
        write_scene(tmp_path / "test" / name, make_scene())
    expected = [tmp_path / "test" / "000001", tmp_path / "test" / "000002"]
    assert scene_folders(tmp_path) == expected
    assert scene_folders(tmp_path / "test") == expected
    assert scene_folders(expected[1]) == expected[1:]
    with pytest.raises(ItreeError, match="no scene folder"):
        scene_folders(expected[0] / "lit")
    with pytest.raises(ItreeError, match="no such folder"):
        scene_folders(tmp_path / "nowhere")


@pytest.mark.parametrize(("stored", "bit_depth", "full_scale"), [
    (np.uint8, None, 255), (np.uint16, None, 65535), (np.uint16, 12, 4095), (np.uint16, 10, 1023),
])  # fmt: skip
@pytest.mark.parametrize("gamma", [1.0, 2.2])
def test_stored_values_become_linear_intensity(stored, bit_depth, full_scale, gamma, tmp_path):
    scene = make_scene()
    folder = tmp_path / "000000"
    write_scene(folder, scene)
    for k, image in enumerate(scene.images):
        code = np.round(image ** (1 / gamma) * full_scale).astype(stored)
        cv2.imwrite(str(folder / "lit" / f"000000_{k:02d}.png"), code)
    sensor = replace(scene.sensor, gamma=gamma, bit_depth=bit_depth, noise=Noise(bits=8))
    doubtful = stored is np.uint8 and gamma == 1.0  # nothing is said of the response
    with pytest.warns(ItreeWarning, match="stored in 8 bits") if doubtful else nullcontext():
        loaded = load_scene(folder, sensor=sensor)
    np.testing.assert_allclose(loaded.images, scene.images, rtol=0, atol=0.51 * gamma / full_scale)
    assert loaded.sensor.noise == Noise(bits=8)
    told = replace(sensor, bit_depth=bit_depth or 8 * np.dtype(stored).itemsize)
    assert load_scene(folder, Noise(bits=9), sensor=told).sensor.noise == Noise(bits=9)


def test_float_images_are_read_as_they_are(tmp_path):
    scene = make_scene()
    write_scene(tmp_path / "000000", scene)
    for k, image in enumerate(scene.images):
        (tmp_path / "000000" / "lit" / f"000000_{k:02d}.png").unlink()
        if k == 0:
            np.save(tmp_path / "000000" / "lit" / f"000000_{k:02d}.npy", image)
        else:
            cv2.imwrite(str(tmp_path / "000000" / "lit" / f"000000_{k:02d}.tiff"), image)
    np.testing.assert_array_equal(load_scene(tmp_path / "000000").images, scene.images)


def test_a_distorted_image_is_undistorted(tmp_path):
    """A smooth pattern, drawn through OpenCV's forward model, comes back as an ideal camera sees it."""
    distortion = (-2.0, 1.0, 1e-2, -1e-2)
    scene = make_scene()
    c = scene.sensor.camera
    K = np.array([[c.fx, 0, c.cx], [0, c.fy, c.cy], [0, 0, 1]])
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(float)

    def pattern(u, v):
        return 0.5 + 0.3 * np.sin(u / 9) * np.cos(v / 7)

    ideal = cv2.undistortPoints(np.stack([u, v], -1).reshape(-1, 1, 2), K, np.array(distortion), P=K).reshape(-1, 2).T
    seen = pattern(*ideal).reshape(HEIGHT, WIDTH)
    write_scene(tmp_path / "000000", replace(scene, images=np.stack([seen, 0.9 * seen, 0.8 * seen]).astype(np.float32)))
    loaded = load_scene(tmp_path / "000000", sensor=replace(scene.sensor, distortion=distortion))
    inside = np.s_[3:-3, 3:-3]
    np.testing.assert_allclose(loaded.images[0][inside], pattern(u, v)[inside], atol=4e-3)
    assert np.abs(seen - pattern(u, v))[inside].max() > 0.03  # the lens matters


def test_working_distance_without_a_camera_pose_is_the_median_depth(tmp_path):
    scene = make_scene(R_w2c=None, t_w2c=None)
    write_scene(tmp_path / "a", scene)
    assert sensor_of_scene(tmp_path / "a").working_distance == pytest.approx(np.median(scene.depth[1:]), abs=0.1)
    write_scene(tmp_path / "b", replace(scene, depth=None))
    with pytest.raises(ItreeError, match="sensor JSON with 'working_distance_mm'"):
        sensor_of_scene(tmp_path / "b")


def test_working_distance_of_a_tilted_camera_is_along_the_optical_axis(tmp_path):
    tilt = np.radians(30.0)
    R = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]]) @ R_W2C
    centre = np.array([5.0, 7.0, 600.0])  # of the camera, in the world, 600 mm above z = 0
    write_scene(tmp_path / "a", make_scene(R_w2c=R, t_w2c=-R @ centre))
    assert sensor_of_scene(tmp_path / "a").working_distance == pytest.approx(600.0 / np.cos(tilt))


def edit_json(folder, name, change):
    data = json.loads((folder / name).read_text())
    change(data)
    (folder / name).write_text(json.dumps(data))


def small(folder, name):
    cv2.imwrite(str(folder / name), np.zeros((4, 5), np.uint16))


def colour(folder):
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    image[..., 1] = 7
    cv2.imwrite(str(folder / "lit" / "000000_01.png"), image)


WRONG = {
    "lit image missing": (lambda f: (f / "lit" / "000000_01.png").unlink(), r"image 000000_01 \(light 1\) is missing"),
    "lights missing": (lambda f: (f / "scene_lights.json").unlink(), r"scene_lights\.json: cannot be read"),
    "last image missing": (lambda f: (f / "lit" / "000000_02.png").unlink(), "tells 3 lights .* has 2 images"),
    "no images": (lambda f: shutil.rmtree(f / "lit"), r"there is no image 000000_00\.png"),
    "image size": (lambda f: small(f, "lit/000000_02.png"), r"000000_02\.png: the image is 5 x 4 px"),
    "depth size": (lambda f: small(f, "depth/000000.png"), "depth: the image is 5 x 4 px"),
    "colour": (colour, r"000000_01\.png: the image has colour"),
    "garbage": (lambda f: (f / "lit" / "000000_00.png").write_bytes(b"no"), r"000000_00\.png: not an image"),
    "no cam_K": (lambda f: edit_json(f, "scene_camera.json", lambda d: d["0"].pop("cam_K")), "no 'cam_K'"),
    "cam_K": (lambda f: edit_json(f, "scene_camera.json", lambda d: d["0"].update(cam_K=[1, 2])), "'cam_K' must be 9"),
    "focal": (
        lambda f: edit_json(f, "scene_camera.json", lambda d: d["0"]["cam_K"].__setitem__(0, -1)),
        "positive fx, fy",
    ),
    "rotation": (
        lambda f: edit_json(f, "scene_camera.json", lambda d: d["0"].update(cam_R_w2c=[1, 0, 0, 0, 1, 0, 0, 0, -1])),
        "not a rotation",
    ),
    "depth_scale": (
        lambda f: edit_json(f, "scene_camera.json", lambda d: d["0"].update(depth_scale=0)),
        "'depth_scale' must be positive",
    ),
    "image key": (
        lambda f: edit_json(f, "scene_lights.json", lambda d: d.pop("0")),
        r"scene_lights\.json: the key '0' \(camera image 0\) is missing",
    ),
    "light": (
        lambda f: edit_json(f, "scene_lights.json", lambda d: d["0"]["directions"][1].__setitem__(2, 0.5)),
        r"scene_lights\.json: image 0: light direction 1 must be a unit vector",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_folder_is_told(case, tmp_path):
    break_it, message = WRONG[case]
    write_scene(tmp_path / "000000", make_scene())
    break_it(tmp_path / "000000")
    with pytest.raises(ItreeError, match=message) as error:
        load_scene(tmp_path / "000000")
    assert str(tmp_path) in str(error.value)


def test_values_above_the_stated_bit_depth_are_refused(tmp_path):
    scene = make_scene()
    write_scene(tmp_path / "000000", scene)
    with pytest.raises(ItreeError, match="above full scale of 12 bits"):
        load_scene(tmp_path / "000000", sensor=replace(scene.sensor, bit_depth=12))


def test_near_lights_come_back_from_the_folder(tmp_path):
    scene = make_scene()
    positions = np.array([[0.0, -300, 100], [-300.0, 200, 100], [300.0, 200, 100]])
    write_scene(tmp_path / "000000", replace(scene, sensor=replace(scene.sensor, light_positions=positions)))
    again = load_scene(tmp_path / "000000").sensor
    np.testing.assert_array_equal(again.light_positions, positions)
    to_light = positions - [0.0, 0.0, again.working_distance]
    to_light /= np.linalg.norm(to_light, axis=1, keepdims=True)
    np.testing.assert_allclose(again.light_directions, to_light, atol=1e-12)
    with_response = load_scene(tmp_path / "000000", sensor=scene.sensor).sensor
    np.testing.assert_array_equal(with_response.light_positions, positions)
