"""`itree calibrate-lights`: from photographs of spheres to what "lights" of a sensor JSON holds."""

import json

import cv2
import numpy as np
import pytest

from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.light_calibration.sphere import Sphere
from itree_jax.sensing.sensor_file import sensor_from_json, sensor_to_json

from ..sensing.conftest import light_ring
from ..sensing.rendered_spheres import (
    BY_ORTHOGRAPHIC,
    BY_PINHOLE,
    PINHOLE,
    degrees_between,
    mask_of,
    matte,
    mirror,
    near_matte,
    write_photographs,
)

L, E = light_ring(5), np.array([0.7, 0.8, 0.9, 0.6, 0.75])
DISTANCE = 300.0


@pytest.fixture
def spheres(tmp_path):
    for sphere, name in ((BY_ORTHOGRAPHIC, "orthographic"), (BY_PINHOLE, "pinhole")):
        mask = mask_of(sphere)
        write_photographs(tmp_path / name / "chrome", mirror(sphere, L), mask, colour=True)
        write_photographs(tmp_path / name / "matte", matte(sphere, L, E), mask)
    camera = {**sensor_to_json(bundled_sensor("bench")), "working_distance_mm": DISTANCE}
    camera["camera"] = {"kind": "pinhole", "fx": 400, "fy": 400, "cx": 159.5, "cy": 119.5, "size": [320, 240]}
    del camera["lights"]
    (tmp_path / "camera.json").write_text(json.dumps(camera))
    return tmp_path


def sensor_with(lights_file, camera_file):
    """The sensor JSON takes the file's content as it is."""
    data = json.loads(camera_file.read_text()) | {"lights": json.loads(lights_file.read_text())}
    return sensor_from_json(data, "x")


@pytest.mark.parametrize("camera", ["orthographic", "pinhole"])
@pytest.mark.parametrize("kind", ["chrome", "matte"])
def test_lights_come_back(itree, spheres, camera, kind):
    out, picture = spheres / "lights.json", spheres / "fit.png"
    words = ["calibrate-lights", spheres / camera / kind, "--sphere", kind, "-o", out, "--picture", picture]
    words += ["--camera", spheres / "camera.json"] if camera == "pinhole" else []
    words += ["--intensities-from", spheres / camera / "matte"] if kind == "chrome" else []
    ran = itree(*words)
    assert (ran.code, ran.err) == (0, "")
    assert f"5 lights ({camera} camera" in ran.out
    sensor = sensor_with(out, spheres / "camera.json")
    assert degrees_between(sensor.light_directions, L).max() < 0.1
    np.testing.assert_allclose(sensor.light_intensities, E / E.mean(), rtol=3e-3)
    drawn = cv2.imread(str(picture))
    assert drawn is not None
    assert drawn.shape[1] > 1000


def test_a_mirror_alone_tells_no_intensities(itree, spheres):
    out = spheres / "lights.json"
    assert itree("calibrate-lights", spheres / "orthographic" / "chrome", "--sphere", "chrome", "-o", out).code == 0
    assert json.loads(out.read_text())["intensities"] == [1.0] * 5


def test_spheres_at_several_places_tell_near_lights(itree, spheres):
    positions = np.array([0.0, 0.0, DISTANCE]) + 260.0 * light_ring(4, np.radians(40.0))
    own = 260.0**2 * np.array([0.5, 0.6, 0.55, 0.65])
    folders = []
    for k, centre in enumerate([[-40.0, 0, 300], [35.0, 10, 320], [0.0, -30, 280]]):
        sphere = Sphere(PINHOLE, np.array(centre), 20.0, 0.0)
        folders.append(write_photographs(spheres / f"place{k}", near_matte(sphere, positions, own), mask_of(sphere)))
    out = spheres / "near.json"
    words = ["--sphere", "matte", "--camera", spheres / "camera.json", "-o", out, "--picture", spheres / "near.png"]
    ran = itree("calibrate-lights", *folders, *words, "--near", "--radius-mm", 20)
    assert (ran.code, ran.err) == (0, "")
    sensor = sensor_with(out, spheres / "camera.json")
    assert sensor.light_positions is not None
    assert np.linalg.norm(sensor.light_positions - positions, axis=1).max() < 3.0  # of 260 mm: a tenth of a pixel
    np.testing.assert_allclose(sensor.light_intensities, own / own.mean(), rtol=0.02)


def test_errors_are_told_and_nothing_is_written(itree, spheres, tmp_path):
    chrome, shiny = spheres / "orthographic" / "chrome", ["--sphere", "chrome"]
    mask = mask_of(BY_ORTHOGRAPHIC)
    dark = mirror(BY_ORTHOGRAPHIC, L)
    dark[2] = 0.0
    near, pinhole = ["--near", "--radius-mm", "20"], ["--camera", spheres / "camera.json"]
    wrong = {
        "2 images are too few": [write_photographs(tmp_path / "few", dark[:2], mask), *shiny],
        "photo.2.png: no highlight": [write_photographs(tmp_path / "dark", dark, mask), *shiny],
        "the mask is 319 x 240 px": [write_photographs(tmp_path / "mask", dark, mask[:, 1:]), *shiny],
        "no mask of the sphere": [write_photographs(tmp_path / "none", dark), *shiny],
        "cannot be read": [chrome, *shiny, "--mask", tmp_path / "gone.png"],
        "no such folder": [tmp_path / "gone", *shiny],
        "no IMAGES": shiny,
        "--mask goes with one": [chrome, chrome, *shiny, "--mask", chrome / "mask.png"],
        "needs --radius-mm R, and folders": [chrome, *shiny, *near],
        "with a pinhole camera": [chrome, chrome, *shiny, *near],
        "are parallel": [*[spheres / "pinhole" / "matte"] * 2, "--sphere", "matte", *near, *pinhole],
        "neither a JSON file": [chrome, *shiny, "--camera", tmp_path / "gone.json"],
        "goes with --sphere chrome": [chrome, "--sphere", "matte", "--intensities-from", chrome],
        "are not like": [chrome, write_photographs(tmp_path / "three", dark[:2][[0, 1, 1]], mask), *shiny],
    }
    for message, words in wrong.items():
        ran = itree("calibrate-lights", *words, "-o", tmp_path / "out.json")
        assert (ran.code, ran.out) == (2, ""), message
        assert message in ran.err
        assert not (tmp_path / "out.json").exists()
