"""The page of a scene: complete, self-contained, the same bytes twice."""

import json
from dataclasses import replace

import numpy as np
import pytest
from itree_kernels.errors import ItreeError

from itree_jax.detections import Alternative, Detections, Unobservable
from itree_jax.report.scene_page import write_scene_report
from itree_jax.report.truth_view import TruePose, compare, true_poses

MOST_BYTES = 3_000_000  # for 640 x 480 px


def written(path, *arguments) -> str:
    write_scene_report(path, *arguments)
    return path.read_text(encoding="utf-8")


def test_every_answer_is_there_with_its_path_drawn(tmp_path, scene, detections, tree, self_contained):
    page = self_contained(written(tmp_path / "new" / "s.html", scene, detections, [tree]))
    assert page.count("details") == page.count("svg", "tree has-path") == len(detections) == 2
    assert [a["id"] for t, a in page.tags if t == "details"] == ["pose-0", "pose-1"]
    for d in detections:
        assert f"{d.score:.3f}" in page.text
    assert page.count("svg", "strip") == 2 * 2  # two measured quantities of one two-sided step, in two answers
    assert page.text.count("▼ margin \N{MINUS SIGN}1.25 nat") == 2
    assert "∞" in page.text  # the direction that nothing binds
    # one for each light; overlay, residuals, those of needles and depth, the world; needles twice and their legend,
    # depth, edges, regions; one for each pose
    assert page.count("img") == 3 + 8 + 3 + 2
    assert "Scene 7, image 0" in page.text
    assert "0.5 s" in page.text


def test_text_is_escaped(tmp_path, scene, detections, tree, self_contained):
    name = "a<b>&\"c'</title>"
    odd = replace(tree, part=replace(tree.part, name=name))
    page = self_contained(written(tmp_path / "s.html", scene, detections, [odd]))
    assert name in page.text
    assert detections.not_recognised[0]["reason"] in page.text
    assert "<free>" in page.text


def test_the_same_input_gives_the_same_bytes_and_leaves_nothing_else(tmp_path, scene, detections, tree):
    for name in ("a.html", "b.html"):
        write_scene_report(tmp_path / name, scene, detections, [tree])
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.html", "b.html"]


def test_a_scene_of_full_size_stays_under_three_megabytes(tmp_path, scene, detections, tree):
    """Noise of a camera is the worst that image compression meets."""
    camera = replace(scene.sensor.camera, fx=4.0, fy=4.0, cx=319.5, cy=239.5, width=640, height=480)
    rng = np.random.default_rng(0)
    images = rng.uniform(0.0, 1.0, (3, 480, 640)).astype(np.float32)
    depth = rng.uniform(400.0, 500.0, (480, 640)).astype(np.float32)
    large = replace(scene, images=images, depth=depth, sensor=replace(scene.sensor, camera=camera))
    answers = replace(detections, labels=None)
    assert len(written(tmp_path / "s.html", large, answers, [tree]).encode()) < MOST_BYTES


def test_a_scene_without_answers_says_why(tmp_path, scene, detections, tree, self_contained):
    nothing = Detections((), labels=detections.labels, not_recognised=detections.not_recognised)
    page = self_contained(written(tmp_path / "s.html", scene, nothing, [tree]))
    assert page.count("details") == 0
    assert "No part was recognised" in page.text
    assert detections.not_recognised[0]["reason"] in page.text
    assert "not measured" in page.text


def test_what_is_missing_is_left_out(tmp_path, scene, detections, tree, self_contained):
    """No depth map, no regions, a pose outside of the image, an answer without path or uncertainty."""
    first, second = detections
    bare = replace(first, decision_path=(), rotation_std=None, translation_std=None)
    outside = replace(second, t_cam_obj=np.array([900.0, 0.0, 500.0]))
    page = self_contained(written(tmp_path / "s.html", replace(scene, depth=None), Detections((bare, outside)), [tree]))
    for said in ("no depth map", "carry no regions", "outside of the image", "no decision path"):
        assert said in page.text
    assert page.count("svg", "tree") == 2
    assert page.count("svg", "tree has-path") == 1


