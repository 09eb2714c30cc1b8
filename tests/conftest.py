"""For the whole suite: JAX that keeps what it compiled, and the paper's part compiled once."""

import getpass
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

# Before anything imports JAX. A folder per worker: two that write one entry at once would make each other warn.
_WORKER = os.environ.get("PYTEST_XDIST_WORKER", "main")
_CACHE = Path(tempfile.gettempdir()) / f"itree-jax-tests-{getpass.getuser()}" / _WORKER
_CACHE.mkdir(parents=True, exist_ok=True)
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(_CACHE))  # the commands that tests start use it too
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.1")

import jax  # noqa: E402
import pytest  # noqa: E402

jax.config.update("jax_cpu_enable_async_dispatch", False)  # no environment variable sets it

FEW_DRAWS = 20  # error rates are coarse with it, everything else is as in a real tree
# For the paper's rules: with seed 0 each of them then beats the next one by far more than its error rate is uncertain.
ENOUGH_DRAWS = 100


@pytest.fixture(scope="session")
def paper_tree_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The paper's part compiled for the pinhole camera `bundled:bench`; one file for all workers. Not to be changed."""
    return compiled_once(tmp_path_factory, "ikeuchi-1987", "bench", draws=FEW_DRAWS)


@pytest.fixture(scope="session")
def paper_tree(paper_tree_file: Path):
    """The tree in `paper_tree_file`."""
    from itree_jax.tree.tree_file import load_tree

    return load_tree(paper_tree_file)


@pytest.fixture(scope="session")
def paper_part_on_a_table(paper_tree):
    """A scene of the paper's part alone, 240 x 200 px with a depth map, and its true pose."""
    from dataclasses import replace

    import numpy as np
    from scipy.spatial.transform import Rotation

    from itree_jax.simulate.bin import Bin
    from itree_jax.simulate.imaging import image_bin

    sensor = replace(paper_tree.sensor, camera=paper_tree.sensor.camera.cropped(200, 140, 240, 200))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_euler("zx", [30, 50], degrees=True).as_matrix(), (0.0, 0.0, 25.0)
    scene, truth = image_bin(paper_tree.part, T[None], Bin((500.0, 400.0), 5.0), sensor, seed=1)
    return scene, truth[0]


@pytest.fixture(scope="session")
def tree_of_the_paper(tmp_path_factory: pytest.TempPathFactory):
    """The paper's part as the paper compiles it: orthographic camera, rules in order, regions that nothing cuts."""
    from itree_jax.tree.tree_file import load_tree

    options = {"policy": "paper", "draws": ENOUGH_DRAWS, "obj_id": 7}
    return load_tree(compiled_once(tmp_path_factory, "the-papers", "ikeuchi-1987", **options))


@pytest.fixture(scope="session")
def depth_tree_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bracket compiled for the depth camera `bundled:depth-bench`; one file for all workers. Not to be changed."""
    return compiled_once(tmp_path_factory, "depth-bracket", "depth-bench", "bracket", draws=FEW_DRAWS)


def compiled_once(
    factory: pytest.TempPathFactory, name: str, sensor: str, part: str = "ikeuchi-1987", **options
) -> Path:
    """A file with the tree of a bundled part for a bundled sensor; one for all workers."""
    base = factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base

    def compile_and_save(path: Path) -> None:
        from itree_cad.bundled import bundled_part

        from itree_jax.compile import compile_tree
        from itree_jax.sensing.bundled import bundled_sensor
        from itree_jax.tree.tree_file import save_tree

        save_tree(compile_tree(bundled_part(part), bundled_sensor(sensor), **options), path)

    return made_once(shared / f"{name}.tree", compile_and_save)


def made_once(path: Path, make: Callable[[Path], None]) -> Path:
    """`path`, made by the worker that comes first; the others wait. `make` must put it there whole."""
    lock = path.with_name(f"{path.name}.lock")
    while not path.exists():
        try:
            os.close(os.open(lock, os.O_CREAT | os.O_EXCL))
        except FileExistsError:
            time.sleep(0.1)
            continue
        try:
            if not path.exists():
                make(path)
        finally:
            lock.unlink()
    return path
