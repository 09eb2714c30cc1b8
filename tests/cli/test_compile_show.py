"""`itree compile` and `itree show`."""

import json
from importlib import import_module

import pytest

from itree_jax.tree.describe import describe


@pytest.fixture
def compiled_with(paper_tree, monkeypatch):
    """Puts the ready tree in the place of a compilation; gives what it was asked for."""
    asked = {}

    def compile_tree(part, sensor, *, report, **options):
        report("casting", 0.5)
        asked.update(options, part=part, sensor=sensor)
        return paper_tree

    monkeypatch.setattr(import_module("itree_jax.compile"), "compile_tree", compile_tree)
    return asked


def test_compile_writes_the_tree(itree, compiled_with, paper_tree_file, tmp_path):
    path = tmp_path / "a.tree"
    ran = itree("compile", "bundled:ikeuchi-1987", "--sensor", "bundled:bench", "-o", path)
    assert (ran.code, ran.err) == (0, "")
    assert path.read_bytes() == paper_tree_file.read_bytes()
    assert f"{path}: ikeuchi-1987, 72.1 mm across, object 1: 7 attitude groups, 5 of them leaves" in ran.out
    assert compiled_with["part"].name == "ikeuchi-1987"
    assert compiled_with["sensor"].camera.kind == "pinhole"
    options = {k: compiled_with[k] for k in ("obj_id", "policy", "dome_frequency", "label_faces", "seed")}
    assert options == {"obj_id": 1, "policy": "measured", "dome_frequency": 1, "label_faces": None, "seed": 0}


def test_compile_passes_its_options_on(itree, compiled_with, tmp_path):
    from itree_cad.bundled import bundled_part
    from itree_cad.load import save_stl

    save_stl(bundled_part("ikeuchi-1987"), tmp_path / "obj_000005.stl")
    words = ["compile", tmp_path / "obj_000005.stl", "--sensor", "bundled:bench", "-o", tmp_path / "a.tree", "--quiet"]
    more = ["--units", "in", "--policy", "paper", "--dome", 2, "--label-faces", 6, "--seed", 3]
    assert itree(*words, *more) == (0, "", "")
    assert compiled_with["part"].diameter == pytest.approx(25.4 * bundled_part("ikeuchi-1987").diameter)
    options = {k: compiled_with[k] for k in ("obj_id", "policy", "dome_frequency", "label_faces", "seed")}
    assert options == {"obj_id": 5, "policy": "paper", "dome_frequency": 2, "label_faces": 6, "seed": 3}
    itree(*words, "--obj-id", 9)
    assert compiled_with["obj_id"] == 9


@pytest.mark.parametrize(
    ("model", "sensor", "words"),
    [
        ("bundled:nothing", "bundled:bench", "no bundled part 'nothing'"),
        ("bundled:ikeuchi-1987", "bundled:nothing", "no bundled sensor is called 'nothing'"),
        ("missing.stl", "bundled:bench", "there is no file missing.stl"),
        ("bundled:ikeuchi-1987", "missing.json", "sensor 'missing.json' is neither"),
    ],
)
def test_compile_says_what_is_wrong_and_writes_nothing(itree, tmp_path, model, sensor, words):
    ran = itree("compile", model, "--sensor", sensor, "-o", tmp_path / "a.tree")
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.startswith("itree: ")
    assert words in ran.err
    assert list(tmp_path.iterdir()) == []


def test_compile_refuses_an_implausible_size_before_it_works(itree, tmp_path):
    from itree_cad.bundled import bundled_part
    from itree_cad.load import save_stl

    save_stl(bundled_part("ikeuchi-1987"), tmp_path / "a.stl")
    ran = itree("compile", tmp_path / "a.stl", "--units", "m", "--sensor", "bundled:bench", "-o", tmp_path / "a.tree")
    assert ran.code == 2
    assert "larger than the sensor's field of view" in ran.err
    assert "--units mm" in ran.err
    assert not (tmp_path / "a.tree").exists()


def test_compile_asks_for_the_folder_of_its_output_first(itree, tmp_path):
    ran = itree("compile", "missing.stl", "--sensor", "missing", "-o", tmp_path / "nowhere" / "a.tree")
    assert ran.code == 2
    assert "there is no folder" in ran.err


def test_show_json_is_the_description(itree, paper_tree, paper_tree_file):
    ran = itree("show", paper_tree_file, "--json")
    assert (ran.code, ran.err) == (0, "")
    assert json.loads(ran.out) == json.loads(json.dumps(describe(paper_tree)))
    assert itree("show", paper_tree_file, "--json", "--quiet").out == ran.out


def test_show_prints_tables_and_quiet_nothing(itree, paper_tree, paper_tree_file):
    ran = itree("show", paper_tree_file)
    assert (ran.code, ran.err) == (0, "")
    assert all(label in ran.out for label in paper_tree.groups.label_strings)
    assert itree("show", paper_tree_file, "--quiet") == (0, "", "")


def test_show_writes_a_page(itree, paper_tree_file, tmp_path):
    page = tmp_path / "tree.html"
    ran = itree("show", paper_tree_file, "--html", page)
    assert (ran.code, ran.out, ran.err) == (0, f"wrote {page}\n", "")
    assert page.read_text(encoding="utf-8").lstrip().lower().startswith("<!doctype html>")


@pytest.mark.parametrize("switch", [[], ["--branches"]])
def test_show_writes_the_tree_alone(itree, paper_tree, paper_tree_file, tmp_path, switch):
    picture = tmp_path / "tree.svg"
    ran = itree("show", paper_tree_file, "--svg", picture, *switch)
    assert (ran.code, ran.out, ran.err) == (0, f"wrote {picture}\n", "")
    text = picture.read_text(encoding="utf-8")
    shown = [label in text for label in paper_tree.groups.label_strings]
    assert shown == ([True] * 7 if switch else (~paper_tree.groups.pruned).tolist())


def test_show_writes_page_picture_and_json_in_one_go(itree, paper_tree_file, tmp_path):
    page, picture = tmp_path / "tree.html", tmp_path / "tree.svg"
    ran = itree("show", paper_tree_file, "--html", page, "--svg", picture)
    assert ran.out == f"wrote {page}\nwrote {picture}\n"
    ran = itree("show", paper_tree_file, "--json", "--svg", picture)
    assert json.loads(ran.out)["part"]["name"] == "ikeuchi-1987"


def test_show_says_that_branches_need_a_picture(itree, paper_tree_file):
    ran = itree("show", paper_tree_file, "--branches")
    assert (ran.code, ran.out) == (2, "")
    assert "give --svg FILE as well" in ran.err


def test_show_refuses_what_is_no_tree(itree, tmp_path):
    (tmp_path / "a.tree").write_text("no tree")
    for name, words in (("a.tree", "is not a tree file"), ("b.tree", "there is no tree file")):
        ran = itree("show", tmp_path / name, "--json")
        assert (ran.code, ran.out) == (2, "")
        assert words in ran.err
