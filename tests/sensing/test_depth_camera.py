"""A depth camera as a sensor: its files, its limits, its scenes, and the needle map that is read of it."""

import json
from dataclasses import replace

import numpy as np
import pytest
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError

from itree_jax.cli.main import main as itree
from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.depth_camera import (
    STEEPEST,
    depth_camera,
    depth_needle_deviation,
    depth_slant_limit,
    needles_of_depth,
)
from itree_jax.sensing.depth_needles import depth_needles
from itree_jax.sensing.reading import read_needles
from itree_jax.sensing.regions import regions
from itree_jax.sensing.scene_folder import Scene, load_scene, sensor_of_scene
from itree_jax.sensing.scene_writer import write_scene
from itree_jax.sensing.sensor_file import (
    fingerprint,
    load_sensor,
    load_unlit_sensor,
    save_sensor,
    sensor_from_json,
    sensor_to_json,
)

BENCH = sensor_to_json(bundled_sensor("depth-bench"))
WIDTH, HEIGHT = 60, 48
SMALL = replace(
    bundled_sensor("depth-bench"), camera=Camera("pinhole", 1815.0, 1815.0, 29.5, 23.5, WIDTH, HEIGHT)
)
NO_IMAGES = np.zeros((0, HEIGHT, WIDTH), np.float32)


def plane(noise: float, seed: int = 0) -> np.ndarray:
    """Depth [mm] of a surface that faces the camera."""
    return (850.0 + np.random.default_rng(seed).normal(0.0, noise, (HEIGHT, WIDTH))).astype(np.float32)


def scene(noise: float = 0.3) -> Scene:
    return Scene(3, 0, NO_IMAGES, plane(noise), SMALL, np.diag([1.0, -1.0, -1.0]), None, np.array([0.0, 0.0, 900.0]))


def test_the_bundled_one_is_the_bench_without_lights():
    sensor, bench = bundled_sensor("depth-bench"), bundled_sensor("bench")
    assert sensor.is_depth_camera
    assert not bench.is_depth_camera
    assert (sensor.light_count, sensor.depth_noise) == (0, 0.3)
    assert sensor.light_directions.shape == (0, 3)
    assert (sensor.camera, sensor.smallest_region) == (bench.camera, bench.smallest_region)
    assert bench.depth_noise is None


def test_a_file_tells_the_noise_instead_of_lights(tmp_path):
    assert BENCH["depth_camera"] == {"noise_mm": 0.3}
    assert "lights" not in BENCH
    sensor = replace(bundled_sensor("depth-bench"), slant_limit=0.5, depth_noise=0.11)
    save_sensor(sensor, tmp_path / "sensor.json")
    again = load_sensor(tmp_path / "sensor.json")
    assert sensor_to_json(again) == sensor_to_json(sensor)
    assert again.light_directions.shape == (0, 3)
    assert load_unlit_sensor(tmp_path / "sensor.json").camera == sensor.camera


def test_the_slant_limit_follows_unless_it_is_stated():
    data = {key: value for key, value in BENCH.items() if key != "slant_limit_deg"} | {"depth_camera": {"noise_mm": 1}}
    sensor = sensor_from_json(data, "x")
    assert sensor.slant_limit == depth_slant_limit(1.0, sensor.mm_per_px, sensor.smallest_region)
    stated = sensor_from_json(data | {"slant_limit_deg": 20.0}, "x")
    assert np.degrees(stated.slant_limit) == pytest.approx(20.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"lights": {"directions": [[0, 0, -1]] * 3}}, "not both"),
        ({"depth_camera": {}}, "'depth_camera.noise_mm' is missing"),
        ({"depth_camera": {"noise_mm": -1.0}}, "must be at least 0"),
        ({"depth_camera": {"noise": 1.0}}, "missing"),
        ({"depth_camera": None}, "must be of type object"),
    ],
)
def test_wrong_files_are_refused(change, message):
    with pytest.raises(ItreeError, match=f"x: .*{message}"):
        sensor_from_json(BENCH | change, "x")


def test_the_fingerprint_tells_a_depth_camera_and_its_noise():
    sensor = bundled_sensor("depth-bench")
    others = [replace(sensor, depth_noise=0.2), bundled_sensor("bench"), replace(sensor, slant_limit=0.6)]
    assert len({fingerprint(s) for s in [sensor, *others]}) == 4


