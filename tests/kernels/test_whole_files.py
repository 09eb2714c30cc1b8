"""Files and folders are whole or not there, whatever comes between."""

import os
import resource
import signal
import subprocess
import sys
from contextlib import contextmanager

import pytest
from itree_kernels.errors import ItreeError
from itree_kernels.whole_files import whole_entries, whole_folder, write_whole

KILLED = """
import os, signal, sys
from itree_kernels.whole_files import {name}
def kill(*_): os.kill(os.getpid(), signal.SIGKILL)
os.fsync = kill
os.replace = kill
{work}
"""


def tree_of(folder):
    return {str(p.relative_to(folder)): p.read_text() for p in sorted(folder.rglob("*")) if p.is_file()}


@contextmanager
def full_disk(room=0):
    """Files cannot grow beyond `room` bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_file_is_written_as_it_is_and_keeps_its_permissions(tmp_path):
    path = tmp_path / "a.txt"
    write_whole(path, "é\r\n")
    assert path.read_bytes() == "é\r\n".encode()
    path.chmod(0o640)
    write_whole(path, b"\x00new")
    assert path.read_bytes() == b"\x00new"
    assert path.stat().st_mode & 0o777 == 0o640
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_a_link_stays_and_what_it_names_is_written(tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "a.txt").symlink_to(tmp_path / "there" / "b.txt")
    write_whole(tmp_path / "a.txt", "text")
    assert (tmp_path / "a.txt").is_symlink()
    assert tree_of(tmp_path / "there") == {"b.txt": "text"}


def test_what_is_no_regular_file_is_written_into():
    write_whole(os.devnull, "text")
    assert os.path.exists(os.devnull)
    assert not os.path.isfile(os.devnull)


@pytest.mark.parametrize("room", [0, 10])
def test_a_full_disk_leaves_the_old_file(tmp_path, room):
    (tmp_path / "a.txt").write_text("old")
    with full_disk(room), pytest.raises(ItreeError, match=r"a\.txt: cannot be written \(File too large\)"):
        write_whole(tmp_path / "a.txt", "longer than the room")
    assert tree_of(tmp_path) == {"a.txt": "old"}
    with full_disk(room), pytest.raises(ItreeError, match="cannot be written"), whole_entries(tmp_path / "f") as stage:
        (stage / "a.txt").write_text("longer than the room")
    assert tree_of(tmp_path) == {"a.txt": "old"}


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_an_interrupt_leaves_the_old_file(tmp_path, monkeypatch, call):
    def interrupt(*_):
        raise KeyboardInterrupt

    (tmp_path / "a.txt").write_text("old")
    monkeypatch.setattr(os, call, interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_whole(tmp_path / "a.txt", "new")
    assert tree_of(tmp_path) == {"a.txt": "old"}


@pytest.mark.parametrize("name", ["write_whole", "whole_entries", "whole_folder"])
def test_what_a_killed_process_leaves_is_cleared_by_the_next(tmp_path, name):
    fill = f"with {name}('a') as stage: (stage / 'b').write_text('new')"
    program = KILLED.format(name=name, work="write_whole('a', 'new')" if name == "write_whole" else fill)
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, check=False)
    assert done.returncode == -signal.SIGKILL
    (left,) = tmp_path.iterdir()
    assert left.name.startswith(".a.")
    write_whole(tmp_path / "b", "")  # clears what is its own
    assert left.exists()
    write_whole(tmp_path / "a", "whole")
    assert tree_of(tmp_path) == {"a": "whole", "b": ""}


def test_what_a_running_process_writes_is_left_alone(tmp_path):
    with whole_entries(tmp_path / "a") as stage:
        write_whole(tmp_path / "a", "whole")
        assert stage.is_dir()
        (tmp_path / "a").unlink()
    assert (tmp_path / "a").is_dir()


def test_a_folder_takes_the_place_of_another(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "stale").write_text("old")
    with whole_folder(tmp_path / "out") as stage:
        (stage / "fresh").write_text("new")
        assert tree_of(tmp_path / "out") == {"stale": "old"}
    assert tree_of(tmp_path) == {"out/fresh": "new"}


def test_entries_that_cannot_all_be_moved_move_back(tmp_path, monkeypatch):
    out, replace = tmp_path / "out", os.replace
    out.mkdir()
    for name in ("a", "b", "mine"):
        (out / name).write_text("old")
    moved = []

    def fails_at_b(source, target):
        if os.path.basename(source) == "b" and ".tmp" in str(source) and not moved:
            moved.append(target)
            raise OSError(28, "No space left on device")
        replace(source, target)

    monkeypatch.setattr(os, "replace", fails_at_b)

    def write():
        with whole_entries(out) as stage:
            for name in ("a", "b", "c"):
                (stage / name).write_text("new")

    with pytest.raises(ItreeError, match=r"out: cannot be written \(No space left on device\)"):
        write()
    assert moved
    assert tree_of(tmp_path) == {"out/a": "old", "out/b": "old", "out/mine": "old"}


@pytest.mark.parametrize("whole", [whole_entries, whole_folder])
def test_a_folder_that_fails_leaves_what_was_there(tmp_path, whole):
    def work():
        with whole(tmp_path / "out") as stage:
            (stage / "page").write_text("half")
            raise ItreeError("what went wrong")

    with pytest.raises(ItreeError, match="what went wrong"):
        work()
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_is_not_there_is_told(tmp_path):
    with pytest.raises(ItreeError, match=r"nowhere/a: cannot be written \(No such file or directory\)"):
        write_whole(tmp_path / "nowhere" / "a", "")
    with pytest.raises(ItreeError, match=r"nowhere/a: cannot be written"), whole_entries(tmp_path / "nowhere" / "a"):
        pass
