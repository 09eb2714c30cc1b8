"""Outputs are whole or not there."""

import pytest
from itree_kernels.errors import ItreeError

from itree_jax.cli.outputs import check_file, check_folder, staged_folder


def tree_of(folder):
    return {str(p.relative_to(folder)): p.read_text() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_a_staged_folder_appears_whole_and_leaves_what_is_not_its_own(tmp_path):
    out = tmp_path / "out"
    (out / "scene").mkdir(parents=True)
    (out / "scene" / "stale").write_text("old")
    (out / "page").write_text("old")
    (out / "notes").write_text("mine")
    with staged_folder(out) as stage:
        (stage / "scene").mkdir()
        (stage / "scene" / "fresh").write_text("new")
        (stage / "page").write_text("new")
        assert tree_of(out)["page"] == "old"
    assert tree_of(out) == {"notes": "mine", "page": "new", "scene/fresh": "new"}
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, ItreeError])
def test_a_staged_folder_that_fails_leaves_nothing(tmp_path, error):
    def work():
        with staged_folder(tmp_path / "out") as stage:
            (stage / "page").write_text("half")
            raise error

    with pytest.raises(error):
        work()
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_cannot_be_written_to_is_refused_with_its_name(tmp_path):
    (tmp_path / "file").write_text("")
    check_file(tmp_path / "new.csv")
    check_file(tmp_path / "file")
    check_folder(tmp_path)
    check_folder(tmp_path / "new")
    for check, place, message in (
        (check_file, tmp_path, "is a folder"),
        (check_file, tmp_path / "nowhere" / "a.csv", "there is no folder .*nowhere to write a.csv into"),
        (check_folder, tmp_path / "file", "is a file"),
        (check_folder, tmp_path / "nowhere" / "out", "there is no folder .*nowhere to make out in"),
    ):
        with pytest.raises(ItreeError, match=message):
            check(place)
