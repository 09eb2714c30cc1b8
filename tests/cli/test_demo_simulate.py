"""`itree demo` and `itree simulate`: everything or nothing."""

import json

import pytest
from itree_kernels.errors import ItreeError

from itree_jax.results import read_bop_csv
from itree_jax.tree.tree_file import load_tree


@pytest.fixture
def compiled_at_once(paper_tree, monkeypatch):
    monkeypatch.setattr("itree_jax.compile.compile_tree", lambda part, sensor, report: paper_tree)


def test_demo_writes_page_tree_scene_and_results_and_compares(itree, compiled_at_once, paper_tree, tmp_path):
    out = tmp_path / "demo"
    ran = itree("demo", "-o", out)
    assert (ran.code, ran.err) == (0, "")
    assert {p.name for p in out.iterdir()} == {
        "index.html", "tree.html", "ikeuchi-1987.tree", "results.csv", "results.json", "scene",
    }  # fmt: skip
    assert load_tree(out / "ikeuchi-1987.tree").obj_id == paper_tree.obj_id
    rows = read_bop_csv(out / "results.csv")
    assert len(rows) >= 4
    images = json.loads((out / "results.json").read_text())["images"]
    assert {image["scene_id"] for image in images} == set(rows.scene_id)
    assert "parts visible by 70 % found, 0 of" in ran.out
    assert (out / "index.html").absolute().as_uri() in ran.out


def test_a_demo_that_fails_writes_nothing(itree, compiled_at_once, tmp_path, monkeypatch):
    def fail(*_):
        raise ItreeError("no bin today")

    monkeypatch.setattr("itree_jax.simulate.demo_bin", fail)
    ran = itree("demo", "-o", tmp_path / "demo")
    assert (ran.code, ran.out, ran.err) == (2, "", "itree: no bin today\n")
    assert list(tmp_path.iterdir()) == []


def test_simulate_writes_a_dataset_that_evaluate_and_recognize_can_read(itree, tmp_path):
    from itree_jax.sensing.scene_folder import load_scene, scene_folders

    out = tmp_path / "bins"
    words = ["simulate", "bundled:ikeuchi-1987", "--sensor", "bundled:bench", "--parts", 2, "-o", out, "--obj-id", 3]
    ran = itree(*words, "--scenes", 1, "--seed", 5)
    assert (ran.code, ran.err) == (0, "")
    (folder,) = scene_folders(out)
    assert load_scene(folder).scene_id == 1
    truth = json.loads((folder / "scene_gt.json").read_text())["0"]
    assert {entry["obj_id"] for entry in truth} == {3}
    ran = itree(*words, "--scenes", 1)
    assert ran.code == 2
    assert "is not empty" in ran.err


def test_a_simulation_that_fails_leaves_no_folder(itree, tmp_path, monkeypatch):
    def fail(part, sensor, scenes, parts, out, **_):
        (out / "models").mkdir()
        raise ItreeError("the engine is missing")

    monkeypatch.setattr("itree_jax.simulate.simulate", fail)
    words = ["--sensor", "bundled:bench", "--scenes", 1, "--parts", 1, "-o", tmp_path / "bins"]
    ran = itree("simulate", "bundled:ikeuchi-1987", *words)
    assert (ran.code, ran.out, ran.err) == (2, "", "itree: the engine is missing\n")
    assert list(tmp_path.iterdir()) == []
    ran = itree("simulate", "bundled:ikeuchi-1987", *words[:3], 0, *words[4:])
    assert ran.code == 2
