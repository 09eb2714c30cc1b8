"""A process that is killed or interrupted at any moment leaves nothing half-written and does not disturb the next."""

import signal
import subprocess
import sys
import time

import pytest

# The verb, which kills itself where it is told to; the work itself is done by a tree that is ready.
COMPILE = """
import os, signal, sys
from importlib import import_module
at, tree = sys.argv[1:3]
def kill(*_):
    os.kill(os.getpid(), signal.SIGKILL)
if at == "write":
    os.fsync = kill
def compile_tree(*given, **options):
    if at == "compile":
        kill()
    return import_module("itree_jax.tree.tree_file").load_tree(tree)
import_module("itree_jax.compile").compile_tree = compile_tree
from itree_jax.cli.main import main
sys.exit(main(sys.argv[3:]))
"""
RUN = "import sys; from itree_jax.cli.start import run; sys.exit(run())"


def compiled(folder, tree, at="never"):
    words = ["compile", "bundled:ikeuchi-1987", "--sensor", "bundled:bench", "-o", str(folder / "a.tree"), "--quiet"]
    command = [sys.executable, "-c", COMPILE, at, str(tree), *words]
    return subprocess.run(command, capture_output=True, timeout=300, check=False).returncode


def test_a_killed_compilation_leaves_nothing_and_the_next_gives_the_same_bytes(paper_tree_file, tmp_path):
    """That the same part, sensor and seed give the same tree is told by the tests of the compiler."""
    for at in ("compile", "write"):
        assert compiled(tmp_path, paper_tree_file, at) == -signal.SIGKILL
        assert not (tmp_path / "a.tree").exists()
    assert [p.name[:8] for p in tmp_path.iterdir()] == [".a.tree."]  # by the one that was killed as it wrote
    assert compiled(tmp_path, paper_tree_file) == 0
    assert [p.name for p in tmp_path.iterdir()] == ["a.tree"]
    assert (tmp_path / "a.tree").read_bytes() == paper_tree_file.read_bytes()


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
