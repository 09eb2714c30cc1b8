"""Whatever is put through a public door, what comes out is an answer or an `ItreeError` that says what is wrong.

ITREE_EXAMPLES sets the number of examples of each law (`experiments/fuzz_doors.py` takes many).
"""

import json
import os
import random
import struct
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from itree_cad.part_file import read_part_file
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError, ItreeWarning
from itree_kernels.json_file import as_numbers, parse_json
from itree_kernels.npy_file import parse_npy

from itree_jax.evaluation.symmetry import symmetry_set
from itree_jax.grasp.gripper import gripper_from_toml
from itree_jax.input_check import check_numbers
from itree_jax.results import read_bop_csv
from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.camera_check import check_camera
from itree_jax.sensing.capture import read_pose
from itree_jax.sensing.image_file import read_intensity
from itree_jax.sensing.json_check import check_json
from itree_jax.sensing.lights import checked_lights, lights_of_entry
from itree_jax.sensing.sensor_file import sensor_from_json, sensor_to_json
from itree_jax.world.bin_walls import BIN_SCHEMA

EXAMPLES = int(os.environ.get("ITREE_EXAMPLES", "40"))
SENSOR = sensor_to_json(bundled_sensor("bench"))
common = settings(
    max_examples=EXAMPLES, deadline=None, derandomize="ITREE_EXAMPLES" not in os.environ, database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much],
)  # fmt: skip
KEYS = ["R", "t", "0", "axis", "offset", "directions"]
number = st.one_of(st.integers(), st.floats(), st.just(10**400), st.booleans())
json_value = st.recursive(
    st.one_of(st.none(), number, st.text(max_size=8)),
    lambda inner: st.one_of(st.lists(inner, max_size=9), st.dictionaries(st.sampled_from(KEYS), inner)),
    max_leaves=12,
)
any_array = arrays.arrays(
    st.sampled_from([np.float32, np.float64, np.int64, np.uint8, np.uint16, np.bool_, np.complex64]),
    arrays.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=4),
)


def answered(door, *given: Any) -> Any:
    """The answer, or None where the door refuses; any other exception fails the test."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ItreeWarning)
        try:
            return door(*given)
        except ItreeError:
            return None


def through_file(read, content: bytes, name: str = "a.json") -> Any:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(content)
        return answered(read, path)


@st.composite
def changed(draw, data=SENSOR):
    """A sensor's JSON with one of its values exchanged, added or left out."""
    value = json.loads(json.dumps(data))
    place, key = value, draw(st.sampled_from(list(value)))
    while isinstance(place[key], dict | list) and place[key] and draw(st.booleans()):
        place = place[key]
        key = draw(st.sampled_from(list(place) if isinstance(place, dict) else range(len(place))))
    if draw(st.integers(0, 5)) == 0:
        del place[key]
    else:
        place[key] = draw(json_value)
    return value


@common
@given(changed())
def test_sensors(data):
    sensor = answered(sensor_from_json, data, "x")
    if sensor is not None:
        assert np.isfinite(sensor.light_directions).all()
        assert np.isfinite([sensor.slant_limit, sensor.mm_per_px, *sensor.light_intensities]).all()
        answered(sensor_from_json, sensor_to_json(sensor), "again")


@common
@given(st.dictionaries(st.sampled_from(["directions", "positions_mm", "intensities"]), json_value), st.floats(1, 1e5))
def test_lights_of_entries(entry, distance):
    answered(lights_of_entry, entry, distance, "x")


@common
@given(any_array, st.one_of(st.none(), any_array))
@example(np.full((3, 3), 1e154), None)
def test_lights_of_arrays(directions, intensities):
    found = answered(checked_lights, directions, intensities, "x")
    if found is not None:
        np.testing.assert_allclose(np.linalg.norm(found[0], axis=1), 1.0, atol=1e-9)


@common
@given(json_value)
def test_numbers(value):
    found = answered(as_numbers, value, "x")
    assert found is None or found.dtype == np.float64


@common
@given(any_array, st.one_of(st.none(), any_array), st.one_of(st.none(), any_array))
@example(np.zeros((3, 2, 2), np.float32), None, np.full((3, 3), 1e30, np.float32))
def test_arrays_of_a_scene(images, depth, R_w2c):
    answered(check_numbers, images, depth, R_w2c)


@common
@given(*[st.floats(1e-300, 1e300)] * 2, *[st.floats(-1e300, 1e300)] * 2, *[st.integers(1, 65535)] * 2,
       st.sampled_from(["pinhole", "orthographic"]))  # fmt: skip
