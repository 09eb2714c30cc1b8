"""`itree compile` of several parts and `itree evaluate --recognize`, on this machine, with stand-ins for the work."""

import json
import shutil
from importlib import import_module

import numpy as np
import pytest
from itree_cad.bundled import bundled_part
from itree_cad.load import save_stl
from itree_kernels.errors import ItreeError

from itree_jax.cli.compile_catalogue import compile_units, object_numbers
from itree_jax.cli.recognize_dataset import files_read
from itree_jax.detections import Detection, Detections
from itree_jax.results import csv_lines, read_bop_csv, results_document, write_bop_csv
from itree_jax.sensing.bundled import bundled_sensor


@pytest.fixture
def compiled(paper_tree, monkeypatch):
    """Puts the ready tree in the place of every compilation; gives the object numbers that were asked for."""
    asked = []

    def compile_tree(part, sensor, *, obj_id, **options):
        asked.append(obj_id)
        return paper_tree

    monkeypatch.setattr(import_module("itree_jax.compile"), "compile_tree", compile_tree)
    return asked


@pytest.fixture
def models(tmp_path):
    """Two CAD files, one of them with a number."""
    folder = tmp_path / "models"
    folder.mkdir()
    for name in ("bolt", "obj_000001"):
        save_stl(bundled_part("ikeuchi-1987"), folder / f"{name}.stl")
    (folder / "notes.txt").write_text("no model")
    return folder


@pytest.fixture
def recognised(monkeypatch):
    """Recognition that answers at once: one part, at the centre of the image. Gives how often it was asked."""
    asked = []

    def recognize_one(prepared, images, sensor, depth, R_w2c, second=None, picks=None):
        asked.append(images.shape)
        one = Detection(0, 0, prepared[0].tree.obj_id, 0.1 + 0.2, np.eye(3), np.array([0.1, 1e-17, 900.0]))
        return Detections((one,), time=2.0)

    monkeypatch.setattr(import_module("itree_jax.recognition"), "recognize_one", recognize_one)
    return asked


@pytest.fixture
def dataset(bin_dataset, tmp_path):
    """The dataset with its scene twice, to be broken."""
    copy = tmp_path / "dataset"
    shutil.copytree(bin_dataset, copy)
    shutil.copytree(copy / "test" / "000042", copy / "test" / "000043")
    return copy


def test_every_part_gets_a_tree_once(itree, compiled, models, paper_tree_file, tmp_path):
    words = ["compile", models, "bundled:plate", "--sensor", "bundled:bench", "-o", tmp_path / "trees"]
    ran = itree(*words)
    assert (ran.code, ran.err) == (0, "")
    assert sorted(p.name for p in (tmp_path / "trees").glob("*.tree")) == ["bolt.tree", "obj_000001.tree", "plate.tree"]
    assert (tmp_path / "trees" / "bolt.tree").read_bytes() == paper_tree_file.read_bytes()
    assert compiled == [2, 1, 3]
    assert "3 trees" in ran.out
    assert "3 of them by an earlier run" in itree(*words).out
    assert len(compiled) == 3
    assert itree(*words, "--seed", 1, "--quiet") == (0, "", "")
    assert len(compiled) == 6


def test_a_part_that_fails_is_named_and_the_others_are_compiled(itree, compiled, models, tmp_path):
    (models / "broken.stl").write_text("no STL")
    ran = itree("compile", models, "missing.step", "--sensor", "bundled:bench", "-o", tmp_path / "trees")
    assert ran.code == 2
    assert "2 of 4 parts failed" in ran.err
    assert "broken: " in ran.err
    assert "missing: there is no file missing.step" in ran.err
    assert "Traceback" not in ran.err
    assert set(json.loads((tmp_path / "trees" / "failures.json").read_text())) == {"broken", "missing"}
    assert len(list((tmp_path / "trees").glob("*.tree"))) == 2


@pytest.mark.parametrize(
    ("given", "more", "words"),
    [
        ((), (), "no MODEL is given"),
        (("a.stl", "b.stl"), ("--obj-id", 1), "--obj-id is for one model alone"),
        (("a.stl", "b.stl"), ("--solid", "x"), "--solid is for one model alone"),
        (("a/x.stl", "b/x.step"), (), "would both make the tree of the name x"),
        (("a/obj_1.stl", "obj_01.stl"), (), "would both make the object 1"),
    ],
)
def test_a_catalogue_that_makes_no_sense_is_refused(itree, tmp_path, given, more, words):
    ran = itree("compile", *given, "--sensor", "bundled:bench", "-o", tmp_path / "trees", *more)
    assert (ran.code, ran.out) == (2, "")
    assert words in ran.err
    assert list(tmp_path.iterdir()) == []


def test_parts_without_a_number_take_those_that_are_left():
    assert object_numbers(["a.stl", "obj_000002.stl", "b.stl", "bundled:plate"]) == [1, 2, 3, 4]
    assert object_numbers(["obj_7.ply", "a", "obj_1.ply"]) == [7, 2, 1]


