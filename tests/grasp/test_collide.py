"""Laws of grasps in the world: free space, more obstacles, a moved camera, and a twin that samples points."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from itree_kernels.errors import ItreeError
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from itree_jax.detections import Detections
from itree_jax.grasp import find_grasps, grasp_table, load_gripper, write_grasps
from itree_jax.grasp.body import TOUCH, gripper_body
from itree_jax.grasp.collide import OPEN_SPACE, Obstacles
from itree_jax.grasp.plan import NO_PART, tried_grasps
from itree_jax.grasp.rank import fits
from itree_jax.grasp.results import SCHEMA_PATH
from itree_jax.world import BinWalls, world_meshes

from ..primitives import box_part, cylinder_part
from ..test_results import violations
from .worlds import DOWN, FLOOR, moved, placed, pose, prism, world

JAW, CUP = load_gripper("bundled:jaw"), load_gripper("bundled:cup")
BOX, ROD = box_part(40.0, 30.0, 20.0), cylinder_part(10.0, 50.0)
TABLES = {"jaw": {1: grasp_table(BOX, JAW)}, "cup": {1: grasp_table(BOX, CUP)}}
WALLS = BinWalls((150.0, 120.0), 30.0, 4.0, pose(0.0, 0.0, 0.0))
seeds = st.integers(0, 2**32 - 1)


def some_world(seed: int, prisms: int = 3):
    """Two boxes lying apart and prisms around them, in a bin."""
    rng = np.random.default_rng(seed)
    parts = [placed(k, BOX, pose(40.0 * side, rng.uniform(-20, 20), 10.0, (0, 0, rng.uniform(0, 180))))
             for k, side in enumerate((-1, 1))]  # fmt: skip
    around = [prism(*rng.uniform(-60, 60, 2), rng.uniform(5, 40), rng.uniform(3, 15), k) for k in range(prisms)]
    return world(parts, around, WALLS)


def verdicts(one, tables) -> list:
    return [(t.verdict is None, t.free) for t in tried_grasps(one, tables)]


@pytest.mark.parametrize("gripper", [JAW, CUP], ids=["jaw", "cup"])
def test_in_free_space_nothing_collides(gripper):
    rng = np.random.default_rng(0)
    alone = Obstacles([])
    for R in Rotation.random(5, rng=rng).as_matrix():
        T = np.eye(4)
        T[:3, :3] = R
        verdict = alone.verdict(gripper, 20.0, T)
        assert (verdict.hit, verdict.clearance) == ("", OPEN_SPACE)
    far = world([placed(0, BOX, pose(0, 0, 10.0)), placed(1, BOX, pose(900.0, 0, 10.0))])
    some = [t for t in tried_grasps(far, {1: grasp_table(BOX, gripper)}) if t.verdict is not None]
    assert any(t.free for t in some)


@pytest.mark.parametrize("kind", ["jaw", "cup"])
@given(seed=seeds)
@settings(deadline=None, max_examples=8)
def test_an_obstacle_more_never_frees_a_grasp(kind, seed):
    few, more = some_world(seed, 2), some_world(seed, 4)
    assert [p.top for p in more.prisms[:2]] == [p.top for p in few.prisms]
    before, after = tried_grasps(few, TABLES[kind]), tried_grasps(more, TABLES[kind])
    for one, other in zip(before, after, strict=True):
        assert one.free or not other.free
        if one.free and other.free:
            assert other.verdict.clearance <= one.verdict.clearance + 1e-3


@given(seeds)
@settings(deadline=None, max_examples=8)
def test_moving_the_world_and_the_camera_together_changes_no_verdict(seed):
    one = some_world(seed)
    rng = np.random.default_rng(seed)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.random(rng=rng).as_matrix(), rng.uniform(-300, 300, 3)
    for here, there in zip(tried_grasps(one, TABLES["jaw"]), tried_grasps(moved(one, T), TABLES["jaw"]), strict=True):
        assert (here.verdict is None) == (there.verdict is None)
        if here.verdict is None:
            continue
        np.testing.assert_allclose(T @ here.T_cam_grasp, there.T_cam_grasp, atol=1e-6)
        margin = max(here.verdict.clearance, there.verdict.clearance) - JAW.clearance
        assert here.free == there.free or abs(margin) < 1e-2  # on the very limit, rounding may decide
        if here.free and there.free:
            assert here.verdict.clearance == pytest.approx(there.verdict.clearance, abs=1e-2)


@pytest.mark.parametrize("seed", range(3))
def test_the_library_agrees_with_points_sampled_in_all_solids(seed):
    """Twin: points of the gripper's sweep in the half spaces of the convex obstacles."""
    one = some_world(seed, 4)
    rng = np.random.default_rng(seed)
    solids = {m.name: ConvexHull(np.asarray(m.mesh.vertices)).equations for m in world_meshes(one)}
    hits = []
    for tried in tried_grasps(one, TABLES["jaw"]):
        if tried.verdict is None:
            continue
        body = gripper_body(JAW, tried.candidate.width)
        X = np.concatenate([sample(np.asarray(mesh.vertices), rng) for mesh in body.meshes.values()])
        X = X @ tried.T_cam_grasp[:3, :3].T + tried.T_cam_grasp[:3, 3]
        own = f"part {tried.part.index}"
        touched = any((X @ e[:, :3].T + e[:, 3] < 0).all(axis=1).any() for name, e in solids.items() if name != own)
        hits.append(touched)
        assert not (touched and tried.free)  # where a sample is inside, the library must know
        if not touched and not tried.free:  # it finds also what lies between samples, or nearer than the clearance
            gap = min(_gap(X, e) for name, e in solids.items() if name != own)
            assert gap < 6.0
    assert any(hits)
    assert not all(hits)


