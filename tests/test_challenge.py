"""The last word: turned poses are found out, and polishing never makes an answer less likely."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from itree_jax import challenge
from itree_jax.challenge import beside_turned, came_back, challenged, challengers, others_than, plan_of, shown_at
from itree_jax.prepared import prepare
from itree_jax.recognition import as_forest, read_scene
from itree_jax.refinement.hypotheses import joined, turned_about_axes
from itree_jax.refinement.optimise import Hypotheses
from itree_jax.refinement.verify import visible_centres
from itree_jax.settling import ARRIVED, exact, polished, settled
from itree_jax.sight import EDGE_REACH

from .accepted import only

MOST_POLISHED = 10


@pytest.fixture(scope="module")
def prepared(paper_tree):
    return prepare(paper_tree)


@pytest.fixture(scope="module")
def read(paper_part_on_a_table, prepared):
    """What is recognised of one part on a table, the sight, and the true pose."""
    scene, truth = paper_part_on_a_table
    answers, sight = read_scene(as_forest(prepared), scene.images, scene.sensor, scene.depth, scene.R_w2c)
    return answers[0], sight, truth


def turn_between(R, S) -> float:
    """[deg]"""
    return float(np.degrees(Rotation.from_matrix(np.asarray(R, float).T @ S).magnitude()))


def best(answer):
    h = answer.selection.accepted[0]
    return np.asarray(answer.hypotheses.poses.R_cam_obj[h], float), np.asarray(answer.hypotheses.poses.t_cam_obj[h])


def first_accepted(answer):
    """As the first one of those that are challenged."""
    h = answer.selection.accepted[:1]
    return answer.hypotheses.take(h)._replace(region=np.zeros(1, int))


@pytest.mark.parametrize("k", [0, 9, 17])
def test_a_turned_pose_gives_way_to_the_right_one(prepared, read, k):
    answer, sight, truth = read
    turn = np.linalg.inv(prepared.turns[k % len(prepared.turns)])
    R, t = truth.R_cam_obj @ turn[:3, :3], truth.R_cam_obj @ turn[:3, 3] + truth.t_cam_obj
    wrong = only(answer, sight, R, t)
    assert turn_between(best(wrong)[0], truth.R_cam_obj) > 15.0
    found = challenged(wrong, sight)
    assert turn_between(best(found)[0], truth.R_cam_obj) < 1.0
    assert found.hypotheses.challenged.tolist() == [True] + [False] * (len(found.hypotheses.region) - 1)
    again = challenged(found, sight)  # who wins a place is challenged in its turn, and stays
    assert again.hypotheses.challenged[again.selection.accepted].all()
    assert turn_between(best(again)[0], truth.R_cam_obj) < 1.0


def test_the_accepted_pose_goes_along_with_its_challengers_and_is_none_of_them(prepared, read, monkeypatch):
    """It is what they have to agree as well as; what is as good as turned back to it is no challenger."""
    answer, sight, _ = read
    accepted = answer.hypotheses.take(answer.selection.accepted[:1])._replace(region=np.zeros(1, int))
    measures, narrow = [], challenge.narrow

    def noted(hypotheses, *args):
        R = np.asarray(hypotheses.poses.R_cam_obj)
        measures.append(np.isclose(R, accepted.poses.R_cam_obj[0], atol=1e-6).all(axis=(1, 2)).any())
        return narrow(hypotheses, *args)

    monkeypatch.setattr(challenge, "narrow", noted)
    found = challengers(accepted, prepared, sight, plan_of(answer, sight))
    assert measures == [True, True]
    if found is not None:
        assert not came_back(accepted, found[0], prepared).any()


def test_whoever_met_its_challengers_is_left_alone(read):
    answer, sight, _ = read
    assert answer.hypotheses.challenged[answer.selection.accepted].all()
    assert challenged(answer, sight) is answer
    again = settled([answer], sight)[0]
    assert len(again.selection.accepted) == len(answer.selection.accepted)


def test_turned_poses_show_their_surface_where_the_pose_did(prepared, read):
    answer, sight, _ = read
    accepted = first_accepted(answer)
    turned = shown_at(accepted, turned_about_axes(accepted, prepared.turns), prepared, sight.sensor, 24)
    assert len(turned.region) == len(prepared.turns)
    own = visible_centres(accepted.poses, prepared.model, sight.sensor.camera, 24)
    moved = visible_centres(turned.poses, prepared.model, sight.sensor.camera, 24)
    # shifting a pose a little changes what it shows a little
    np.testing.assert_allclose(moved, np.tile(own, (len(moved), 1)), atol=0.05 * prepared.tree.part.diameter)


def test_a_turned_pose_that_fits_as_it_is_isnt_led_astray(prepared, read):
    """Moved by what the whole part shows, a turned pose of a part that is half hidden starts beside the place."""
    answer, sight, truth = read
    accepted = first_accepted(answer)
    turn = prepared.turns[0]
    wrong = Hypotheses(
        np.asarray(truth.R_cam_obj @ turn[:3, :3].T, np.float32)[None],
        np.asarray(truth.t_cam_obj - truth.R_cam_obj @ turn[:3, :3].T @ turn[:3, 3], np.float32)[None],
    )
    plan = sight.plan(prepared.tree.part.diameter, prepared.tree.spacing)
    found, judged = challengers(accepted._replace(poses=wrong), prepared, sight, plan)
    assert len(judged.log_likelihood) == len(found.region)
    turns = [turn_between(R, truth.R_cam_obj) for R in found.poses.R_cam_obj]
    assert min(turns) < 0.5
    assert set(found.region) == {0}


def test_who_comes_back_to_the_accepted_pose_is_no_challenger(prepared, read):
    answer, _, _ = read
    accepted = first_accepted(answer)
    turned = turned_about_axes(accepted, prepared.turns)
    kept = others_than(accepted, joined(accepted, turned), prepared)
    np.testing.assert_array_equal(kept.poses.R_cam_obj, turned.poses.R_cam_obj)


def test_polishing_makes_a_pose_more_likely_and_more_exact(read):
    answer, sight, truth = read
    off = Rotation.from_rotvec(np.radians([0.2, -0.15, 0.2])).as_matrix()
    rough = only(answer, sight, off @ truth.R_cam_obj, truth.t_cam_obj + np.full(3, 0.05))
    fine = polished(rough, sight)
    assert fine.judged.log_likelihood[0] > rough.judged.log_likelihood[0]
    assert turn_between(best(fine)[0], truth.R_cam_obj) < 0.5 * turn_between(best(rough)[0], truth.R_cam_obj)
    assert polished(fine, sight) is fine  # who is polished already isn't again


def test_by_images_alone_a_pose_is_polished_until_it_gains_nothing(read):
    answer, sight, truth = read
    by_images = replace(sight, edge_reach=EDGE_REACH)
    off = Rotation.from_rotvec(np.radians([0.6, -0.5, 0.6])).as_matrix()
    pose = only(answer, by_images, off @ truth.R_cam_obj, truth.t_cam_obj + np.full(3, 0.3))
    nats = []
    while len(nats) < MOST_POLISHED and (finer := polished(pose, by_images)) is not pose:
        nats.append(finer.judged.log_likelihood[0] - pose.judged.log_likelihood[0])
        pose = finer
    assert 1 < len(nats) < MOST_POLISHED
    assert min(nats[:-1]) >= ARRIVED
    assert 0.0 <= nats[-1] < ARRIVED


def test_polishing_leaves_alone_what_it_would_make_less_likely(read):
    """A polished pose polished again: whatever happens, it doesn't get less likely."""
    answer, sight, _ = read
    before = answer.judged.log_likelihood[answer.selection.accepted].max()
    after = polished(replace(answer, hypotheses=answer.hypotheses.unmet), sight)
    assert after.judged.log_likelihood[after.selection.accepted].max() >= before


