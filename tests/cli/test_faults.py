"""A process that is killed or interrupted at any moment leaves nothing half-written, and the next one is not disturbed."""

import os
import signal
import subprocess
import sys
import time

import pytest

# Compilation of a small part that kills itself where it is told to.
COMPILE = """
import os, signal, sys
at = sys.argv.pop(1)
def kill(*_):
    os.kill(os.getpid(), signal.SIGKILL)
if at == "write":
    os.fsync = kill
import itree_jax.compile as compiling
import functools
told = compiling.compile_tree
def compile_tree(*given, report, **options):
    def watched(what, share):
        report(what, share)
        if what == at:
            kill()
    return told(*given, report=watched, draws=3, **options)
compiling.compile_tree = compile_tree
from itree_jax.cli.main import main
sys.exit(main(sys.argv[1:]))
"""
RUN = "import sys; from itree_jax.cli.start import run; sys.exit(run())"


def compiled(folder, at="never"):
    words = ["compile", "bundled:plate", "--sensor", "bundled:bench", "-o", str(folder / "plate.tree"), "--quiet"]
    done = subprocess.run([sys.executable, "-c", COMPILE, at, *words], capture_output=True, timeout=300, check=False)
    return done.returncode


def test_a_killed_compilation_leaves_nothing_and_the_next_gives_the_same_bytes(tmp_path):
    (tmp_path / "whole").mkdir()
    assert compiled(tmp_path / "whole") == 0
    expected = (tmp_path / "whole" / "plate.tree").read_bytes()
    out = tmp_path / "killed"
    out.mkdir()
    for at in ("drawing under noise", "write"):
        assert compiled(out, at) == -signal.SIGKILL
        assert not (out / "plate.tree").exists()
    assert [p.name[:12] for p in out.iterdir()] == [".plate.tree."]  # by the one that was killed as it wrote
    assert compiled(out) == 0
    assert [p.name for p in out.iterdir()] == ["plate.tree"]
    assert (out / "plate.tree").read_bytes() == expected


@pytest.mark.parametrize("seconds", [0.3, 1.0, 3.0, 6.0])
def test_an_interrupt_at_any_moment_is_one_line(tmp_path, seconds):
    """While it is imported, while JAX is, and while it computes."""
    words = ["compile", "bundled:ikeuchi-1987", "--sensor", "bundled:bench", "-o", str(tmp_path / "a.tree"), "--quiet"]
    process = subprocess.Popen(
        [sys.executable, "-c", f"import time; started = time.time(); {RUN}", *words], stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONFAULTHANDLER": ""},
    )  # fmt: skip
    time.sleep(seconds)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=120)
    assert (process.returncode, said) == (130, "itree: interrupted; no output is half-written\n")
    assert list(tmp_path.iterdir()) == []