def test_a_tree_is_made_again_when_its_model_changes(models, tmp_path):
    from itree_jax.cli.compile_catalogue import Options

    (models / "part.json").write_text(json.dumps({"model": "bolt.stl"}))
    given = [str(models / name) for name in ("bolt.stl", "obj_000001.stl", "part.json")]
    before = [unit.key for unit in compile_units(given, bundled_sensor("bench"), Options())]
    save_stl(bundled_part("plate"), models / "bolt.stl")
    after = [unit.key for unit in compile_units(given, bundled_sensor("bench"), Options())]
    assert [a == b for a, b in zip(after, before, strict=True)] == [False, True, False]
    other = [unit.key for unit in compile_units(given, bundled_sensor("depth-bench"), Options())]
    assert not set(other) & set(after)


def test_a_dataset_is_recognised_and_scored_scene_by_scene(itree, recognised, dataset, paper_tree_file, tmp_path):
    words = ["evaluate", dataset, "--recognize", paper_tree_file, "-o", tmp_path / "out"]
    ran = itree(*words)
    assert (ran.code, ran.err) == (0, "")
    assert "2 scenes" in ran.out
    assert "top pick %" in ran.out
    rows = read_bop_csv(tmp_path / "out" / "results.csv")
    assert (rows.scene_id.tolist(), rows.time.tolist()) == ([42, 43], [-1.0, -1.0])
    assert sorted(p.name for p in (tmp_path / "out" / "scenes").iterdir()) == ["000042.json", "000043.json"]
    first = (tmp_path / "out" / "results.csv").read_bytes()
    (tmp_path / "out" / "units" / "000043.json").unlink()
    assert "1 of them by an earlier run" in itree(*words).out
    assert len(recognised) == 3
    assert (tmp_path / "out" / "results.csv").read_bytes() == first
    scored = json.loads(itree(*words, "--json").out)
    assert scored == json.loads(itree("evaluate", dataset, tmp_path / "out" / "results.csv", "--json").out)


def test_a_scene_that_fails_is_named_and_the_others_are_recognised(
    itree, recognised, dataset, paper_tree_file, tmp_path
):
    shutil.rmtree(dataset / "test" / "000042" / "lit")
    words = ["evaluate", dataset, "--recognize", paper_tree_file, "-o", tmp_path / "out"]
    ran = itree(*words)
    assert ran.code == 2
    assert "1 of 2 scenes failed" in ran.err
    assert "000042: " in ran.err
    assert read_bop_csv(tmp_path / "out" / "results.csv").scene_id.tolist() == [43]
    shutil.copytree(dataset / "test" / "000043" / "lit", dataset / "test" / "000042" / "lit")
    assert itree(*words).code == 0
    assert len(recognised) == 2


def test_a_recognition_that_makes_no_sense_is_refused(itree, dataset, paper_tree_file, tmp_path):
    out = tmp_path / "out"
    for words, message in (
        ([dataset], "give a results.csv to score, or trees"),
        ([dataset, "r.csv", "--cluster", "local"], "go with --recognize"),
        ([dataset, "--recognize", paper_tree_file], "give --output DIR"),
        ([dataset, "r.csv", "--recognize", paper_tree_file, "-o", out], "and no results.csv"),
        ([dataset, "--recognize", tmp_path / "no.tree", "-o", out], "there is no tree file"),
        ([tmp_path / "no", "--recognize", paper_tree_file, "-o", out], "models_info.json"),
    ):
        ran = itree("evaluate", *words)
        assert (ran.code, ran.out) == (2, "")
        assert message in ran.err
        assert not out.exists()


def test_answers_depend_on_images_and_lights_but_not_on_the_truth(dataset):
    names = {path.name for path in files_read(dataset / "test" / "000042")}
    assert {"000000_00.png", "scene_camera.json", "scene_lights.json", "000000.png"} <= names
    assert not {name for name in names if "gt" in name}


def test_the_rows_of_a_document_are_those_of_the_csv(tmp_path):
    rng = np.random.default_rng(0)
    found = [
        Detections(
            tuple(Detection(scene, 0, k + 1, rng.random(), rng.random((3, 3)), rng.random(3)) for k in range(3)),
            time=rng.random(), scene_id=scene,
        )
        for scene in (2, 1)
    ]  # fmt: skip
    write_bop_csv(found, tmp_path / "r.csv")
    document = json.loads(json.dumps(results_document(found)))
    assert csv_lines(document) == (tmp_path / "r.csv").read_text().splitlines()[1:]


def test_a_tree_that_is_another_file_elsewhere_is_refused(paper_tree_file):
    from itree_jax.cli.recognize_dataset import TreeFile, prepared_trees

    with pytest.raises(ItreeError, match="is not the same file here"):
        prepared_trees((TreeFile(str(paper_tree_file), "another"),))
