"""Exit codes and messages of the command line; a process that starts fast and ends."""

import contextlib
import gc
import signal
import subprocess
import sys
import time
from importlib.metadata import version

import pytest
from itree_kernels.errors import ItreeError

from itree_jax.cli.main import VERBS

HELP = """
import sys
from itree_jax.cli.main import main
assert main(["{verb}", "--help"][{skip}:]) == 0
heavy = {{"jax", "warp", "trimesh", "scipy", "cv2", "matplotlib", "mujoco"}} & set(sys.modules)
assert not heavy, heavy
"""


def test_the_version_is_that_of_the_package(itree):
    assert itree("--version") == (0, f"itree-jax {version('itree-jax')}\n", "")


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["bogus"],
        ["compile", "x.stl"],
        ["show"],
        ["show", "a.tree", "--nonsense"],
        ["recognize", "scenes", "a.tree", "-o", "r.csv", "--depth", "sonar"],
        ["simulate", "x.stl", "--sensor", "s", "--scenes", "two", "--parts", "1", "-o", "d"],
    ],
)
def test_wrong_arguments_exit_with_2_and_an_explanation(itree, words):
    ran = itree(*words)
    assert (ran.code, ran.out) == (2, "")
    assert len(ran.err) > 20
    assert "Traceback" not in ran.err


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_explains_itself(itree, verb):
    ran = itree(verb, "--help")
    assert (ran.code, ran.err) == (0, "")
    assert f"itree {verb}" in ran.out
    assert "--quiet" in ran.out


def test_help_needs_no_heavy_import():
    for skip in (0, 1):
        program = HELP.format(verb="recognize", skip=skip)
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)
        assert (done.returncode, done.stderr) == (0, "")


def test_an_interrupt_exits_with_130(itree, monkeypatch, tmp_path):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("itree_jax.tree.tree_file.load_tree", interrupt)
    ran = itree("show", tmp_path / "a.tree")
    assert (ran.code, ran.out) == (130, "")
    assert "interrupted" in ran.err


def interrupt_in_a_callback():
    """The garbage collector drops what its callbacks raise."""

    def callback(*_):
        gc.callbacks.remove(callback)
        signal.raise_signal(signal.SIGINT)

    gc.callbacks.append(callback)
    gc.collect()


def interrupt_in_an_import():
    """As libraries do around what they can do without."""
    with contextlib.suppress(BaseException):
        signal.raise_signal(signal.SIGINT)


def interrupt_in_an_extension():
    """As extension modules report whatever happens while they load."""
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        raise ImportError("an error while initializing the extension") from None


@pytest.mark.parametrize("interrupt", [interrupt_in_a_callback, interrupt_in_an_import, interrupt_in_an_extension])
def test_an_interrupt_that_is_dropped_is_heard_all_the_same(itree, monkeypatch, tmp_path, interrupt):
    def work(_):
        interrupt()
        for _ in range(500):
            time.sleep(0.01)
        raise ItreeError("the work came to its end")

    monkeypatch.setattr("itree_jax.tree.tree_file.load_tree", work)
    before = signal.getsignal(signal.SIGINT), sys.unraisablehook
    ran = itree("show", tmp_path / "a.tree")
    assert (ran.code, ran.out, ran.err) == (130, "", "itree: interrupted; no output is half-written\n")
    assert (signal.getsignal(signal.SIGINT), sys.unraisablehook) == before


def test_an_interrupt_waits_while_an_extension_module_is_loaded(itree, monkeypatch, tmp_path):
    """What is raised inside of it makes many of them crash."""
    seen = []

    class ExtensionFileLoader:  # told by its name, as the interpreter's own
        def exec_module(self):
            signal.raise_signal(signal.SIGINT)
            seen.append("loaded")

    ExtensionFileLoader.exec_module.__code__ = ExtensionFileLoader.exec_module.__code__.replace(
        co_qualname="ExtensionFileLoader.exec_module"
    )

    def work(_):
        ExtensionFileLoader().exec_module()
        for _ in range(500):
            time.sleep(0.01)
        raise ItreeError("the work came to its end")

    monkeypatch.setattr("itree_jax.tree.tree_file.load_tree", work)
    ran = itree("show", tmp_path / "a.tree")
    assert (ran.code, ran.err) == (130, "itree: interrupted; no output is half-written\n")
    assert seen == ["loaded"]


def test_a_mistake_of_the_program_keeps_its_traceback(itree, monkeypatch, tmp_path):
    def wrong(*_):
        raise ZeroDivisionError

    monkeypatch.setattr("itree_jax.tree.tree_file.load_tree", wrong)
    with pytest.raises(ZeroDivisionError):
        itree("show", tmp_path / "a.tree")
