"""A process that is killed or interrupted at any moment leaves nothing half-written and does not disturb the next."""

import signal
import subprocess
import sys
import time

import pytest

# The verb, which kills itself the n-th time that it comes where it is told to; the work itself is done by a tree that
# is ready, with the number that it is asked for.
COMPILE = """
import os, signal, sys
from dataclasses import replace
from importlib import import_module
at, nth, tree = sys.argv[1], int(sys.argv[2]), sys.argv[3]
came = []
def here(place):
    came.append(place)
    if place == at and came.count(place) == nth:
        os.kill(os.getpid(), signal.SIGKILL)
fsync = os.fsync
def synced(file):
    here("write")
    fsync(file)
os.fsync = synced
def compile_tree(part, sensor, *, obj_id, **options):
    print(part.name, flush=True)
    here("compile")
    return replace(import_module("itree_jax.tree.tree_file").load_tree(tree), obj_id=obj_id)
import_module("itree_jax.compile").compile_tree = compile_tree
from itree_jax.cli.main import main
sys.exit(main([*sys.argv[4:], "--sensor", "bundled:bench", "--quiet"]))
"""
RUN = "import sys; from itree_jax.cli.start import run; sys.exit(run())"


def compiled(tree, *words, at="never", nth=1) -> tuple[int, list[str]]:
    """Exit code, and the parts whose compilation began."""
    command = [sys.executable, "-c", COMPILE, at, str(nth), str(tree), "compile", *map(str, words)]
    ran = subprocess.run(command, stdout=subprocess.PIPE, text=True, timeout=300, check=False)
    return ran.returncode, ran.stdout.split()


def test_a_killed_compilation_leaves_nothing_and_the_next_gives_the_same_bytes(paper_tree_file, tmp_path):
    """That the same part, sensor and seed give the same tree is told by the tests of the compiler."""
    words = ["bundled:ikeuchi-1987", "-o", tmp_path / "a.tree"]
    for at in ("compile", "write"):
        assert compiled(paper_tree_file, *words, at=at)[0] == -signal.SIGKILL
        assert not (tmp_path / "a.tree").exists()
    assert [p.name[:8] for p in tmp_path.iterdir()] == [".a.tree."]  # by the one that was killed as it wrote
    assert compiled(paper_tree_file, *words)[0] == 0
    assert [p.name for p in tmp_path.iterdir()] == ["a.tree"]
    assert (tmp_path / "a.tree").read_bytes() == paper_tree_file.read_bytes()


PARTS = ("plate", "bracket", "clevis")


@pytest.fixture(scope="module")
def undisturbed(paper_tree_file, tmp_path_factory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("undisturbed") / "trees"
    assert compiled(paper_tree_file, *(f"bundled:{part}" for part in PARTS), "-o", folder) == (0, list(PARTS))
    return trees_in(folder)


def trees_in(folder) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.glob("*.tree")}


@pytest.mark.parametrize(
    ("at", "nth", "finished"),
    [
        ("write", 3, 1),  # the second tree
        ("write", 4, 1),  # what tells that the second tree is finished
        ("compile", 3, 2),
    ],
)
def test_a_killed_catalogue_goes_on_and_gives_the_same_bytes(
    paper_tree_file, undisturbed, tmp_path, at, nth, finished
):
    words = [*(f"bundled:{part}" for part in PARTS), "-o", tmp_path / "trees"]
    code, begun = compiled(paper_tree_file, *words, at=at, nth=nth)
    assert (code, begun) == (-signal.SIGKILL, list(PARTS[: finished + 1]))
    assert len(undisturbed) == len(PARTS)
    assert trees_in(tmp_path / "trees").items() <= undisturbed.items()  # whole or not there
    assert compiled(paper_tree_file, *words) == (0, list(PARTS[finished:]))
    assert trees_in(tmp_path / "trees") == undisturbed
    assert list(tmp_path.rglob("*.tmp")) == []


@pytest.mark.parametrize("seconds", [0.4, 1.5, 3.0])
def test_an_interrupt_at_any_moment_is_one_line(tmp_path, seconds):
    """While it is imported, while JAX is, and while it computes."""
    words = ["compile", "bundled:ikeuchi-1987", "--sensor", "bundled:bench", "-o", str(tmp_path / "a.tree"), "--quiet"]
    process = subprocess.Popen([sys.executable, "-c", RUN, *words], stderr=subprocess.PIPE, text=True)
    time.sleep(seconds)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=120)
    assert (process.returncode, said) == (130, "itree: interrupted; no output is half-written\n")
    assert list(tmp_path.iterdir()) == []
