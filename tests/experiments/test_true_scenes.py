"""Every n-th scene of each part comes with its own truth, and with the tree of its part and of its number of lights."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
import true_scenes as module
from true_scenes import true_scenes

LIGHTS = {1: {1: 3, 2: 4, 3: 3, 4: 4, 5: 3}, 2: {6: 4, 7: 4, 8: 3}}  # of each scene, by the part in it
DIRECTIONS = [[0, -0.6, -0.8], [-0.48, 0.36, -0.8], [0.48, 0.36, -0.8], [0, 0, -1]]
UP = np.diag([1, -1, -1]).ravel().tolist()


@pytest.fixture(scope="module")
def bins(tmp_path_factory) -> Path:
    """One instance in each scene, as far away as the scene's number says."""
    root = tmp_path_factory.mktemp("bins")
    (root / "models").mkdir()
    info = {}
    for part, scenes in LIGHTS.items():
        trimesh.creation.box((10.0 * part, 4.0, 3.0)).export(root / "models" / f"obj_{part:06d}.ply")
        info[str(part)] = {"diameter": float(part)}
        for scene, lights in scenes.items():
            write_scene(root / "test" / f"{scene:06d}", part, scene, lights)
    (root / "models" / "models_info.json").write_text(json.dumps(info))
    return root


def write_scene(folder: Path, part: int, scene: int, lights: int) -> None:
    (folder / "lit").mkdir(parents=True)
    camera = {"cam_K": [90.0, 0, 3.5, 0, 90.0, 2.5, 0, 0, 1], "cam_R_w2c": UP, "cam_t_w2c": [0, 0, 900]}
    entries = {
        "scene_camera": camera, "scene_lights": {"directions": DIRECTIONS[:lights]},
        "scene_gt": [{"obj_id": part, "cam_R_m2c": UP, "cam_t_m2c": [0, 0, 100 * scene]}],
        "scene_gt_info": [{"visib_fract": 1.0}],
    }  # fmt: skip
    for name, entry in entries.items():
        (folder / f"{name}.json").write_text(json.dumps({"0": entry}))
    for light in range(lights):
        cv2.imwrite(str(folder / "lit" / f"000000_{light:02d}.png"), np.full((6, 8), 9000, np.uint16))


@pytest.fixture
def compiled(monkeypatch) -> list[str]:
    """The compilations asked for. What is compiled and prepared stands for itself by the file's name."""
    asked = []

    def run(verb, model, _, folder, __, path, *more):
        asked.append(f"{verb} {model.name} for {folder.name}")

    monkeypatch.setattr("evaluate_scenes.run", run)
    monkeypatch.setattr(module, "load_tree", lambda path: path)
    monkeypatch.setattr(module, "prepare", lambda path: f"{path.parent.name}/{path.name}")
    return asked


@pytest.mark.parametrize("every", [1, 2, 3])
def test_a_scene_comes_with_what_is_its_own(bins, compiled, tmp_path, every):
    expected = [(part, scene, n) for part, of in LIGHTS.items() for scene, n in list(of.items())[::every]]
    found = [
        (int(one.model.diameter), one.truth.scene_id, one.prepared, one.folder.name, one.truth.pose.t[0, 2])
        for one in true_scenes(bins, tmp_path / "new" / "out", None, every)
    ]
    assert found == [
        (part, scene, f"out/obj_{part:06d}_{lights}.tree", f"{scene:06d}", 100.0 * scene)
        for part, scene, lights in expected
    ]
    first = {(part, lights): scene for part, scene, lights in reversed(expected)}
    once = {f"compile obj_{part:06d}.ply for {scene:06d}" for (part, _), scene in first.items()}
    assert sorted(compiled) == sorted(once)


def test_trees_of_an_earlier_run_are_taken_where_there_are(bins, compiled, tmp_path):
    (tmp_path / "earlier").mkdir()
    (tmp_path / "earlier" / "obj_000001_4.tree").touch()
    found = {one.prepared for one in true_scenes(bins, tmp_path / "out", tmp_path / "earlier", 1)}
    assert found == {
        "earlier/obj_000001_4.tree", "out/obj_000001_3.tree", "out/obj_000002_3.tree", "out/obj_000002_4.tree"
    }  # fmt: skip
    assert len(compiled) == 3
