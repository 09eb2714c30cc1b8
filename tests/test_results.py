"""Results on disk: what is written is read back, and follows the published schema."""

import json
from typing import Any

import numpy as np
import pytest
from itree_kernels.errors import ItreeError
from scipy.spatial.transform import Rotation

from itree_jax.detections import Alternative, Detection, Detections, Step, Unobservable, place_of
from itree_jax.results import CSV_COLUMNS, RESULTS_VERSION, SCHEMA_PATH, read_bop_csv, write_bop_csv, write_json

SCHEMA = json.loads(SCHEMA_PATH.read_text())
HEAD = ",".join(CSV_COLUMNS)
IDENTITY = "1 0 0 0 1 0 0 0 1"


def images() -> list[Detections]:
    """Two scenes, not in order; the first has two answers whose order for picking is not that of their scores."""
    R = Rotation.random(3, random_state=0).as_matrix()
    t = np.random.default_rng(0).normal(size=(3, 3)) * 100
    path = (
        Step(0, "L1", {"area": np.float32(812.5)}, [{"branch": "B0", "mean": 800.0}], np.inf, "any view", "S1 or S3"),
        Step(4, "A2", np.array([1.0, 2.0]), None, None),
    )
    open_ = Unobservable(np.array([0.0, 0.0, 1.0, 20.0, 0.0, 0.0]), "turn about its own z axis", np.inf)
    first = Detection(
        12, 0, 1, 0.25, R[0], t[0], path, 900, 12, 40, 0, 33.0, np.radians([1.0, 2, 3]), t[1] ** 2, (np.eye(4),),
        np.diag([1.0, 1.0, 1.0, 4.0, 4.0, 9.0]) * 1e-4, (open_,), (Alternative(2.0 * np.eye(4), 0.4),),
    )  # fmt: skip
    second = Detection(12, 0, 2, 0.75, R[1], t[1], offer_rank=1)
    third = Detection(3, 0, 1, 1 / 3, R[2], t[2])
    place = place_of(np.array([[False] * 6, [False, True, True, True, True, False]]))
    lost = ({"region": 5, "reason": "no attitude agrees", "height_mm": np.nan, **place},)
    return [Detections((first, second), 0.1, 12, 0, np.zeros((2, 2), int), lost), Detections((third,), scene_id=3),
            Detections(scene_id=4)]  # fmt: skip


def test_the_csv_is_ordered_by_scene_then_falling_score_and_exact(tmp_path):
    write_bop_csv(images(), tmp_path / "r.csv")
    assert (tmp_path / "r.csv").read_text().splitlines()[0] == HEAD
    rows = read_bop_csv(tmp_path / "r.csv")
    a, b, c = images()[1][0], images()[0][1], images()[0][0]
    assert [(s, o) for s, o in zip(rows.scene_id, rows.obj_id, strict=True)] == [(3, 1), (12, 2), (12, 1)]
    np.testing.assert_array_equal(rows.R, [d.R_cam_obj for d in (a, b, c)])
    np.testing.assert_array_equal(rows.t, [d.t_cam_obj for d in (a, b, c)])
    np.testing.assert_array_equal(rows.score, [1 / 3, 0.75, 0.25])
    np.testing.assert_array_equal(rows.time, [-1, 0.1, 0.1])


def test_the_same_answers_give_the_same_bytes(tmp_path):
    for name in ("a", "b"):
        write_bop_csv(images(), tmp_path / f"{name}.csv")
        write_json(images(), tmp_path / f"{name}.json")
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "a.csv",
        "a.json",
        "b.csv",
        "b.json",
    ]  # nothing temporary left


def test_no_answers_are_a_header(tmp_path):
    write_bop_csv([Detections()], tmp_path / "r.csv")
    assert (tmp_path / "r.csv").read_text() == HEAD + "\n"
    rows = read_bop_csv(tmp_path / "r.csv")
    assert (len(rows), rows.R.shape, rows.t.shape) == (0, (0, 3, 3), (0, 3))


def test_poses_as_arrays():
    poses = images()[0].poses
    assert (poses.R.shape, poses.t.shape, poses.score.tolist()) == ((2, 3, 3), (2, 3), [0.25, 0.75])
    assert Detections().poses.R.shape == (0, 3, 3)
    np.testing.assert_array_equal(images()[0][0].T_cam_obj @ [0, 0, 0, 1], [*images()[0][0].t_cam_obj, 1])


def test_by_score_and_by_offer_are_two_orders():
    image = images()[0]
    assert [d.obj_id for d in image.by_score] == [2, 1]
    assert [d.obj_id for d in image.by_offer] == [1, 2]


