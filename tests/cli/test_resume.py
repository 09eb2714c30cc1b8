"""A run that is killed, interrupted or refused goes on where it stopped, and gives what an undisturbed one gives."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from itree_jax.detections import Detection, Detections, Step
from itree_jax.refinement.self_calibration import SelfCalibration

# Recognition that answers at once, and dies by SIGKILL at the scene whose turn it is.
KILLED = """
import os, signal, sys
from importlib import import_module
sys.path.insert(0, {tests!r})
from cli.test_resume import stand_in
count = []
def recognize_one(*given):
    count.append(1)
    if len(count) == {at}:
        os.kill(os.getpid(), signal.SIGKILL)
    return stand_in(*given)
import_module("itree_jax.recognition").recognize_one = recognize_one
from itree_jax.cli.main import main
sys.exit(main(sys.argv[1:]))
"""
SECONDS = re.compile(r'(?<="time": )[\d.]+|(?<=,)[\d.]+$|[\d.]+ s\b|data-time="[-\d.]+"', re.MULTILINE)


def stand_in(prepared, images, sensor, depth, R_w2c, second=None, picks=None):
    """One part whose place depends on the images."""
    rng = np.random.default_rng(int(1e6 * float(images.mean())))
    t = np.array([0.0, 0.0, 880.0]) + rng.normal(0.0, 5.0, 3)
    step = Step(0, "L1", {"area": np.float32(1.5)}, [1.0], np.inf, "any", "S1")
    one = Detection(0, 0, prepared[0].tree.obj_id, 0.5, np.eye(3), t, (step,), height=np.nan)
    lost = ({"region": 3, "reason": "none fits", "height_mm": np.nan, "uv": [10.0, 10.0], "pixels": 5},)
    labels = np.full(images.shape[1:], -1, np.int32)
    return Detections((one,), time=rng.uniform(1.0, 2.0), labels=labels, not_recognised=lost, depth=depth)


@pytest.fixture
def scenes(bin_dataset, tmp_path) -> Path:
    """Two scenes; in the second one light 0 was weaker."""
    import cv2

    for k in range(2):
        folder = shutil.copytree(bin_dataset / "test" / "000042", tmp_path / "scenes" / f"{k + 1:06d}")
        path = str(folder / "lit" / "000000_00.png")
        cv2.imwrite(path, (cv2.imread(path, cv2.IMREAD_UNCHANGED) * (1.0 - 0.01 * k)).astype(np.uint16))
    return tmp_path / "scenes"


@pytest.fixture
def asked(monkeypatch) -> list[float]:
    """The scenes that were recognised in this process, by the mean of their images."""
    seen = []

    def recognize_one(prepared, images, *rest):
        seen.append(float(images.mean()))
        return stand_in(prepared, images, *rest)

    monkeypatch.setattr(import_module("itree_jax.recognition"), "recognize_one", recognize_one)
    return seen


def words(scenes, tree, out):
    out.mkdir(exist_ok=True)
    more = ["--json", out / "r.json", "--report", out / "pages", "--world", out / "models"]
    return ["recognize", scenes, tree, "-o", out / "r.csv", *more]


def outputs(folder) -> dict[str, bytes]:
    """Every file, its seconds taken out."""
    found = {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    texts = (".csv", ".json", ".html")
    return {name: SECONDS.sub("?", data.decode()).encode() if name.endswith(texts) else data
            for name, data in found.items()}  # fmt: skip


def killed_at(at: int, command) -> None:
    program = KILLED.format(tests=str(Path(__file__).parents[1]), at=at)
    done = subprocess.run(
        [sys.executable, "-c", program, *map(str, command)], capture_output=True, timeout=240, check=False,
        env={**os.environ, "JAX_PLATFORMS": "cpu"},
    )  # fmt: skip
    assert done.returncode == -signal.SIGKILL, done.stderr


def test_a_killed_run_goes_on_and_gives_the_same_bytes(itree, asked, scenes, paper_tree_file, tmp_path):
    whole, stopped = tmp_path / "whole", tmp_path / "stopped"
    assert itree(*words(scenes, paper_tree_file, whole)).code == 0
    assert len(asked) == 2
    killed_at(2, [*words(scenes, paper_tree_file, stopped), "--resume"])
    assert [p.name for p in stopped.iterdir()] == ["r.csv.progress"]
    ran = itree(*words(scenes, paper_tree_file, stopped), "--resume")
    assert (ran.code, ran.err) == (0, "")
    assert asked[2:] == asked[1:2]  # the last scene alone
    expected = outputs(whole)
    some = {"r.csv", "r.json", "pages/index.html", "pages/scene_000002.html", "models/scene_000001.glb"}
    assert set(expected) >= some
    assert outputs(stopped) == expected


def test_without_resume_a_killed_run_leaves_nothing_that_counts(itree, asked, scenes, paper_tree_file, tmp_path):
    out = tmp_path / "out"
    command = words(scenes, paper_tree_file, out)[:7]
    killed_at(2, command)
    assert [p.name[:7] for p in out.iterdir()] == [".r.csv."]
    assert itree(*command).code == 0
    assert sorted(p.name for p in out.iterdir()) == ["r.csv", "r.json"]


def test_a_scene_that_was_mended_or_changed_is_done_again(itree, asked, scenes, paper_tree_file, tmp_path):
    lights = scenes / "000002" / "scene_lights.json"
    good = lights.read_text()
    lights.write_text("{")
    command = ["recognize", scenes, paper_tree_file, "-o", tmp_path / "r.csv", "--resume"]
    ran = itree(*command)
    assert (ran.code, ran.out) == (2, "")
    assert "Nothing was written. The scenes before it are kept for --resume in" in ran.err
    assert len(asked) == 1
    lights.write_text(good)
    (scenes / "000001" / "scene_lights.json").write_text(good + "\n")  # another file now
    assert itree(*command).code == 0
    assert len(asked) == 3
    assert not (tmp_path / "r.csv.progress").exists()


def test_what_another_run_kept_is_not_gone_on_with(itree, asked, scenes, paper_tree, paper_tree_file, tmp_path):
    from dataclasses import replace

    from itree_jax.tree.tree_file import save_tree

    (scenes / "000002" / "scene_lights.json").write_text("{")
    command = ["recognize", scenes, paper_tree_file, "-o", tmp_path / "r.csv", "--resume"]
    assert itree(*command).code == 2
    ran = itree(*command, "--depth", "none")
    assert ran.code == 2
    assert "r.csv.progress keeps the scenes of a run that was stopped, with other options" in ran.err
    save_tree(replace(paper_tree, seed=paper_tree.seed + 1), tmp_path / "other.tree")
    ran = itree(*command[:2], tmp_path / "other.tree", *command[3:])
    assert "with other trees" in ran.err
    record = tmp_path / "r.csv.progress" / "scenes" / "000001.json"
    record.write_text('{"key": 3}')  # not what was kept: that scene is done again
    count = len(asked)
    assert itree(*command).code == 2
    assert len(asked) == count + 1


def test_corrected_lights_are_kept_as_they_are(itree, asked, scenes, paper_tree_file, tmp_path, monkeypatch):
    def calibrated(found, trees, images, sensor, depth):
        rng = np.random.default_rng(int(1e6 * float(images.mean())))
        e, std = sensor.light_intensities * rng.uniform(0.9, 1.1, 3), rng.uniform(0.01, 0.02, 3)
        return SelfCalibration(
            sensor, sensor, False, sensor.light_directions, e, std, std, 0.2, np.nan, (0.7,), (), 0.0, 0.005, 9, ("x",)
        )  # fmt: skip

    monkeypatch.setattr("itree_jax.refinement.self_calibration.calibrated_by_answers", calibrated)
    command = ["recognize", scenes, paper_tree_file, "--self-calibrate"]
    whole = itree(*command, "-o", tmp_path / "a.csv")
    lights = scenes / "000002" / "scene_lights.json"
    good = lights.read_text()
    lights.write_text("{")
    assert itree(*command, "-o", tmp_path / "b.csv", "--resume").code == 2
    lights.write_text(good)
    ran = itree(*command, "-o", tmp_path / "b.csv", "--resume")
    assert len(asked) == 4
    assert SECONDS.sub("?", ran.out) == SECONDS.sub("?", whole.out)
    assert (tmp_path / "b.lights.json").read_text() == (tmp_path / "a.lights.json").read_text()
    assert set(json.loads((tmp_path / "a.lights.json").read_text())["scenes"]) == {"000001", "000002"}
