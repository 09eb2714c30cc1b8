"""The turn about the own axis of a part that is nearly of revolution."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from itree_jax import own_axis
from itree_jax.answers import Interpretation
from itree_jax.challenge import plan_of
from itree_jax.own_axis import FINER, LIKELY, in_doubt, likeliest_turns, turned_to_likeliest
from itree_jax.prepared import Prepared, prepare
from itree_jax.recognition import as_forest, read_scene
from itree_jax.refinement.likelihood import SIZE
from itree_jax.refinement.pose_distance import NEARLY_SAME, same_part_distance
from itree_jax.sight import Sight

from .accepted import only

AXIS = np.array([0.0, 0.6, 0.8]), np.array([2.0, -1.0, 3.0])


@pytest.fixture(scope="module")
def prepared(paper_tree) -> Prepared:
    """The paper's part, as if it were nearly of revolution about a slanting axis."""
    return replace(prepare(paper_tree), own_axis=AXIS)


@pytest.fixture(scope="module")
def read(paper_part_on_a_table, prepared):
    """What is recognised of one part on a table, and the sight."""
    scene, _ = paper_part_on_a_table
    answers, sight = read_scene(as_forest(prepared), scene.images, scene.sensor, scene.depth, scene.R_w2c)
    return answers[0], sight


def turned(answer: Interpretation, sight: Sight, angle: float) -> Interpretation:
    """The first accepted pose alone, turned about the axis by an angle [rad], and in doubt."""
    (direction, point), h = AXIS, answer.selection.accepted[0]
    R, t = (np.asarray(a, float)[h] for a in answer.hypotheses.poses)
    about = Rotation.from_rotvec(angle * direction).as_matrix()
    alone = only(answer, sight, R @ about, R @ (point - about @ point) + t)
    return alone.selected(replace(alone.selection, rivals=((np.array([0]), np.zeros(1)),)))


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


def test_of_two_turns_that_compete_one_is_another_pose(read, prepared, monkeypatch):
    """Else the likelier of two names of one pose would win, not the likelier pose. One that is no rival stays away."""
    answer, sight = read
    pose = turned(answer, sight, np.radians(3.0)).hypotheses
    assert len(likeliest_turns(pose, prepared, sight, plan_of(answer, sight)).region) == 1
    monkeypatch.setattr(own_axis, "NO_RIVAL", np.inf)
    two = likeliest_turns(pose, prepared, sight, plan_of(answer, sight))
    R, t = (np.asarray(a, float) for a in two.poses)
    apart = same_part_distance(R[1:], t[1:], R[0], t[0], prepared.symmetries, prepared.model.diameter)
    assert apart.shape == (1,)
    assert apart[0] > (NEARLY_SAME - 0.5 * FINER.max()) * prepared.model.diameter  # the first was turned on since


def test_a_pose_that_is_likeliest_as_it_is_is_asked_once(read):
    answer, sight = read
    own = turned(answer, sight, 0.0)
    beside = likeliest_turns(own.hypotheses, own.prepared, sight, plan_of(own, sight))
    assert len(beside.region) == 0  # no rival, and not itself again
    asked = turned_to_likeliest(own, sight)
    assert asked.hypotheses.turned[asked.selection.accepted].all()
    assert turned_to_likeliest(asked, sight) is asked


def test_a_pose_that_was_turned_is_asked_again(read):
    """Once it is polished its turn is told better."""
    answer, sight = read
    wrong = turned(answer, sight, np.radians(143.0))
    right = turned_to_likeliest(wrong, sight)
    assert not right.hypotheses.turned[right.selection.accepted].any()
    assert right.hypotheses.turned.sum() == 1  # what it was turned from


def test_turns_at_the_image_s_own_resolution_have_the_last_word(read, prepared, monkeypatch):
    """Whatever half of it says, as long as the right one is among the likeliest there."""
    answer, sight = read
    pose, plan = turned(answer, sight, np.radians(62.0)).hypotheses, plan_of(answer, sight)
    expected = likeliest_turns(pose, prepared, sight, plan).take(np.array([0]))
    told = own_axis.likelier_than_first

    def misled(poses, prepared, sight, plan, size=SIZE):
        nats = told(poses, prepared, sight, plan, size)
        if size < SIZE:
            order = np.argsort(-nats)
            nats[order[: LIKELY - 1]] = nats[order[: LIKELY - 1]][::-1]  # the likeliest come last
        return nats

    monkeypatch.setattr(own_axis, "likelier_than_first", misled)
    found = likeliest_turns(pose, prepared, sight, plan).take(np.array([0]))
    np.testing.assert_allclose(found.poses.R_cam_obj, expected.poses.R_cam_obj, atol=1e-6)


def test_a_pose_without_a_rival_is_left_alone(read):
    """What tells how far it is turned is seen clearly: no other turn comes near."""
    answer, sight = read
    wrong = turned(answer, sight, np.radians(143.0))
    sure = wrong.selected(replace(wrong.selection, rivals=((np.zeros(0, int), np.zeros(0)),)))
    assert turned_to_likeliest(sure, sight) is sure


@pytest.mark.parametrize(("about", "doubted"), [([0.0, 0.0, 1.2], True), ([1.2, 0.0, 0.0], False)])
def test_a_rival_casts_doubt_if_it_has_the_axis_where_the_pose_has_it(about, doubted):
    R = np.stack([np.eye(3), Rotation.from_rotvec(about).as_matrix()])
    answer = SimpleNamespace(
        hypotheses=SimpleNamespace(poses=SimpleNamespace(R_cam_obj=R)),
        selection=SimpleNamespace(accepted=np.array([0]), rivals=((np.array([1]), np.array([3.0])),)),
    )
    assert in_doubt(answer, (np.array([0.0, 0.0, 1.0]), np.zeros(3))).tolist() == [doubted]
