"""Tables and pictures of recognition's quality: every kind of failure is told, and every one is shown."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from itree_kernels.camera import Camera
from itree_kernels.mesh import ray_mesh
from quality.attitude_groups import GroupPair, group_confusion, true_groups
from quality.comparison import comparison_table
from quality.confusion_figure import confusion_picture, confusion_table
from quality.failure_pictures import GAP, failure_picture
from quality.failures import Kind, failures_of, part_shape
from quality.gallery import Card, write_gallery
from quality.path_words import against_count, path_in_words
from quality.reliability_figure import reliability_diagram
from quality.reliability_tables import bin_table
from quality.true_view import pieces_on, region_owners, shares_on_instances, true_view
from scipy.spatial.transform import Rotation

from itree_jax.evaluation.judged import JudgedScene
from itree_jax.evaluation.matching import match
from itree_jax.evaluation.pose_errors import Pose, PoseErrors, mssd
from itree_jax.evaluation.reliability import equal_bins, equal_count_bins
from itree_jax.evaluation.report import Report, SceneCounts, summarise
from itree_jax.evaluation.symmetry import symmetry_set
from itree_jax.evaluation.truth import SceneTruth
from itree_jax.results import BopResults
from itree_jax.tree.tree import InterpretationTree

from ..primitives import box_part

CAMERA = Camera("pinhole", 900.0, 900.0, 79.5, 59.5, 160, 120)
BOX = box_part(60.0, 40.0, 25.0)
SHAPE = part_shape(BOX)
MESH = ray_mesh(BOX.vertices, BOX.triangles, BOX.face_of_triangle)
MIDDLE = 0.5 * (BOX.vertices.min(axis=0) + BOX.vertices.max(axis=0))
HALF_TURN = np.diag([1.0, -1.0, -1.0])
STEP = {
    "node": 0, "rule": "L1", "measured": {}, "compared_with": {"taken": "visible", "branch": "B0", "error_rate": 0.05},
    "margin": -1.5, "freedom_before": "3 attitude groups", "freedom_after": "1 attitude group",
}  # fmt: skip
LAST = {
    "node": 9, "rule": "verification", "measured": {"evidence": 90.0}, "compared_with": {"rivals": [80.0]},
    "margin": 10.0, "freedom_before": "2 poses that look the same here", "freedom_after": "ambiguous",
}  # fmt: skip


def about(R, x: float) -> tuple[np.ndarray, np.ndarray]:
    """A box turned by R, its middle on the line x at 900 mm."""
    return R, np.array([x, 0.0, 900.0]) - R @ MIDDLE


def judged(true, answered, visible=None) -> JudgedScene:
    """A scene of boxes that no symmetry maps onto themselves, scores falling from 0.9."""
    n, m = len(answered), len(true)
    R, t = (np.array(a) for a in zip(*answered, strict=True)) if n else (np.zeros((0, 3, 3)), np.zeros((0, 3)))
    R_true, t_true = (np.array(a) for a in zip(*true, strict=True))
    score = 0.9 - 0.01 * np.arange(n)
    error = mssd(Pose(R[:, None], t[:, None]), Pose(R_true[None], t_true[None]), SHAPE.hull, symmetry_set({}))
    errors = PoseErrors(error / SHAPE.diameter, np.zeros((n, m)), np.zeros((n, m)))
    scene = SceneTruth(
        7, np.ones(m, np.int64), Pose(R_true, t_true), np.ones(m) if visible is None else visible, CAMERA,
        ("all", "level B", "part box"),
    )  # fmt: skip
    answers = BopResults(np.full(n, 7), np.zeros(n, np.int64), np.ones(n, np.int64), score, R, t, np.ones(n))
    return JudgedScene(scene, answers, errors, match(errors.mssd, score, 0.05))


def test_each_kind_of_failure_is_told():
    identity = np.eye(3)
    true = [about(identity, -90.0), about(identity, 0.0), about(identity, 90.0), about(identity, 200.0)]
    tilted = Rotation.from_euler("z", 40, degrees=True).as_matrix()
    R, t = about(identity, 0.0)
    answered = [
        about(identity, -90.0), about(identity, -90.5), (R, t + np.array([0.07 * SHAPE.diameter, 0.0, 0.0])),
        about(HALF_TURN, 91.0), about(tilted, 200.0), about(identity, 500.0),
    ]  # fmt: skip
    scene = judged(true, answered)
    lies_on = np.eye(6, 4)
    lies_on[4] = [0.0, 0.0, 0.0, 0.9]
    found = {f.answer: (f.kind, f.instance) for f in failures_of(scene, {1: SHAPE}, lies_on, np.zeros(0, np.int64))}
    assert found == {
        1: (Kind.SECOND, 0), 2: (Kind.OFF, 1), 3: (Kind.TURNED, 2), 4: (Kind.ATTITUDE, 3), 5: (Kind.NOTHING, None),
    }  # fmt: skip


def test_missed_instances_are_told_by_their_regions_once():
    scene = judged([about(np.eye(3), x) for x in (-90.0, 0.0, 90.0)], [], np.array([1.0, 0.8, 0.5]))
    found = failures_of(scene, {1: SHAPE}, np.zeros((0, 3)), np.array([1, -1, 2]))
    assert [(f.kind, f.instance) for f in found] == [(Kind.MISSED_WITHOUT_REGION, 0), (Kind.MISSED_WITH_REGION, 1)]


def test_the_nearer_instance_is_seen_and_the_regions_on_it_are_its():
    near, far = about(np.eye(3), 0.0), (np.eye(3), about(np.eye(3), 5.0)[1] + np.array([0.0, 0.0, 100.0]))
    scene = judged([far, near], [near])
    view = true_view(scene.truth, {1: MESH})
    assert view.instance[60, 80] == 1
    assert np.isinf(view.depth[0, 0])
    assert view.depth[60, 80] == pytest.approx(900.0 - 12.5, abs=0.01)
    shares = shares_on_instances([view.rendered[1], view.rendered[0], None], view)
    assert shares[0].tolist() == [0.0, 1.0]
    assert shares[1] == pytest.approx([1.0, 0.0])  # what shows of it
    assert shares[2].tolist() == [0.0, 0.0]
    labels = np.where(view.instance == 1, 0, -1)
    labels[:, :30] = 1
    np.testing.assert_array_equal(region_owners(labels, view.instance), [1, -1])
    (piece,) = pieces_on(labels, view.instance, 1)
    assert piece.on_instance == piece.whole == (labels == 0).sum()


def test_no_regions_have_no_owners():
    assert len(region_owners(np.full((4, 5), -1), np.full((4, 5), -1))) == 0


@given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), min_size=1, max_size=30))
def test_confusion_counts_every_pair(pairs):
    confusion = group_confusion([GroupPair(a, b, a == b, 2) for a, b in pairs], 5)
    assert confusion.counts.sum() == len(pairs) == confusion.first.total
    assert np.trace(confusion.counts) == confusion.first.count == confusion.left.count
    labels = [f"g{k}" for k in range(5)]
    assert confusion_picture(confusion, labels, "pairs").count("fill-opacity") == np.count_nonzero(confusion.counts)
    assert confusion_table(confusion, labels).count("\n") == 2 + len(confusion.used)


def test_representative_attitudes_show_their_own_group(paper_tree: InterpretationTree):
    groups, part = paper_tree.groups, paper_tree.part
    kept = np.flatnonzero(~groups.pruned)
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle)
    R = groups.representative_rotations()[kept]
    t = np.tile([0.0, 0.0, 900.0], (len(kept), 1)) - R @ part.vertices.mean(axis=0)  # on the axis: the ray is z
    np.testing.assert_array_equal(true_groups(paper_tree, mesh, Pose(R, t), paper_tree.sensor.camera), kept)


def test_steps_are_said_with_what_stood_against_them():
    first, last = path_in_words([STEP, LAST])
    assert "against this rule" in first
    assert "3 attitude groups → 1 attitude group" in first
    assert "evidence 90 against 80" in last
    assert against_count([STEP, LAST]) == 1


@pytest.mark.parametrize("count", [0, 1, 200])
def test_diagram_and_table_show_every_bin(count: int):
    score = np.linspace(0.0, 1.0, count)
    right = score > 0.5
    width, equal = equal_bins(score, right), equal_count_bins(score, right)
    drawn = reliability_diagram(width, equal, "Reliability")
    assert drawn.count("<g>") == sum(b.right.total > 0 for b in [*width, *equal])
    assert "nan" not in drawn
    table = bin_table(width)
    assert table.count("\n") == 2 + sum(b.right.total > 0 for b in width)


def test_configurations_stand_beside_each_other_per_level():
    counts = SceneCounts(4, 3, True, 2, 3, 3, 4, 3, 4, (1,) * 10, (1,) * 10, (0.001,), (0.1,), 2.0)
    groups = Report({"all": summarise([counts]), "level A": summarise([counts])}, 0).to_json()["groups"]
    table = comparison_table({"as it is": groups, "without edges": {"all": groups["all"]}})
    rows = [line.split(" | ")[:2] for line in table.splitlines()[2:]]
    assert rows == [["| all", "as it is"], ["| all", "without edges"], ["| level A", "as it is"]]
    assert "67 % (21-94)" in table


def test_gallery_holds_every_failure(tmp_path: Path):
    true = [about(np.eye(3), -20.0), about(np.eye(3), 30.0)]
    scene = judged(true, [about(HALF_TURN, 30.0)])
    view = true_view(scene.truth, {1: MESH})
    background = np.full((120, 160, 3), 90, np.uint8)
    said = {"pixels": {"agreeing": 5, "contradicting": 1, "hidden": 0}, "equivalents": [], "decision_path": [STEP]}
    failures = failures_of(scene, {1: SHAPE}, shares_on_instances([None], view), np.zeros(0, np.int64))
    cards = [
        Card(f, scene, failure_picture(background, f, scene, view, {1: MESH}), said, ["Nothing to see."])
        for f in failures
    ]
    assert [f.kind for f in failures] == [Kind.TURNED, Kind.MISSED_WITHOUT_REGION]
    gaps = [int((c.picture == 128).all(axis=(0, 2)).sum()) for c in cards]
    assert gaps == [2 * GAP, GAP]  # three panels and two
    write_gallery(tmp_path / "failures.html", "Failures", [scene], cards)
    page = (tmp_path / "failures.html").read_text(encoding="utf-8")
    assert page.count("<article") == 2
    assert "against this rule" in page
    assert "Nothing to see." in page
    assert not re.search(r"https?://|\bnan\b", re.sub(r'base64,[^"]+', "", page))