def sample(corners: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Points within a box given by its corners."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    return np.concatenate([corners, rng.uniform(low, high, (1500, 3))])


def _gap(X: np.ndarray, equations: np.ndarray) -> float:
    """A lower bound of the distance [mm] of points from a convex solid."""
    return float((X @ equations[:, :3].T + equations[:, 3]).max(axis=1).min())


def test_a_grasp_touches_its_part_at_the_pads_alone():
    """The target is not asked at run time; offline, nothing of the sweep may lie in it but at the pads."""
    solid = ConvexHull(BOX.vertices).equations
    for c in TABLES["jaw"][1].candidates:
        for mesh in gripper_body(JAW, c.width).meshes.values():
            X = np.asarray(mesh.vertices) @ c.T_obj_grasp[:3, :3].T + c.T_obj_grasp[:3, 3]
            assert (X @ solid[:, :3].T + solid[:, 3]).max(axis=1).min() > 0.9 * TOUCH


def test_reasons_count_what_was_in_the_way():
    """A box in a pit of tall prisms."""
    ring = [prism(32 * np.cos(a), 32 * np.sin(a), 200.0, 8.0, k) for k, a in enumerate(np.linspace(0, 2 * np.pi, 12))]
    grasps = find_grasps(world([placed(0, BOX, pose(0, 0, 10.0))], ring), TABLES["jaw"])
    assert grasps.best is None
    assert "in collision" in grasps.reasons[0]
    assert "with region" in grasps.reasons[0]
    assert "'s prism" in grasps.reasons[0]
    assert grasps.reason == f"part 0: {grasps.reasons[0]}"


def test_every_grasp_of_a_crowded_part_in_collision_is_said_so():
    upright = {1: grasp_table(BOX, CUP)}
    some = [c for c in upright[1].candidates if c.T_obj_grasp[2, 2] < -0.9]
    table = {1: replace(upright[1], candidates=tuple(some))}
    lid = prism(0, 0, 60.0, 40.0, 3)
    grasps = find_grasps(world([placed(0, BOX, pose(0, 0, 10.0))], [lid]), table)
    assert grasps.reasons[0] == f"all {len(some)} grasps in collision: {len(some)} with region 3's prism"


def test_no_part_is_a_reason():
    grasps = find_grasps(world([]), TABLES["jaw"])
    assert (grasps.reason, grasps.grasps) == (NO_PART, ())
    with pytest.raises(ItreeError, match="exactly one gripper"):
        find_grasps(world([]), {})


def test_the_clearance_of_a_grasp_between_a_part_and_a_wall_is_the_gap():
    """A box held from above across its 30 mm; a prism stands 20 mm beside the open finger's outside."""
    outside = 15.0 + JAW.tool.open_by + JAW.tool.finger_thickness
    apart = prism(0.0, outside + 20.0 + 10.0, 15.0, 10.0)  # lower than the palm
    found = find_grasps(world([placed(0, BOX, pose(0, 0, 30.0))], [apart]), TABLES["jaw"])
    here = [g for g in found.grasps if g.width == 30.0 and abs(g.T_cam_grasp[2, 2]) > 0.999
            and abs(g.T_cam_grasp[0, 3]) < 7.0]  # fmt: skip
    assert here
    for grasp in here:
        tip = -FLOOR - grasp.T_cam_grasp[2, 3] - 0.5 * JAW.tool.pad_length
        assert grasp.clearance == pytest.approx(min(np.hypot(20.0, max(tip - 15.0, 0.0)), tip), abs=0.1)


def test_scores_fall_with_doubt_about_the_pose():
    T = pose(0, 0, 10.0)
    C = np.diag([1e-6, 1e-6, 1e-6, 1.0, 1.0, 1.0])
    sure, unsure, torn = (
        placed(0, BOX, T, covariance=0.01 * C), placed(0, BOX, T, covariance=9.0 * C),
        placed(0, BOX, T, score=0.6),
    )  # fmt: skip
    plain, a, b, c = (find_grasps(world([p]), TABLES["jaw"]).best for p in (placed(0, BOX, T), sure, unsure, torn))
    assert a.score == pytest.approx(plain.score, rel=1e-3)
    assert b.score < 0.9 * plain.score
    assert c.score == pytest.approx(0.6 * plain.score)


def test_a_free_turn_about_a_rods_axis_is_no_doubt():
    """Nothing measures it, and nothing that the jaw or the cup holds depends on it."""
    T = pose(0, 0, 10.0, (90.0, 0.0, 0.0))
    turn = np.concatenate([T[:3, 2], np.zeros(3)])  # the rod's axis goes through its origin
    C = 1e-4 * np.eye(6) + 1e4 * np.outer(turn, turn)
    rod = placed(0, ROD, T, covariance=C)
    axes = ((np.array([0.0, 0.0, 1.0]), np.zeros(3)),)
    wide = load_gripper("bundled:cup")
    for gripper in (JAW, wide):
        for candidate in grasp_table(ROD, gripper).candidates:
            assert fits(rod.detection, candidate, gripper, axes) > 0.98


def test_the_robots_frame_is_the_cameras_times_hand_eye():
    T_robot_cam = np.eye(4)
    T_robot_cam[:3, :3], T_robot_cam[:3, 3] = DOWN, [100.0, 0.0, 500.0]
    best = find_grasps(some_world(1), TABLES["jaw"], T_robot_cam).best
    np.testing.assert_allclose(best.T_robot_grasp, T_robot_cam @ best.T_cam_grasp)


def test_grasps_on_disk_follow_their_schema(tmp_path):
    schema = json.loads(SCHEMA_PATH.read_text())
    one = some_world(1)
    answers = Detections(tuple(p.detection for p in one.parts))
    for T_robot_cam in (None, np.eye(4)):
        write_grasps([(answers, find_grasps(one, TABLES["jaw"], T_robot_cam))], tmp_path / "g.json")
        document = json.loads((tmp_path / "g.json").read_text())
        assert violations(document, schema) == []
        assert document["images"][0]["grasps"]
        assert (document["images"][0]["grasps"][0]["T_robot_grasp"] is None) == (T_robot_cam is None)
