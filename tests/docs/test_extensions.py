"""What the pages are made with: tables of schemas, comments of fields, and pages that fetch nothing."""

import importlib.util
import json
import sys
from pathlib import Path

import pytest

from itree_jax.sensing.json_check import check_json
from itree_jax.sensing.sensor_file import SENSOR_SCHEMA
from itree_jax.world.bin_walls import BIN_SCHEMA

ROOT = Path(__file__).parents[2]
SCENE_SCHEMA = json.loads((ROOT / "itree_jax" / "sensing" / "scene.schema.json").read_text())


def extension(name: str):
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / "extensions" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def without_words(schema):
    """A schema without its descriptions."""
    if isinstance(schema, dict):
        return {key: without_words(value) for key, value in schema.items() if key != "description"}
    return [without_words(value) for value in schema] if isinstance(schema, list) else schema


def test_a_table_has_a_row_for_every_key_at_every_depth():
    pytest.importorskip("sphinx", reason="the extra docs is not installed")
    rows = list(extension("json_schema").rows(SENSOR_SCHEMA))
    keys = [key.strip("`") for key, *_ in rows]
    assert len(set(keys)) == len(keys)
    assert {"camera.kind", "lights.directions", "noise.bits", "response.gamma", "depth_camera.noise_mm"} <= set(keys)
    (kind,) = [row for row in rows if row[0] == "`camera.kind`"]
    assert kind[1:3] == ("required", '`"orthographic"` or `"pinhole"`')
    inside = [key for key, *_ in extension("json_schema").rows(SCENE_SCHEMA)]
    assert "`scene_gt.json{}[].obj_id`" in inside


def test_comments_of_fields_are_found_behind_and_above():
    words = extension("field_comments").field_comments('''class A:
    """Words: not a field"""

    x: float  # [mm]
    # [rad], of two
    # lines
    y: float = 1.0
    z: int

    def f(self):
        w: int = 0  # of no field
''')
    assert words == {"x": "[mm]", "y": "[rad], of two lines", "z": ""}


def test_a_fetch_from_elsewhere_is_found_and_a_link_is_none(tmp_path):
    remote_fetches = extension("check_offline").remote_fetches
    (tmp_path / "a.html").write_text('<a href="https://a.example">b</a><img src="c.png"><script src="d.js"></script>')
    (tmp_path / "a.css").write_text("b { background: url(c.png) }")
    assert remote_fetches(tmp_path) == []
    (tmp_path / "b.html").write_text('<script src="//cdn.example/x.js"></script>')
    (tmp_path / "b.css").write_text("@font-face { src: url('https://fonts.example/x.woff') }")
    assert remote_fetches(tmp_path) == ["b.html: //cdn.example/x.js", "b.css: https://fonts.example/x.woff"]


def test_the_scene_schema_fits_what_is_written(tmp_path):
    """Of a bin with lights, a camera's pose and true poses."""
    from itree_jax.sensing.bundled import bundled_sensor
    from itree_jax.sensing.scene_writer import write_scene
    from itree_jax.simulate import demo_bin

    scene, truth = demo_bin(bundled_sensor("bench"), seed=0)
    write_scene(tmp_path / "000001", scene, truth)
    written = sorted(path.name for path in (tmp_path / "000001").glob("*.json"))
    assert written == ["scene_camera.json", "scene_gt.json", "scene_gt_info.json", "scene_lights.json"]
    for name in written:
        schema = SCENE_SCHEMA["properties"][name]["additionalProperties"]
        for entry in json.loads((tmp_path / "000001" / name).read_text()).values():
            check_json(entry, schema, name)
            for one in entry if isinstance(entry, list) else [entry]:
                told = schema["items"] if isinstance(entry, list) else schema
                assert set(one) <= set(told["properties"]), f"{name} has keys that its schema lacks"


def test_the_bin_of_the_scene_schema_is_what_is_checked():
    assert without_words(SCENE_SCHEMA["properties"]["scene_bin.json"]["additionalProperties"]) == BIN_SCHEMA


def test_files_that_the_paper_page_names_exist():
    import re

    page = (ROOT / "docs" / "paper.md").read_text()
    names = re.findall(r"`((?:[a-z_]+/)*[a-z0-9_]+(?:\.py|/))`", page)
    assert len(names) > 40
    for name in names:
        assert (ROOT / "itree_jax" / name).exists() or (ROOT / name).exists(), name
