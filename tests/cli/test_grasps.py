"""`itree recognize --gripper --grasps`, and the messages when one of them is missing."""

import json
from importlib import import_module

import numpy as np
import pytest

from itree_jax.detections import Detection, Detections
from itree_jax.sensing.scene_folder import load_scene
from itree_jax.simulate import bundled_poses
from itree_jax.simulate.bin import camera_above


@pytest.fixture
def true_answers(monkeypatch):
    """Recognition that answers with the true poses of the demo's bin."""

    def recognize_one(prepared, images, sensor, depth, R_w2c, second=None, picks=None):
        T = camera_above(sensor) @ bundled_poses().T_bin_obj
        found = tuple(
            Detection(0, 0, prepared[0].tree.obj_id, 0.9, one[:3, :3], one[:3, 3], offer_rank=k)
            for k, one in enumerate(T)
        )
        return Detections(found, time=1.0, labels=np.full((480, 640), -1, np.int32))

    monkeypatch.setattr(import_module("itree_jax.recognition"), "recognize_one", recognize_one)


def test_grasps_are_written_in_both_frames(itree, bin_dataset, paper_tree_file, true_answers, tmp_path):
    pose = {"R": [1, 0, 0, 0, -1, 0, 0, 0, -1], "t": [0, 0, 900]}
    (tmp_path / "hand_eye.json").write_text(json.dumps(pose))
    ran = itree("recognize", bin_dataset, paper_tree_file, "-o", tmp_path / "r.csv", "--gripper", "bundled:jaw",
                "--hand-eye", tmp_path / "hand_eye.json", "--grasps", tmp_path / "g.json")  # fmt: skip
    assert ran.code == 0, ran.err
    (image,) = json.loads((tmp_path / "g.json").read_text())["images"]
    assert image["scene_id"] == 42
    best = image["grasps"][0]
    T_cam, T_robot = (np.reshape(best[name], (4, 4)) for name in ("T_cam_grasp", "T_robot_grasp"))
    np.testing.assert_allclose(T_robot[:3, 3], [T_cam[0, 3], -T_cam[1, 3], 900 - T_cam[2, 3]])
    assert T_robot[2, 2] < -np.cos(np.radians(50.0))  # from above
    told = {g["offer_rank"] for g in image["grasps"]} | {p["offer_rank"] for p in image["parts_without"]}
    assert told == set(range(len(bundled_poses().T_bin_obj)))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--gripper", "bundled:jaw"], "--gripper and --grasps belong together"),
        (["--grasps", "g.json"], "--gripper and --grasps belong together"),
        (["--hand-eye", "h.json"], "--hand-eye needs --gripper"),
        (["--gripper", "bundled:claw", "--grasps", "{out}/g.json"], "no bundled gripper is called 'claw'"),
    ],
)
def test_what_is_missing_is_said_before_any_work(itree, bin_dataset, paper_tree_file, tmp_path, words, message):
    words = [word.format(out=tmp_path) for word in words]
    ran = itree("recognize", bin_dataset, paper_tree_file, "-o", tmp_path / "r.csv", *words)
    assert ran.code == 2
    assert message in ran.err
    assert not list(tmp_path.iterdir())


def test_a_simulated_scene_tells_its_bin(itree, tmp_path):
    from itree_jax.world import load_bin

    pytest.importorskip("mujoco")
    ran = itree("simulate", "bundled:plate", "--sensor", "bundled:bench", "--scenes", 1, "--parts", 1, "-o",
                tmp_path / "d")  # fmt: skip
    assert ran.code == 0, ran.err
    scene = load_scene(tmp_path / "d" / "test" / "000001")
    walls = load_bin(scene)
    np.testing.assert_allclose(walls.T_cam_bin, camera_above(scene.sensor), atol=1e-9)
