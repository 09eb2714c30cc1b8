"""Every writer of the project: what it writes is whole or not there, on a full disk and when it is interrupted."""

import os
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from itree_cad.load import save_stl
from itree_kernels.errors import ItreeError

from itree_jax.detections import Detection, Detections
from itree_jax.grasp import write_grasps
from itree_jax.report.markup import write_page
from itree_jax.report.svg_file import write_svg_tree
from itree_jax.report.world_files import write_world
from itree_jax.results import write_bop_csv, write_json
from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.needle_files import write_needle_map
from itree_jax.sensing.scene_folder import Scene
from itree_jax.sensing.scene_writer import write_scene
from itree_jax.sensing.sensor_file import save_sensor
from itree_jax.simulate.clear_tables import write_tables
from itree_jax.simulate.dataset import write_model
from itree_jax.tree.tree_file import save_tree
from itree_jax.world.bin_walls import BinWalls, write_bin

from .grasp.worlds import placed, pose, world
from .kernels.test_whole_files import full_disk
from .primitives import box_part

ROOT = Path(__file__).parents[1]
SOURCES = [path for package in ("itree_jax", "kernels", "cad") for path in (ROOT / package).rglob("*.py")]
PART = box_part(40.0, 30.0, 20.0)
ANSWERS = [Detections((Detection(1, 0, 1, 0.5, np.eye(3), np.array([0.0, 0.0, 900.0])),), 1.0, 1)]
BIN = BinWalls((100.0, 80.0), 40.0, 5.0, np.eye(4))
H, W = 3, 4


def needles() -> NeedleMap:
    flat, lights = np.zeros((H, W), np.float32), np.zeros((3, H, W), bool)
    normals = np.tile(np.float32([0, 0, -1]), (H, W, 1))
    return NeedleMap(normals, flat, flat == 0, lights, lights, flat, flat, flat, lights.astype(np.float32), lights)


def scene() -> Scene:
    images = np.zeros((3, H, W), np.float32)
    return Scene(1, 0, images, None, bundled_sensor("bench"), np.eye(3), None, np.zeros(3))


WRITERS: dict[str, Callable[[Path], object]] = {
    "csv": lambda at: write_bop_csv(ANSWERS, at / "r.csv"),
    "json": lambda at: write_json(ANSWERS, at / "r.json"),
    "grasps": lambda at: write_grasps([], at / "g.json"),
    "page": lambda at: write_page(at / "new" / "p.html", "title", "body"),
    "sensor": lambda at: save_sensor(bundled_sensor("bench"), at / "s.json"),
    "stl": lambda at: save_stl(PART, at / "p.stl"),
    "scene": lambda at: write_scene(at / "000001", scene()),
    "needles": lambda at: write_needle_map(at, needles(), np.ones((H, W), bool)),
    "bin": lambda at: write_bin(BIN, at),
    "model": lambda at: write_model(PART, 1, at / "models"),
    "world": lambda at: write_world(world([placed(0, PART, pose(0, 0, 10))]), at, "w"),
    "cleared": lambda at: write_tables([], "jaw", ["box"], at),
}


def files_in(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def writes_whole_or_not(write: Callable[[Path], object], folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On an empty folder: nothing; on one that has been written to: what was there."""
    def interrupt(*_):
        raise KeyboardInterrupt

    for before in (False, True):
        if before:
            write(folder)
        there = files_in(folder)
        assert bool(there) == before
        with full_disk(), pytest.raises(ItreeError, match=r"cannot be written|exists already"):
            write(folder)
        assert files_in(folder) == there
        with monkeypatch.context() as patched:
            for call in ("fsync", "replace"):
                patched.setattr(os, call, interrupt)
            with pytest.raises((KeyboardInterrupt, ItreeError)):
                write(folder)
        assert files_in(folder) == there


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_and_an_interrupt_leave_nothing_half_written(name, tmp_path, monkeypatch):
    writes_whole_or_not(WRITERS[name], tmp_path, monkeypatch)


@pytest.mark.parametrize("write", [save_tree, lambda tree, path: write_svg_tree(path, tree)], ids=["tree", "svg"])
def test_so_do_those_of_trees(write, paper_tree, tmp_path, monkeypatch):
    writes_whole_or_not(lambda at: write(paper_tree, at / "a"), tmp_path, monkeypatch)


def test_no_module_writes_to_a_disk_by_itself():
    """Inside the block of `whole_folder` and `whole_entries` it may."""
    direct = re.compile(r"write_text\(|write_bytes\(|open\([^)]*[\"'][wax]b?[\"']|\.export\((?!file_type)"
                        r"|np\.save\((?!out)|imwrite\(|os\.replace\(|mkstemp|NamedTemporaryFile")  # fmt: skip
    found = {path.name for path in SOURCES if direct.search(path.read_text(encoding="utf-8"))}
    # of meshes.py a docstring, of step_reader.py a temporary file
    assert found == {"whole_files.py", "scene_writer.py", "meshes.py", "step_reader.py"}