def test_more_noise_loses_steeper_surfaces_and_too_much_loses_all():
    limits = np.array([depth_slant_limit(noise, 0.5, 60.0) for noise in (0.0, 0.3, 0.6, 1.0, 1.5)])
    assert (limits <= STEEPEST).all()
    assert (np.diff(limits) <= 0).all()
    assert limits[-1] < limits[-2] < STEEPEST
    # the window that the noise asks for, foreshortened, is as wide as the smallest region
    side = np.sqrt(1.5 * np.sqrt(12.0) / (0.5 * np.radians(3.0)))
    assert np.cos(limits[-1]) == pytest.approx(side * 0.5 / np.sqrt(60.0))
    with pytest.raises(ItreeError, match="Raise the sensor's smallest region"):
        depth_slant_limit(5.0, 0.5, 60.0)


def test_the_deviation_is_that_of_the_needles():
    found = depth_needles(plane(0.3), SMALL.camera, 0.3)
    inner = found.normal_std[8:-8, 8:-8]
    expected = depth_needle_deviation(0.3, SMALL.camera.mm_per_px(850.0))
    np.testing.assert_allclose(np.median(inner), expected, rtol=0.01)


def test_the_needle_map_comes_from_the_depth_alone():
    depth = plane(0.3)
    needle = read_needles(NO_IMAGES, SMALL, depth)
    assert needle.shadowed.shape == (0, HEIGHT, WIDTH)
    assert needle.interpretable.mean() > 0.99
    np.testing.assert_array_equal(needle.normals, depth_needles(depth, SMALL.camera, 0.3).normals)
    found = regions(needle, depth, SMALL)
    assert found.count == 1
    assert found.area_px[0] > 0.98 * WIDTH * HEIGHT
    with pytest.raises(ItreeError, match="there is none"):
        read_needles(NO_IMAGES, SMALL, None)
    with pytest.raises(ItreeError, match="must state its noise"):
        needles_of_depth(depth, replace(SMALL, depth_noise=None))


def test_a_scene_is_written_without_lights_and_read_back(tmp_path):
    folder = tmp_path / "000003"
    write_scene(folder, scene())
    assert sorted(p.name for p in folder.iterdir() if p.suffix != ".json") == ["depth"]
    assert not (folder / "scene_lights.json").exists()
    again = load_scene(folder)
    assert again.images.shape == (0, HEIGHT, WIDTH)
    assert again.depth is not None
    np.testing.assert_allclose(again.depth, scene().depth, atol=0.051)
    sensor = sensor_of_scene(folder)
    assert sensor.is_depth_camera
    assert sensor.depth_noise == pytest.approx(0.3, rel=0.1)
    assert sensor.slant_limit == depth_slant_limit(sensor.depth_noise, sensor.mm_per_px, sensor.smallest_region)
    assert load_scene(folder, sensor=SMALL).sensor.depth_noise == 0.3  # what a sensor states stands
    of_lights = load_scene(folder, sensor=bundled_sensor("bench")).sensor
    assert of_lights.depth_noise == sensor.depth_noise


def test_the_command_writes_the_needle_map_of_a_scene(tmp_path):
    write_scene(tmp_path / "000003", scene())
    assert itree(["needle", str(tmp_path / "000003"), "-o", str(tmp_path / "out"), "--quiet"]) == 0
    normals = np.load(tmp_path / "out" / "normals.npy")
    assert normals.shape == (HEIGHT, WIDTH, 3)
    assert np.nanmedian(normals[..., 2]) < -0.99
    assert (tmp_path / "out" / "needles.png").exists()


def test_a_depth_map_without_noise_still_has_that_of_its_steps(tmp_path):
    write_scene(tmp_path / "000003", scene(noise=0.0))
    assert sensor_of_scene(tmp_path / "000003").depth_noise == pytest.approx(0.1 / np.sqrt(12.0))


def test_lights_without_images_and_nothing_at_all_are_refused(tmp_path):
    write_scene(tmp_path / "000003", scene())
    (tmp_path / "000003" / "scene_lights.json").write_text(json.dumps({}))
    with pytest.raises(ItreeError, match=r"neither lit/ nor scene_lights.json"):
        load_scene(tmp_path / "000003")
    (tmp_path / "000003" / "scene_lights.json").unlink()
    (tmp_path / "000003" / "depth" / "000000.png").unlink()
    with pytest.raises(ItreeError, match="there is no image"):
        load_scene(tmp_path / "000003")


def test_any_sensor_can_be_taken_without_its_lights():
    sensor = depth_camera(bundled_sensor("ikeuchi-1987"), 0.1)
    assert sensor.is_depth_camera
    assert sensor.camera.is_orthographic
    assert depth_camera(sensor, 0.1, slant_limit=0.3).slant_limit == 0.3
