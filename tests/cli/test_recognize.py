"""`itree recognize` and `itree evaluate`: poses of a bin, or a message and nothing written."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from itree_kernels.errors import ItreeError

from itree_jax.cli.scene_answer import fitting_trees
from itree_jax.detections import Detection, Detections
from itree_jax.results import read_bop_csv
from itree_jax.tree.tree_file import save_tree

RUN = "import sys; from itree_jax.cli.main import main; sys.exit(main())"


def numbered(tree, obj_id=1, **changes):
    """A tree of another object or sensor, prepared as far as choosing among trees needs it."""
    return SimpleNamespace(tree=replace(tree, obj_id=obj_id, sensor=replace(tree.sensor, **changes)))


@pytest.fixture
def scenes(bin_dataset, tmp_path):
    """Two copies of the scene, to be broken."""
    for name in ("000001", "000002"):
        shutil.copytree(bin_dataset / "test" / "000042", tmp_path / "scenes" / name)
    return tmp_path / "scenes"


@pytest.fixture
def answers(monkeypatch):
    """Recognition that answers at once: one part, at the centre of the image."""
    seen = []

    def recognize_one(prepared, images, sensor, depth, R_w2c, second=None, picks=None):
        seen.append((prepared, images.shape, sensor))
        one = Detection(0, 0, prepared[0].tree.obj_id, 0.5, np.eye(3), np.array([0.0, 0.0, 900.0]))
        return Detections((one,), time=2.0, labels=np.zeros((480, 640), np.int32))

    monkeypatch.setattr(import_module("itree_jax.recognition"), "recognize_one", recognize_one)
    return seen


def test_picks_are_handed_on(itree, scenes, paper_tree_file, tmp_path, monkeypatch):
    """All regions are read where none are asked for."""
    asked = []

    def recognize_one(prepared, images, sensor, depth, R_w2c, second=None, picks=None):
        asked.append(picks)
        return Detections((), time=1.0, labels=np.zeros((480, 640), np.int32))

    monkeypatch.setattr(import_module("itree_jax.recognition"), "recognize_one", recognize_one)
    for words in (["--picks", "2"], []):
        assert itree("recognize", scenes, paper_tree_file, "-o", tmp_path / "r.csv", *words).code == 0
    assert asked == [2, 2, None, None]


@pytest.fixture(scope="module")
def recognised(bin_dataset, paper_tree_file, tmp_path_factory):
    """The whole verb in a process of its own, with a page per scene."""
    out = tmp_path_factory.mktemp("out")
    words = ["recognize", bin_dataset, paper_tree_file, "-o", out / "r.csv"]
    words += ["--json", out / "r.json", "--report", out / "pages", "--world", out / "world"]
    done = subprocess.run(
        [sys.executable, "-c", RUN, *map(str, words)], capture_output=True, text=True, timeout=240, check=False,
        env={**os.environ, "PYTHONWARNINGS": "error"},
    )  # fmt: skip
    return done, out


def test_a_bin_is_recognised_by_a_process_that_ends_without_noise(recognised, itree, bin_dataset):
    done, out = recognised
    assert (done.returncode, done.stderr) == (0, "")
    assert "000042" in done.stdout
    rows = read_bop_csv(out / "r.csv")
    assert set(rows.scene_id) == {42}
    assert set(rows.im_id) == {0}
    assert (rows.time > 0).all()
    ran = itree("evaluate", bin_dataset, out / "r.csv", "--json")
    assert ran.code == 0
    rates = json.loads(ran.out)["groups"]["all"]
    assert rates["top_pick"]["percent"] == 100.0
    assert rates["precision_5"]["percent"] > 80.0  # one of seven may be turned by a near symmetry
    assert rates["recall_5"]["percent"] >= 50.0
    table = itree("evaluate", bin_dataset, out / "r.csv")
    assert (table.code, table.err) == (0, "")
    assert "top pick %" in table.out


def test_the_json_file_has_the_same_answers_with_their_reasons(recognised):
    _, out = recognised
    rows = read_bop_csv(out / "r.csv")
    (image,) = json.loads((out / "r.json").read_text())["images"]
    assert image["scene_id"] == 42
    assert np.array_equal([d["t"] for d in image["detections"]], rows.t)
    assert all(d["decision_path"] for d in image["detections"])


def test_the_report_has_a_page_per_scene_and_an_index(recognised):
    _, out = recognised
    assert sorted(p.name for p in (out / "pages").iterdir()) == ["index.html", "scene_000042.html"]
    assert "scene_000042.html" in (out / "pages" / "index.html").read_text(encoding="utf-8")


def test_the_world_model_is_written_with_the_poses_of_the_csv_file(recognised):
    _, out = recognised
    assert sorted(p.name for p in (out / "world").iterdir()) == ["scene_000042.glb", "scene_000042.ply"]
    read = trimesh.load_scene(out / "world" / "scene_000042.glb")
    parts = [name for name in read.graph.nodes_geometry if name.startswith("pose")]
    t = np.stack([read.graph.get(name, "camera")[0][:3, 3] for name in parts])
    expected = read_bop_csv(out / "r.csv").t
    assert len(t) == len(expected)
    distance = np.linalg.norm(t[:, None] - expected[None], axis=-1)
    assert distance.min(axis=0).max() < 1e-3


def test_every_scene_is_answered_under_its_number(itree, scenes, paper_tree_file, answers, tmp_path):
    ran = itree("recognize", scenes, paper_tree_file, "-o", tmp_path / "r.csv")
    assert (ran.code, ran.err) == (0, "")
    assert read_bop_csv(tmp_path / "r.csv").scene_id.tolist() == [1, 2]
    assert [shape for _, shape, _ in answers] == [(3, 480, 640)] * 2
    assert itree("recognize", scenes / "000002", paper_tree_file, "-o", tmp_path / "r.csv", "--quiet") == (0, "", "")
    assert read_bop_csv(tmp_path / "r.csv").scene_id.tolist() == [2]


@pytest.mark.parametrize("broken", ["lit/000000_01.png", "scene_lights.json"])
def test_a_scene_that_fails_stops_everything_before_it_is_written(
    itree, scenes, paper_tree_file, answers, tmp_path, broken
):
    path = scenes / "000002" / broken
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    (tmp_path / "r.csv").write_text("old")
    before = sorted(tmp_path.iterdir())
    words = ["--json", tmp_path / "r.json", "--report", tmp_path / "pages"]
    ran = itree("recognize", scenes, paper_tree_file, "-o", tmp_path / "r.csv", *words)
    assert (ran.code, ran.out) == (2, "")
    assert str(scenes / "000002") in ran.err
    assert "Nothing was written" in ran.err
    assert sorted(tmp_path.iterdir()) == before
    assert (tmp_path / "r.csv").read_text() == "old"


def test_depth_that_is_not_there_is_asked_for_elsewhere(itree, scenes, paper_tree_file, answers, tmp_path):
    shutil.rmtree(scenes / "000002" / "depth")
    for source, advice in (("file", "no depth map (depth/)"), ("stereo", "no second camera (scene_stereo.json)")):
        ran = itree("recognize", scenes / "000002", paper_tree_file, "-o", tmp_path / "r.csv", "--depth", source)
        assert (ran.code, ran.out) == (2, "")
        assert advice in ran.err
        assert "--depth none" in ran.err
        assert not (tmp_path / "r.csv").exists()
    for source in ("none", "auto"):
        ran = itree("recognize", scenes / "000002", paper_tree_file, "-o", tmp_path / "r.csv", "--depth", source)
        assert ran.code == 0
    ran = itree("recognize", scenes / "000001", paper_tree_file, "-o", tmp_path / "r.csv", "--depth", "stereo")
    assert "no second camera" in ran.err


def test_a_scene_under_other_lights_is_refused(itree, scenes, paper_tree_file, answers, tmp_path):
    path = scenes / "000002" / "scene_lights.json"
    lights = json.loads(path.read_text())
    lights["0"]["directions"][1] = [0.0, 0.5735764363510462, -0.8191520442889918]
    path.write_text(json.dumps(lights))
    ran = itree("recognize", scenes, paper_tree_file, "-o", tmp_path / "r.csv")
    assert ran.code == 2
    assert "000002: the tree of 'ikeuchi-1987' (object 1) was compiled for another sensor: its light" in ran.err


def test_trees_and_scenes_missing_or_ambiguous_are_refused(itree, scenes, paper_tree, paper_tree_file, tmp_path):
    other = replace(paper_tree, part=replace(paper_tree.part, name="other"))
    save_tree(other, tmp_path / "other.tree")
    (scenes / "000002").rename(scenes / "second")
    out = ["-o", tmp_path / "r.csv"]
    for words, message in (
        ([scenes, *out], "no TREE is given"),
        ([scenes, tmp_path / "missing.tree", *out], "there is no tree file"),
        ([tmp_path / "missing", paper_tree_file, *out], "there is no such folder of scenes"),
        ([scenes, paper_tree_file, tmp_path / "other.tree", *out], "are both of object 1; compile one of them with"),
        ([scenes, paper_tree_file, *out], "second: among several scenes, each folder's name must be its number"),
    ):
        ran = itree("recognize", *words)
        assert (ran.code, ran.out) == (2, "")
        assert message in ran.err
        assert not (tmp_path / "r.csv").exists()


def test_a_scene_takes_one_tree_per_object_the_first_that_fits_its_lights(paper_tree):
    L = paper_tree.sensor.light_directions
    four = np.concatenate([L, [[0.0, 0.0, -1.0]]])
    three_1, four_1, again_1 = numbered(paper_tree), numbered(paper_tree, light_directions=four), numbered(paper_tree)
    three_2 = numbered(paper_tree, obj_id=2, slant_limit=0.5)
    trees = [four_1, three_1, again_1, three_2]
    assert fitting_trees(trees, paper_tree.sensor) == [three_1, three_2]
    assert fitting_trees([three_1, four_1], replace(paper_tree.sensor, light_directions=four)) == [four_1]
    with pytest.raises(ItreeError, match=r"object 2.*it has 3 lights, this one 4"):
        fitting_trees(trees, replace(paper_tree.sensor, light_directions=four))


def test_evaluate_names_what_is_wrong(itree, bin_dataset, tmp_path):
    (tmp_path / "r.csv").write_text("scene_id,im_id,obj_id,score,R,t,time\n42,0,1,high,1 0 0 0 1 0 0 0 1,0 0 1,1\n")
    ran = itree("evaluate", bin_dataset, tmp_path / "r.csv")
    assert (ran.code, ran.out) == (2, "")
    assert "row 2, column score" in ran.err
    ran = itree("evaluate", tmp_path / "missing", tmp_path / "r.csv", "--json")
    assert (ran.code, ran.out) == (2, "")


def test_self_calibration_recognises_again_with_the_lights_that_the_parts_tell(
    itree, scenes, paper_tree_file, answers, tmp_path, monkeypatch
):
    from itree_jax.refinement.self_calibration import SelfCalibration
    from itree_jax.sensing.scene_folder import load_scene

    told = load_scene(scenes / "000001").sensor
    moved = replace(told, light_intensities=1.1 * told.light_intensities)
    asked = []

    def calibrated(found, trees, images, sensor, depth):
        asked.append(len(found))
        kept = len(asked) == 1
        std = np.full(3, 0.01)
        return SelfCalibration(
            told, moved if kept else told, kept, moved.light_directions, moved.light_intensities, std, std, 0.2, 0.1,
            (0.7,), (), 0.0, 0.005, 1000, (),
        )  # fmt: skip

    monkeypatch.setattr("itree_jax.refinement.self_calibration.calibrated_by_answers", calibrated)
    words = ["--json", tmp_path / "r.json", "--self-calibrate"]
    ran = itree("recognize", scenes, paper_tree_file, "-o", tmp_path / "r.csv", *words)
    assert (ran.code, ran.err) == (0, "")
    assert asked == [1, 1]
    used = [sensor.light_intensities[0] for _, _, sensor in answers]
    assert used == pytest.approx([1.0, 1.1, 1.0])  # the second scene's correction is not kept
    first, second = json.loads((tmp_path / "r.json").read_text())["images"]
    assert (first["lights"]["kept"], second["lights"]["kept"]) == (True, False)
    assert first["time"] == 4.0
    document = json.loads((tmp_path / "r.lights.json").read_text())
    assert document["lights"]["intensities"] == pytest.approx([1.1] * 3)
    assert set(document["scenes"]) == {"000001", "000002"}
    assert "lights by scene 000001: light 0 0.00 deg +10.0 %" in ran.out
    assert "not used" in ran.out

    monkeypatch.setattr("itree_jax.refinement.self_calibration.calibrated_by_answers", lambda *_: None)
    (tmp_path / "r.lights.json").unlink()
    (tmp_path / "r.lights.json").mkdir()
    ran = itree("recognize", scenes, paper_tree_file, "-o", tmp_path / "r.csv", *words)
    assert ran.code == 2
    assert "r.lights.json is a folder" in ran.err