def test_cameras(fx, fy, cx, cy, width, height, kind):
    answered(check_camera, Camera(kind, fx, fy, cx, cy, width, height), "x")


@common
@given(any_array)
def test_images_of_arrays(array):
    with tempfile.TemporaryDirectory() as folder:
        np.save(Path(folder) / "a.npy", array)
        image = answered(read_intensity, Path(folder) / "a.npy")
    assert image is None or (image.ndim == 2 and np.isfinite(image).all())


@common
@given(st.binary(max_size=200), st.sampled_from(["a.png", "a.npy", "a.tiff"]))
def test_images_of_bytes(content, name):
    through_file(read_intensity, content, name)


@common
@given(st.one_of(st.binary(max_size=60), st.binary(max_size=60).map(lambda data: b"\x93NUMPY\x01\x00" + data)))
def test_arrays_of_bytes(content):
    answered(parse_npy, content, "x")


@common
@given(st.one_of(st.binary(), st.text().map(str.encode), json_value.map(lambda v: json.dumps(v).encode())))
def test_texts(content):
    answered(parse_json, content, "x")
    for read in (read_pose, read_part_file):
        through_file(read, content)


@common
@given(st.dictionaries(st.sampled_from(["R", "t"]), json_value))
def test_poses(data):
    through_file(read_pose, json.dumps(data).encode())


@common
@given(st.dictionaries(st.sampled_from(["model", "units", "solid", "identifying_faces", "obj_id", "name"]), json_value))
def test_part_files(data):
    through_file(read_part_file, json.dumps(data).encode())


@common
@given(st.dictionaries(st.sampled_from(["symmetries_discrete", "symmetries_continuous"]), json_value))
@example({"symmetries_continuous": [{"axis": [0.0, 0.0, 1e200], "offset": [0.0, 0.0, 0.0]}]})
@example({"symmetries_continuous": [{"axis": [1.0, 1.0, 1.0], "offset": [1.7e308, 1.7e308, 0.0]}]})
@example({"symmetries_discrete": [[1e300] * 16, [1e300] * 16]})
def test_symmetries(info):
    answered(symmetry_set, info)


@common
@given(st.dictionaries(st.sampled_from(sorted(BIN_SCHEMA["properties"])), json_value))
def test_bins(entry):
    answered(check_json, entry, BIN_SCHEMA, "x")


@common
@given(st.one_of(st.text(), st.lists(st.text("0123456789.,-e \n\"x", max_size=30)).map("\n".join)))
def test_results(rows):
    for head in ("", "scene_id,im_id,obj_id,score,R,t,time\n"):
        through_file(read_bop_csv, (head + rows).encode("utf-8", "surrogatepass"), "r.csv")


@common
@given(st.text())
def test_grippers(text):
    answered(gripper_from_toml, text, "x")


def test_readers_survive_some_hundred_files_that_nobody_would_write():
    """What the coverage-guided fuzzer does with more time; see experiments/fuzz."""
    from fuzz.targets import TARGETS, without_guidance

    for name in TARGETS:
        assert without_guidance(name, max(EXAMPLES, 25)) == {}, name


@pytest.mark.parametrize("name", ["tree file", "scene folder", "lights and sensors", "lights as text"])
def test_a_crash_would_be_seen(name, monkeypatch):
    from dataclasses import replace

    from fuzz import targets

    def broken(data, folder):
        if data != seed:
            raise KeyError("what no reader should raise")

    target = targets.TARGETS[name]
    (seed, *_) = target.seeds()
    monkeypatch.setitem(targets.TARGETS, name, replace(target, read=broken, seeds=lambda: [seed]))
    assert [place.split()[0] for place in targets.without_guidance(name, 30)] == ["KeyError"]


def test_the_fuzzer_goes_on_from_a_tree_file_that_ends_too_early():
    """Its list of members promises more bytes than the file has: zipfile raises EOFError."""
    from fuzz.mutations import mutated_tree
    from fuzz.seeds import tree_file

    data = bytearray(tree_file())
    last = data.rindex(b"PK\x01\x02")  # the entry of the last member; its two sizes are at 20 and 24
    data[last + 20 : last + 28] = struct.pack("<2I", 10**6, 10**6)
    assert mutated_tree(bytes(data), random.Random(0), lambda data, seed: b"by bytes") == b"by bytes"