def test_the_json_follows_its_schema_and_keeps_everything(tmp_path):
    write_json(images(), tmp_path / "r.json")
    document = json.loads((tmp_path / "r.json").read_text())
    assert violations(document, SCHEMA) == []
    assert document["version"] == RESULTS_VERSION == SCHEMA["properties"]["version"]["const"]
    assert [image["scene_id"] for image in document["images"]] == [3, 4, 12]
    image = document["images"][2]
    assert image["not_recognised"] == [
        {"region": 5, "reason": "no attitude agrees", "height_mm": None, "uv": [2.5, 1.0], "pixels": 4}
    ]
    second = image["detections"][1]
    assert (second["offer_rank"], second["score"], second["height_mm"]) == (0, 0.25, 33.0)
    assert second["rotation_std_deg"] == pytest.approx([1, 2, 3])
    T = np.reshape(second["T"], (4, 4))
    np.testing.assert_array_equal(T[:3, :3].ravel(), second["R"])
    np.testing.assert_array_equal(T[:, 3], [*second["t"], 1.0])
    assert second["pixels"] == {"agreeing": 900, "contradicting": 12, "hidden": 40}
    assert second["equivalents"] == [np.eye(4).ravel().tolist()]
    covariance = np.reshape(second["covariance_deg_mm"], (6, 6))
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), [*np.degrees([0.01] * 3), 0.02, 0.02, 0.03])
    assert second["ambiguous"] is True
    assert second["alternatives"] == [{"T": (2.0 * np.eye(4)).ravel().tolist(), "share": 0.4}]
    (told,) = second["unobservable"]
    assert (told["words"], told["deviation_mm"]) == ("turn about its own z axis", None)
    np.testing.assert_allclose(told["twist_deg_mm"], [0.0, 0.0, 1.0, np.radians(20.0), 0.0, 0.0])
    first = image["detections"][0]
    assert (first["covariance_deg_mm"], first["unobservable"], first["ambiguous"]) == (None, [], False)
    assert second["decision_path"][0] == {
        "node": 0, "rule": "L1", "measured": {"area": 812.5}, "compared_with": [{"branch": "B0", "mean": 800.0}],
        "margin": None, "freedom_before": "any view", "freedom_after": "S1 or S3",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("key", "value"), [("score", "high"), ("R", [1.0] * 8), ("offer_rank", -1), ("extra", 1), ("decision_path", [{}])]
)
def test_the_schema_refuses_what_is_not_a_detection(tmp_path, key, value):
    write_json(images(), tmp_path / "r.json")
    document = json.loads((tmp_path / "r.json").read_text())
    document["images"][0]["detections"][0][key] = value
    assert violations(document, SCHEMA) != []


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"r\.csv: the first line lacks the column\(s\) scene_id, im_id"),
        ("scene_id,im_id,obj_id,score,R,t\n", r"lacks the column\(s\) time"),
        (f"{HEAD}\n1,0,1,0.5,{IDENTITY},0 0 900\n", "row 2: 6 cells where the first line has 7"),
        (
            f"{HEAD}\n1,0,1,0.5,{IDENTITY},0 0 900,1\n1,0,x,0.5,{IDENTITY},0 0 900,1\n",
            "row 3, column obj_id: 'x' is not",
        ),
        (f"{HEAD}\n1,0,1,0.5,1 0 0 0 1 0 0 0,0 0 900,1\n", "row 2, column R: 9 finite"),
        (f"{HEAD}\n1,0,1,0.5,2 0 0 0 2 0 0 0 2,0 0 900,1\n", "row 2, column R: not a rotation"),
        (f"{HEAD}\n1,0,1,0.5,-1 0 0 0 1 0 0 0 1,0 0 900,1\n", "row 2, column R: not a rotation"),
        (f"{HEAD}\n1,0,1,0.5,{IDENTITY},0 0 nan,1\n", "row 2, column t: 3 finite"),
        (f"{HEAD}\n1,0,1,,{IDENTITY},0 0 900,1\n", "row 2, column score: 1 finite"),
    ],
)
def test_a_malformed_csv_is_refused_with_row_and_column(tmp_path, text, message):
    (tmp_path / "r.csv").write_text(text)
    with pytest.raises(ItreeError, match=message):
        read_bop_csv(tmp_path / "r.csv")


def test_missing_files_and_folders_are_clear_errors(tmp_path):
    with pytest.raises(ItreeError, match="cannot be read"):
        read_bop_csv(tmp_path / "none.csv")
    with pytest.raises(ItreeError, match="cannot be written"):
        write_bop_csv([], tmp_path / "none" / "r.csv")


def test_a_failed_write_leaves_the_old_file(tmp_path):
    (tmp_path / "r.csv").mkdir()  # cannot be replaced by a file
    with pytest.raises(ItreeError, match="cannot be written"):
        write_bop_csv(images(), tmp_path / "r.csv")
    assert [p.name for p in tmp_path.iterdir()] == ["r.csv"]


TYPES = {"object": dict, "array": list, "string": str, "integer": int, "number": (int, float), "null": type(None),
         "boolean": bool}  # fmt: skip


def violations(value: Any, schema: dict[str, Any], where: str = "$") -> list[str]:
    """Where `value` breaks the words of JSON Schema that the published file uses."""
    known = {"$schema", "title", "description", "anyOf", "type", "const", "minimum", "required", "properties",
             "additionalProperties", "items", "minItems", "maxItems"}  # fmt: skip
    assert set(schema) <= known
    if "anyOf" in schema and all(violations(value, s, where) for s in schema["anyOf"]):
        return [f"{where}: no alternative fits"]
    types = schema.get("type", [])
    types = [types] if isinstance(types, str) else types
    fits = [isinstance(value, TYPES[name]) and isinstance(value, bool) == (name == "boolean") for name in types]
    if types and not any(fits):
        return [f"{where}: not {types}"]
    wrong = ["const"] if "const" in schema and value != schema["const"] else []
    if "minimum" in schema and value < schema["minimum"]:
        wrong.append("minimum")
    if isinstance(value, dict):
        properties = schema.get("properties", {})
        wrong += [f"lacks {name}" for name in schema.get("required", ()) if name not in value]
        if schema.get("additionalProperties", True) is False:
            wrong += [f"unknown {name}" for name in value if name not in properties]
        wrong += [w for name in value for w in violations(value[name], properties.get(name, {}), f"{where}.{name}")]
    if isinstance(value, list):
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)):
            wrong.append(f"{len(value)} items")
        wrong += [w for i, v in enumerate(value) for w in violations(v, schema.get("items", {}), f"{where}[{i}]")]
    return [f"{where}: {w}" for w in wrong]