def test_what_the_scene_does_not_tell_is_said(tmp_path, scene, detections, tree, self_contained):
    first, second = detections
    lost = Unobservable(np.eye(6)[5], "distance from the camera", 12.0)
    doubtful = replace(first, unobservable=(lost,), alternatives=(Alternative(first.T_cam_obj, 0.25),))
    both = replace(detections, detections=(doubtful, second))
    page = self_contained(written(tmp_path / "s.html", scene, both, [tree]))
    assert page.text.count("not measured: distance from the camera") == 1
    assert page.text.count("ambiguous: 2 poses") == 1
    assert "belief 75 % for this one, 25 % for the others" in page.text


def test_the_truth_is_compared(tmp_path, scene, detections, tree, poses, self_contained):
    truth = [(tree.obj_id, poses[0][0], poses[1][0]), (tree.obj_id, poses[0][1], poses[1][1] + [0.0, 30.0, 0.0])]
    page = self_contained(written(tmp_path / "s.html", scene, detections, [tree], truth))
    assert "1 of 2" in page.text
    assert page.text.count("✓ right") == 1
    assert page.text.count("30.0✗ wrong") == 1
    assert "true poses that were not found" in page.text


def test_a_part_without_its_tree_is_an_error(tmp_path, scene, detections, tree):
    with pytest.raises(ItreeError, match=r"of the parts \[1\], the trees of \[5\]"):
        write_scene_report(tmp_path / "s.html", scene, detections, [replace(tree, obj_id=5)])
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written_is_an_error(tmp_path, scene, detections, tree):
    (tmp_path / "file").write_text("")
    with pytest.raises(ItreeError, match="its folder cannot be made"):
        write_scene_report(tmp_path / "file" / "s.html", scene, detections, [tree])


def test_the_truth_of_a_scene_s_folder_is_read(tmp_path, scene, poses):
    entries = [
        {"obj_id": 1, "cam_R_m2c": R.ravel().tolist(), "cam_t_m2c": t.tolist()} for R, t in zip(*poses, strict=True)
    ]
    there = replace(scene, folder=tmp_path, im_id=2)
    assert true_poses(scene) is None
    assert true_poses(there) is None
    (tmp_path / "scene_gt.json").write_text(json.dumps({"2": entries}))
    found = true_poses(there)
    assert [pose.visible for pose in found] == [1.0, 1.0]
    np.testing.assert_array_equal(found[1].R, poses[0][1])
    np.testing.assert_array_equal(found[1].t, poses[1][1])
    (tmp_path / "scene_gt_info.json").write_text(json.dumps({"2": [{"visib_fract": 0.25}, {}]}))
    assert [pose.visible for pose in true_poses(there)] == [0.25, 1.0]
    for wrong in ({"2": [{"obj_id": 1}] * 2}, {"2": entries[:1]}, []):
        (tmp_path / "scene_gt.json").write_text(json.dumps(wrong))
        with pytest.raises(ItreeError, match=r"scene_gt\.json: true poses as obj_id"):
            true_poses(there)


def test_an_ambiguous_answer_whose_other_pose_is_right_is_neither_right_nor_wrong(scene, detections, tree, poses):
    first, second = detections
    turned = replace(first, t_cam_obj=first.t_cam_obj + 30.0, alternatives=(Alternative(first.T_cam_obj, 0.4),))
    truth = [TruePose(tree.obj_id, R, t) for R, t in zip(*poses, strict=True)]
    result = compare([turned, second], truth, {tree.obj_id: tree})
    assert (result.found, result.other_right, result.wrong) == ((-1, 1), (True, False), 0)
    sure = replace(turned, alternatives=())
    assert compare([sure, second], truth, {tree.obj_id: tree}).wrong == 1
