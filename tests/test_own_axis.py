"""The turn about the own axis of a part that is nearly of revolution."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from itree_jax.answers import Interpretation
from itree_jax.challenge import plan_of
from itree_jax.narrowing import judge
from itree_jax.own_axis import FINER, likeliest_turns, turned_to_likeliest
from itree_jax.prepared import Prepared, prepare
from itree_jax.recognition import as_forest, read_scene
from itree_jax.refinement.optimise import Hypotheses
from itree_jax.refinement.pose_distance import NEARLY_SAME, same_part_distance
from itree_jax.sight import Sight
from itree_jax.simulate.bin import Bin
from itree_jax.simulate.imaging import image_bin

AXIS = np.array([0.0, 0.6, 0.8]), np.array([2.0, -1.0, 3.0])


@pytest.fixture(scope="module")
def prepared(paper_tree) -> Prepared:
    """The paper's part, as if it were nearly of revolution about a slanting axis."""
    return replace(prepare(paper_tree), own_axis=AXIS)


@pytest.fixture(scope="module")
def read(paper_tree, prepared):
    """What is recognised of one part on a table, and the sight."""
    sensor = replace(paper_tree.sensor, camera=paper_tree.sensor.camera.cropped(200, 140, 240, 200))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_euler("zx", [30, 50], degrees=True).as_matrix(), (0.0, 0.0, 25.0)
    scene, _ = image_bin(paper_tree.part, T[None], Bin((500.0, 400.0), 5.0), sensor, seed=1)
    answers, sight = read_scene(as_forest(prepared), scene.images, scene.sensor, scene.depth, scene.R_w2c)
    return answers[0], sight


def turned(answer: Interpretation, sight: Sight, angle: float) -> Interpretation:
    """The first accepted pose alone, turned about the axis by an angle [rad]."""
    (direction, point), h = AXIS, answer.selection.accepted[:1]
    R, t = (np.asarray(a, float)[h[0]] for a in answer.hypotheses.poses)
    about = Rotation.from_rotvec(angle * direction).as_matrix()
    poses = Hypotheses(*((np.asarray(a, np.float32)[None]) for a in (R @ about, R @ (point - about @ point) + t)))
    hypotheses = answer.hypotheses.take(h)._replace(poses=poses)
    tree = answer.prepared.tree
    judged = judge(hypotheses, answer.prepared, sight, sight.plan(tree.part.diameter, tree.spacing))
    chosen = replace(
        answer.selection, accepted=np.array([0]), score=np.array([0.9]), reason=("",),
        rivals=((np.zeros(0, int), np.zeros(0)),),
    )
    return replace(answer, hypotheses=hypotheses, judged=judged, selection=chosen)


def degrees_between(a: Interpretation, b: Interpretation) -> float:
    """Of the first accepted pose of each."""
    R, S = (np.asarray(one.hypotheses.poses.R_cam_obj[one.selection.accepted[0]], float) for one in (a, b))
    return float(np.degrees(Rotation.from_matrix(R.T @ S).magnitude()))


@pytest.mark.parametrize("degrees", [-70.0, 27.0, 143.0])
def test_a_pose_turned_about_its_axis_is_turned_back_from_anywhere(read, degrees):
    answer, sight = read
    wrong = turned(answer, sight, np.radians(degrees))
    assert degrees_between(wrong, answer) > 26.0
    right = turned_to_likeliest(wrong, sight)
    assert degrees_between(right, answer) < np.degrees(FINER[1] - FINER[0])


def test_a_right_pose_stays_as_it_is(read):
    answer, sight = read
    right = turned(answer, sight, 0.0)
    again = turned_to_likeliest(right, sight)
    assert degrees_between(again, answer) < np.degrees(FINER[1] - FINER[0])
    assert len(again.selection.accepted) == 1


def test_other_parts_are_left_alone(read):
    answer, sight = read
    other = replace(answer, prepared=replace(answer.prepared, own_axis=None))
    assert turned_to_likeliest(other, sight) is other


def test_of_two_turns_that_compete_one_is_another_pose(read, prepared):
    """Else the likelier of two names of one pose would win, not the likelier pose."""
    answer, sight = read
    pose = turned(answer, sight, np.radians(3.0)).hypotheses
    two = likeliest_turns(pose, prepared, sight, plan_of(answer, sight))
    R, t = (np.asarray(a, float) for a in two.poses)
    apart = same_part_distance(R[1:], t[1:], R[0], t[0], prepared.symmetries, prepared.model.diameter)
    assert apart.shape == (1,)
    assert apart[0] > (NEARLY_SAME - 0.5 * FINER.max()) * prepared.model.diameter  # the first was turned on since
