"""Sensors read from JSON, scene folders and bundled names; every wrong input is told with file and key."""

import copy
import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError

from itree_jax.sensing.bundled import BUNDLED_SENSORS, bundled_sensor
from itree_jax.sensing.sensor_file import (
    SENSOR_SCHEMA,
    fingerprint,
    load_sensor,
    load_unlit_sensor,
    save_sensor,
    sensor_from_json,
    sensor_to_json,
)
from itree_jax.sensor import Noise, Sensor

BENCH = sensor_to_json(bundled_sensor("bench"))


def assert_same(a: Sensor, b: Sensor) -> None:
    assert a.camera == b.camera
    assert (a.noise, a.distortion, a.gamma, a.bit_depth) == (b.noise, b.distortion, b.gamma, b.bit_depth)
    np.testing.assert_allclose(a.light_directions, b.light_directions, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(a.light_intensities, b.light_intensities)
    assert a.slant_limit == pytest.approx(b.slant_limit, rel=1e-14)
    assert (a.smallest_region, a.working_distance) == (b.smallest_region, b.working_distance)
    if b.region_of_interest is None:
        assert a.region_of_interest is None
    else:
        np.testing.assert_array_equal(a.region_of_interest, b.region_of_interest)


def test_the_papers_sensor_has_the_lights_of_the_design():
    sensor = load_sensor("bundled:ikeuchi-1987")
    printed = [[0, -0.5736, -0.8192], [-0.4967, 0.2868, -0.8192], [0.4967, 0.2868, -0.8192]]
    np.testing.assert_allclose(sensor.light_directions, printed, atol=5e-5)
    np.testing.assert_allclose(np.linalg.norm(sensor.light_directions, axis=1), 1.0, atol=1e-15)
    np.testing.assert_allclose(np.degrees(np.arccos(-sensor.light_directions[:, 2])), 35.0, atol=1e-12)
    assert sensor.camera == Camera("orthographic", 2.0, 2.0, 319.5, 239.5, 640, 480)
    assert np.degrees(sensor.slant_limit) == pytest.approx(42.0, abs=1e-12)
    assert sensor.smallest_region == 60.0
    assert sensor.mm_per_px == 0.5


@pytest.mark.parametrize("name", BUNDLED_SENSORS)
def test_save_and_load_give_the_sensor_back(name, tmp_path):
    sensor = bundled_sensor(name)
    save_sensor(sensor, tmp_path / "sensor.json")
    assert_same(load_sensor(tmp_path / "sensor.json"), sensor)


@pytest.mark.parametrize("shape", ["rectangle", "disk"])
def test_save_and_load_give_every_field_back(shape, tmp_path):
    v, u = np.mgrid[:480, :640]
    disk = (u - 300) ** 2 + (v - 200) ** 2 < 150**2
    mask = (abs(u - 300) < 100) & (abs(v - 200) < 50) if shape == "rectangle" else disk
    sensor = replace(
        bundled_sensor("bench"),
        noise=Noise(9000.0, 4.5, 10),
        distortion=(-0.1, 0.02, 1e-4, -2e-4, 0.003),
        gamma=2.2,
        bit_depth=12,
        light_intensities=np.array([0.9, 1.0, 1.1]),
        region_of_interest=mask,
    )
    save_sensor(sensor, tmp_path / "sensor.json")
    assert_same(load_sensor(tmp_path / "sensor.json"), sensor)
    stored = json.loads((tmp_path / "sensor.json").read_text())["region_of_interest"]
    assert stored == ([201, 151, 199, 99] if shape == "rectangle" else "sensor.mask.png")


NEAR = {"positions_mm": [[0, -300, 500], [-300, 200, 520], [300, 200, 480.5]], "intensities": [1.0, 0.9, 1.1]}


def test_near_lights_have_positions_and_the_directions_on_the_axis(tmp_path):
    data = {**BENCH, "lights": NEAR, "working_distance_mm": 900}
    sensor = sensor_from_json(data, "x")
    np.testing.assert_array_equal(sensor.light_positions, NEAR["positions_mm"])
    np.testing.assert_array_equal(sensor.light_intensities, NEAR["intensities"])
    np.testing.assert_allclose(sensor.light_directions[0], [0.0, -0.6, -0.8], atol=1e-15)
    save_sensor(sensor, tmp_path / "near.json")
    again = load_sensor(tmp_path / "near.json")
    np.testing.assert_array_equal(again.light_positions, sensor.light_positions)
    assert_same(again, sensor)
    assert fingerprint(again) == fingerprint(replace(sensor, light_positions=None))


def test_distant_lights_have_no_positions():
    assert sensor_from_json(BENCH, "x").light_positions is None
    assert "positions_mm" not in BENCH["lights"]


def test_a_sensor_whose_lights_are_not_known_yet(tmp_path):
    path = tmp_path / "camera.json"
    path.write_text(json.dumps({key: value for key, value in BENCH.items() if key != "lights"}))
    assert load_unlit_sensor(path).camera == bundled_sensor("bench").camera
    assert load_unlit_sensor("bundled:bench").camera == bundled_sensor("bench").camera
    with pytest.raises(ItreeError, match="'lights' is missing"):
        load_sensor(path)


def test_exposure_is_folded_into_the_intensities():
    data = copy.deepcopy(BENCH)
    data["lights"] |= {"intensities": [1.0, 2.0, 3.0], "exposure": [1.0, 0.5, 2.0]}
    np.testing.assert_array_equal(sensor_from_json(data, "x").light_intensities, [1.0, 1.0, 6.0])
    data["lights"]["exposure"] = 2.0
    np.testing.assert_array_equal(sensor_from_json(data, "x").light_intensities, [2.0, 4.0, 6.0])


def test_focal_lengths_may_stand_for_the_matrix_and_what_is_left_out_has_defaults():
    camera = {"kind": "pinhole", "fx": 900, "fy": 901, "cx": 10, "cy": 20, "size": [30, 40]}
    data = {"camera": camera, "lights": {"directions": BENCH["lights"]["directions"]}, "working_distance_mm": 500}
    sensor = sensor_from_json(data, "x")
    assert sensor.camera == Camera("pinhole", 900.0, 901.0, 10.0, 20.0, 30, 40)
    assert (sensor.noise, sensor.gamma, sensor.bit_depth, sensor.distortion) == (Noise(), 1.0, None, ())
    np.testing.assert_array_equal(sensor.light_intensities, 1.0)


def test_a_nearly_unit_light_is_normalised():
    data = copy.deepcopy(BENCH)
    data["lights"]["directions"][0] = [0.0, -0.5736, -0.8192]
    L = sensor_from_json(data, "x").light_directions
    np.testing.assert_allclose(np.linalg.norm(L, axis=1), 1.0, atol=1e-15)


UP, LEFT, RIGHT = BENCH["lights"]["directions"]
WRONG = {
    "missing camera": (("camera",), None, "'camera' is missing"),
    "missing size": (("camera", "size"), None, "'camera.size' is missing"),
    "missing distance": (("working_distance_mm",), None, "'working_distance_mm' is missing"),
    "unknown key": (("working_distnace_mm",), 3.0, "'working_distnace_mm' is not known"),
    "kind": (("camera", "kind"), "fisheye", "'camera.kind' must be one of orthographic, pinhole"),
    "matrix shape": (("camera", "matrix"), [[1, 0, 0], [0, 1, 0]], "'camera.matrix' must have 3 items, it has 2"),
    "matrix row": (("camera", "matrix"), [[1, 0], [0, 1], [0, 0]], r"'camera.matrix\[0\]' must have 3 items"),
    "skew": (("camera", "matrix"), [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]], "'camera.matrix' must be"),
    "negative focal": (("camera", "matrix"), [[-1, 0, 0], [0, 1, 0], [0, 0, 1]], "positive focal"),
    "size": (("camera", "size"), [640, 0], r"'camera.size\[1\]' must be at least 1"),
    "size type": (("camera", "size"), [640, 1.5], r"'camera.size\[1\]' must be of type integer"),
    "distortion": (("camera", "distortion"), [0.1], "'camera.distortion' must have"),
    "two lights": (("lights", "directions"), [UP, LEFT], "'lights.directions' must have at least 3 items, it has 2"),
    "not unit": (("lights", "directions"), [UP, LEFT, [0, 0, -2]], "direction 2 must be a unit vector, its norm is 2"),
    "behind": (("lights", "directions"), [UP, LEFT, [0, 0, 1]], "light 2 is behind"),
    "duplicate": (("lights", "directions"), [UP, LEFT, LEFT], "condition number"),
    "coplanar": (("lights", "directions"), [UP, [0, 0, -1], [0, 0.5736, -0.8192]], "condition number"),
    "both kinds": (("lights", "positions_mm"), [[0, 0, 1], [1, 0, 1], [0, 1, 1]], "both are there"),
    "no lights": (("lights",), {"intensities": [1.0, 1.0, 1.0]}, "neither is there"),
    "near behind": (("lights",), {"positions_mm": [[0, 9, 1], [9, 0, 1], [0, 0, 1e4]]}, "light 2 is behind"),
    "near two": (("lights",), {"positions_mm": [[0, 9, 1], [9, 0, 1]]}, "'lights.positions_mm' must have at least 3"),
    "near at the parts": (("lights",), {"positions_mm": [[0, 9, 1], [9, 0, 1], [0, 0, 900]]}, "must be a point"),
    "intensity count": (("lights", "intensities"), [1.0, 1.0], "3 light directions but intensities"),
    "dark light": (("lights", "intensities"), [1.0, 0.0, 1.0], r"'lights.intensities\[1\]' must be more than 0"),
    "exposure count": (("lights", "exposure"), [1.0, 1.0], "'lights.exposure' has 2 values for 3 lights"),
    "bool": (("bit_depth",), True, "'bit_depth' must be of type integer"),
    "bits": (("bit_depth",), 17, "'bit_depth' must be at most 16"),
    "response": (("response",), "srgb", "'response' must be one of linear"),
    "gamma": (("response",), {"gamma": -1}, "'response.gamma' must be more than 0"),
    "response type": (("response",), 2.2, "'response' must be of type string or object"),
    "slant": (("slant_limit_deg",), 90, "'slant_limit_deg' must be less than 90"),
    "nan": (("smallest_region_mm2",), float("nan"), "finite"),
    "roi outside": (("region_of_interest",), [700, 0, 10, 10], "has no pixel"),
    "roi file": (("region_of_interest",), "nowhere.png", "nowhere.png"),
    "not an object": ((), 3, "the file must be of type object"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_input_is_told_with_file_and_key(case, tmp_path):
    keys, value, message = WRONG[case]
    data = copy.deepcopy(BENCH)
    inner = data
    for key in keys[:-1]:
        inner = inner[key]
    if not keys:
        data = value
    elif value is None:
        del inner[keys[-1]]
    else:
        inner[keys[-1]] = value
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(data))
    with pytest.raises(ItreeError, match=message) as error:
        load_sensor(path)
    assert str(tmp_path) in str(error.value)


def test_sources_that_are_not_there():
    with pytest.raises(ItreeError, match=r"bundled:ikeuchi-1987"):
        load_sensor("nowhere.json")
    with pytest.raises(ItreeError, match="ikeuchi-1987, bench"):
        load_sensor("bundled:nobody")


def test_text_that_is_no_json(tmp_path):
    (tmp_path / "s.json").write_text("{")
    with pytest.raises(ItreeError, match=r"s\.json: cannot be read as JSON"):
        load_sensor(tmp_path / "s.json")


def test_a_mask_of_another_size_is_refused(tmp_path):
    cv2.imwrite(str(tmp_path / "m.png"), np.ones((4, 5), np.uint8))
    (tmp_path / "s.json").write_text(json.dumps({**BENCH, "region_of_interest": "m.png"}))
    with pytest.raises(ItreeError, match=r"s\.json: the mask 'm\.png' has shape \(4, 5\)"):
        load_sensor(tmp_path / "s.json")


def test_fingerprint_is_of_what_decides_detectability():
    sensor = bundled_sensor("bench")
    same = [
        replace(sensor, light_intensities=np.array([2.0, 1.0, 1.0])),
        replace(sensor, noise=Noise(100.0)),
        replace(sensor, working_distance=800.0),
        replace(sensor, light_directions=sensor.light_directions + 1e-9),
    ]
    assert {fingerprint(s) for s in same} == {fingerprint(sensor)}
    others = [
        replace(sensor, light_directions=sensor.light_directions[[1, 0, 2]]),
        replace(sensor, slant_limit=0.7),
        replace(sensor, smallest_region=61.0),
        bundled_sensor("ikeuchi-1987"),
    ]
    assert len({fingerprint(s) for s in [sensor, *others]}) == 5


def test_the_schema_uses_only_words_that_are_checked():
    known = {"type", "enum", "anyOf", "required", "properties", "additionalProperties", "items", "minItems", "maxItems"}
    known |= {"minLength", "minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum", "description", "title"}

    def words(schema):
        yield from schema
        inside = [*schema.get("properties", {}).values(), *schema.get("anyOf", [])]
        for inner in inside + ([schema["items"]] if "items" in schema else []):
            yield from words(inner)

    assert set(words(SENSOR_SCHEMA)) <= known | {"$schema"}
