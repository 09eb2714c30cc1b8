"""Outputs are whole or not there."""

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from itree_kernels.errors import ItreeError
from itree_kernels.whole_files import write_whole

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


NOBODY = 65534


@pytest.fixture
def without_permission() -> Iterator[Path]:
    """A folder that this process may read and not write to; it is nobody meanwhile, where it was root."""
    with tempfile.TemporaryDirectory() as place:
        locked = Path(place) / "locked"
        locked.mkdir()
        (locked / "a.csv").write_text("old")
        locked.chmod(0o555)
        Path(place).chmod(0o777)
        before = os.geteuid()
        if before == 0:
            os.seteuid(NOBODY)
        try:
            yield locked
        finally:
            os.seteuid(before)
            locked.chmod(0o755)


def test_a_folder_without_permission_is_refused_before_the_work_and_after_it(without_permission):
    def staged(folder: Path) -> None:
        with staged_folder(folder):
            pass

    new, old = without_permission / "new", without_permission / "a.csv"
    for place, doors in (
        (new, (check_file, check_folder, staged, lambda at: write_whole(at, "new"))),
        (old, (check_file, lambda at: write_whole(at, "new"))),
        (without_permission, (check_folder, staged)),
    ):
        for door in doors:
            with pytest.raises(ItreeError, match=r"locked.* cannot be written.*\(Permission denied\)"):
                door(place)
    assert tree_of(without_permission) == {"a.csv": "old"}
