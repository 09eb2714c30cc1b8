"""A Ray cluster of two workers on this machine: the bytes are those of one process, whatever happens to the workers."""

import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import pytest
from itree_kernels.errors import ItreeError

from itree_jax.cluster import Failed, Product, ThisMachine, Unit, run_units, workers_at

pytest.importorskip("ray", reason='Ray is not installed: pip install "itree-jax[cluster]"')
PATIENCE = 60.0  # [s]
# Ray starts its processes by a fork, of which JAX warns whoever has used it before; they run nothing of JAX's state
pytestmark = pytest.mark.filterwarnings("ignore:os.fork:RuntimeWarning")


@pytest.fixture(scope="module")
def two_workers(tmp_path_factory):
    from itree_jax.cluster.ray_workers import ray_workers

    with ray_workers("local", cores=2) as workers:
        yield workers


def files_of(folder):
    return {p.name: p.read_bytes() for p in sorted(folder.iterdir()) if p.is_file()}


def results_of(folder):
    """All files but the records, which tell seconds."""
    every = (p for p in sorted(folder.rglob("*")) if p.is_file() and p.parent.name != "units")
    return {str(p.relative_to(folder)): p.read_bytes() for p in every}


def quiet(what, share):
    pass


def appears(path: Path) -> bool:
    end = time.monotonic() + PATIENCE
    while not path.exists() and time.monotonic() < end:
        time.sleep(0.02)
    return path.exists()


def cubes():
    """Work that is sent by value: the workers don't know this file."""

    def cube(task):
        from itree_kernels.errors import ItreeError

        if task == 5:
            raise ItreeError("five is refused")
        return Product({f"{task}.txt": str(task**3).encode()}, {"task": task})

    return cube, [Unit(f"n{k}", str(k), k) for k in range(8)]


def test_a_cluster_gives_the_bytes_and_the_failures_of_one_process(two_workers, tmp_path):
    work, units = cubes()
    there = run_units(units, work, tmp_path / "there", two_workers, quiet)
    here = run_units(units, work, tmp_path / "here", ThisMachine(), quiet)
    assert files_of(tmp_path / "there") == files_of(tmp_path / "here")
    assert there.failures == here.failures == {"n5": "five is refused"}
    assert [one.record for one in there.done] == [one.record for one in here.done]
    assert run_units(units[:5], work, tmp_path / "there", ThisMachine(), quiet).resumed == 5


def test_a_killed_worker_loses_nothing(two_workers, tmp_path):
    """Each of the first two units tells its process and waits; one of them is killed from here."""
    told, killed = tmp_path / "told", tmp_path / "killed"
    told.mkdir()

    def work(task):
        if task < 2:
            (told / f"{task}").write_text(str(os.getpid()))
            os.replace(told / f"{task}", told / f"{task}.pid")
            while not killed.exists():
                time.sleep(0.02)
        return Product({f"{task}.txt": str(task).encode()}, {"pid": os.getpid()})

    pids = []

    def kill_one():
        if appears(told / "0.pid") and appears(told / "1.pid"):
            pids.extend(int((told / f"{task}.pid").read_text()) for task in (0, 1))
            os.kill(pids[0], signal.SIGKILL)
        killed.write_text("")

    killer = threading.Thread(target=kill_one)
    killer.start()
    ran = run_units([Unit(f"n{k}", "", k) for k in range(6)], work, tmp_path / "out", two_workers, quiet)
    killer.join()
    assert len(set(pids)) == 2
    assert ran.failures == {}
    assert files_of(tmp_path / "out") == {f"{k}.txt": str(k).encode() for k in range(6)}
    done_by = [one.record["pid"] for one in ran.done]
    assert pids[0] not in done_by
    assert done_by[1] == pids[1]


def compiling_and_recognising(told):
    """The product's own work, its trees of few draws; who compiles tells its process amid it and waits to be killed."""

    def work(task):
        from functools import partial
        from importlib import import_module
        from unittest.mock import patch

        from itree_jax.cli.compile_catalogue import CompileTask, compile_part
        from itree_jax.cli.recognize_dataset import recognize_folder

        def report(what, share):
            if what == "casting view x roll" and not (told / "killed").exists():
                (told / "writing").write_text(str(os.getpid()))
                os.replace(told / "writing", told / "pid")
                while not (told / "killed").exists():
                    time.sleep(0.02)

        if not isinstance(task, CompileTask):
            return recognize_folder(task)
        module = import_module("itree_jax.compile")
        with patch.object(module, "compile_tree", partial(module.compile_tree, draws=4, report=report)):
            return compile_part(task)

    return work