def test_at_the_very_last_poses_are_moved_by_less_than_noise_and_who_is_right_stays_as_it_was(read):
    answer, sight, truth = read
    off = Rotation.from_rotvec(np.radians([0.06, -0.05, 0.06])).as_matrix()
    beside = only(answer, sight, off @ truth.R_cam_obj, truth.t_cam_obj + np.full(3, 0.05))
    (found,) = exact([beside], sight)
    assert turn_between(best(found)[0], truth.R_cam_obj) < 0.5 * turn_between(best(beside)[0], truth.R_cam_obj)
    assert found.selection is beside.selection
    assert found.judged is beside.judged
    far = only(answer, sight, truth.R_cam_obj, truth.t_cam_obj + 3.0 * sight.noise * np.eye(3)[2])
    for before, after in zip(far.hypotheses.poses, exact([far], sight)[0].hypotheses.poses, strict=True):
        np.testing.assert_array_equal(before, after)


def test_matched_depth_moves_nothing_at_the_very_last(read):
    answer, sight, _ = read
    assert exact([answer], replace(sight, edge_reach=2.0))[0] is answer


@pytest.mark.parametrize("edge_reach", [0.0, 2.0])
def test_only_a_depth_maps_pixels_are_taken_to_err_independently_at_last(read, edge_reach):
    answer, sight, _ = read
    plan = plan_of(answer, replace(sight, edge_reach=edge_reach))
    assert plan.deviations.depth_bias > 0.0
    assert plan.independent.depth_bias == (plan.deviations.depth_bias if edge_reach else 0.0)
    assert (plan.exact is None) == (edge_reach > 0.0)  # and along their rays
    assert plan.last[-1].size > plan.rounds[-1].stage.size


def test_at_last_an_accepted_pose_meets_itself_turned_as_exact_as_it_is(prepared, read):
    """Rivals that were refined less are beaten for that alone."""
    answer, sight, _ = read
    alone = only(answer, sight, *best(answer))
    met = replace(alone, hypotheses=alone.hypotheses._replace(challenged=np.ones(1, bool)))
    assert challenged(met, sight) is met
    more = beside_turned(met, sight)
    R, t = (np.asarray(a, float)[1:] for a in more.hypotheses.poses)
    turned = turned_about_axes(alone.hypotheses, prepared.turns).poses
    assert len(t) >= 1
    for R_k, t_k in zip(R, t, strict=True):
        same = np.abs(np.asarray(turned.R_cam_obj) - R_k).max(axis=(1, 2)) + np.abs(turned.t_cam_obj - t_k).max(axis=1)
        assert same.min() < 1e-5
    nothing = met.selected(replace(met.selection, accepted=np.zeros(0, int)))
    assert beside_turned(nothing, sight) is nothing