def test_a_tree_and_scenes_come_out_the_same_though_a_worker_is_killed(two_workers, paper_tree_file, tmp_path):
    from soak import bins, small_sensor

    from itree_jax.cli.compile_catalogue import Options, compile_units
    from itree_jax.cli.recognize_dataset import scene_units
    from itree_jax.sensing.scene_writer import write_scene

    told = tmp_path / "told"
    told.mkdir()
    for number, scene in enumerate(bins(2, seed=0), start=1):
        write_scene(tmp_path / "scenes" / f"{number:06d}", scene)
    units = [
        *compile_units(["bundled:plate"], small_sensor(), Options()),
        *scene_units(tmp_path / "scenes", [paper_tree_file], "file"),
    ]
    work, pids = compiling_and_recognising(told), []

    def kill_the_compiling():
        if appears(told / "pid"):
            pids.append(int((told / "pid").read_text()))
            os.kill(pids[0], signal.SIGKILL)
        (told / "killed").write_text("")

    killer = threading.Thread(target=kill_the_compiling)
    killer.start()
    there = run_units(units, work, tmp_path / "there", two_workers, quiet)
    killer.join()
    here = run_units(units, work, tmp_path / "here", ThisMachine(), quiet)
    assert len(pids) == 1
    assert there.failures == here.failures == {}
    found = results_of(tmp_path / "there")
    assert sorted(found) == ["plate.tree", "scenes/000001.json", "scenes/000002.json"]
    assert b'"score"' in found["scenes/000001.json"]
    assert found == results_of(tmp_path / "here")


def test_a_unit_that_kills_every_worker_is_told_and_the_others_go_on(two_workers, tmp_path):
    def work(task):
        if task == 1:
            os.kill(os.getpid(), signal.SIGKILL)
        return Product({f"{task}.txt": b""})

    ran = run_units([Unit(f"n{k}", "", k) for k in range(3)], work, tmp_path, two_workers, quiet)
    assert [one.name for one in ran.done] == ["n0", "n2"]
    assert "its worker process died 4 times" in ran.failures["n1"]


def test_what_the_workers_cannot_import_fails_its_unit(two_workers):
    class Elsewhere:
        def __reduce__(self):
            return (__import__, ("a_module_that_is_not_there",))

    ((_, outcome),) = two_workers.outcomes(lambda task: Product({}), [Unit("a", "", Elsewhere())])
    assert isinstance(outcome.result, Failed)
    assert "a_module_that_is_not_there" in outcome.result.reason


def test_an_address_without_a_cluster_is_told_at_once(tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    start = time.monotonic()
    for address, words in (
        (f"127.0.0.1:{port}", "nothing answers there"),
        ("nonsense", "give `local`, `auto`, or the HOST:PORT"),
        ("127.0.0.1:99999", "nothing answers there"),
    ):
        with pytest.raises(ItreeError, match=words), workers_at(address):
            pass
    assert time.monotonic() - start < PATIENCE


def test_without_ray_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ItreeError, match=r"pip install \"itree-jax\[cluster\]\""), workers_at("local"):
        pass


INTERRUPTED = """
import sys, time
from pathlib import Path
from itree_jax.cli.interrupt import heard_everywhere
from itree_jax.cluster import Product, Unit, run_units, workers_at

def main(folder):
    def work(task):
        if task:
            (folder / "started").write_text("")
            time.sleep(600.0)
        return Product({"first": b"1"})

    try:
        with heard_everywhere(), workers_at("local") as workers:
            run_units([Unit(f"n{k}", "", k) for k in range(3)], work, folder / "out", workers, lambda *said: None)
    except KeyboardInterrupt:
        return 130

sys.exit(main(Path(sys.argv[1])))
"""


def test_an_interrupted_run_keeps_what_is_done_and_leaves_nothing_else(tmp_path):
    """No process, no file of Ray's in the temporary folder, nothing in the user's home."""
    home, temporary = tmp_path / "home", Path(tempfile.mkdtemp(prefix="i-"))  # Ray's sockets need a short path
    home.mkdir()
    environment = {k: v for k, v in os.environ.items() if not k.startswith("RAY_")}
    run = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED, tmp_path], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        env={**environment, "HOME": str(home), "TMPDIR": str(temporary), "PYTHONWARNINGS": "error"},
    )  # fmt: skip
    assert appears(tmp_path / "started"), run.communicate(timeout=PATIENCE)
    assert appears(tmp_path / "out" / "units" / "n0.json")
    run.send_signal(signal.SIGINT)
    said, _ = run.communicate(timeout=PATIENCE)
    assert (run.returncode, said) == (130, "")
    assert (tmp_path / "out" / "first").read_bytes() == b"1"
    assert list(home.iterdir()) == []
    assert list(temporary.iterdir()) == []
    temporary.rmdir()
    assert str(temporary) not in subprocess.run(["ps", "axww"], capture_output=True, text=True, check=True).stdout


def test_the_command_compiles_on_a_local_cluster_and_names_what_fails(tmp_path):
    code = "import sys; from itree_jax.cli.main import main; sys.exit(main())"
    words = ["compile", "bundled:nothing", "missing.stl", "--sensor", "bundled:bench", "-o", tmp_path / "trees"]
    done = subprocess.run(
        [sys.executable, "-c", code, *words, "--cluster", "local"], capture_output=True, text=True, check=False,
        timeout=2 * PATIENCE, cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 2
    assert "2 of 2 parts failed" in done.stderr
    assert "nothing: there is no bundled part 'nothing'" in done.stderr
    assert "missing: there is no file missing.stl" in done.stderr
