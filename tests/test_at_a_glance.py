"""Which of thousands of open attitudes are worth a ray."""

from dataclasses import replace

import numpy as np
import pytest

from itree_jax.at_a_glance import MOST, agreement_at_a_glance, best_at_a_glance, nearest_view
from itree_jax.open_places import NEARLY_OPEN, Places, every_attitude
from itree_jax.prepared import prepare
from itree_jax.refinement.hypotheses import RegionHypotheses
from itree_jax.refinement.optimise import Hypotheses
from itree_jax.refinement.pose_distance import same_part_distance
from itree_jax.shown_surface import dome_points
from itree_jax.sight import look
from itree_jax.tree.dome import dome


@pytest.fixture(scope="module")
def table(paper_tree, paper_part_on_a_table):
    """The prepared tree, the sight, the true pose about the part's middle, and every attitude of the topmost region."""
    scene, truth = paper_part_on_a_table
    prepared, sight = prepare(paper_tree), look(scene.images, scene.sensor, scene.depth, scene.R_w2c)
    R, t = prepared.about_middle(truth.R_cam_obj, truth.t_cam_obj)
    R_ray_cam = np.tile(np.eye(3), (sight.found.count, 1, 1))
    every = every_attitude(prepared, sight, Places(np.zeros(1, int), np.ones(1, bool)), R_ray_cam)
    return prepared, sight, R, t, every


def test_the_true_pose_agrees_best_of_the_whole_dome(table):
    prepared, sight, R, t, every = table
    true = RegionHypotheses(
        Hypotheses(R[None].astype(np.float32), t[None].astype(np.float32)), np.zeros(1, int), np.zeros(1, int),
        np.zeros(1), *np.zeros((3, 1), bool),
    )
    assert agreement_at_a_glance(true, prepared, sight)[0] > 0.9 * agreement_at_a_glance(every, prepared, sight).max()


def test_few_of_every_region_are_left_and_one_is_within_reach_of_the_true_pose(table):
    prepared, sight, R, t, every = table
    kept = best_at_a_glance(every, prepared, sight)
    assert len(kept.region) == MOST < len(every.region)
    R_kept, t_kept = (np.asarray(a, float) for a in kept.poses)
    apart = same_part_distance(R_kept, t_kept, R, t, prepared.symmetries, prepared.model.diameter)
    assert apart.min() < 0.25 * prepared.model.diameter
    for k in range(0, MOST, 16):
        others = np.arange(MOST) != k
        apart = same_part_distance(
            R_kept[others], t_kept[others], R_kept[k], t_kept[k], prepared.symmetries, prepared.model.diameter
        )
        assert apart.min() >= NEARLY_OPEN * prepared.model.diameter


def test_a_pose_is_seen_by_the_view_that_it_is_nearest_to(table):
    _, sight, _, _, every = table
    view = nearest_view(every, sight)
    R, t = (np.asarray(a, float) for a in every.poses)
    toward = -np.einsum("hab,ha->hb", R, t / np.linalg.norm(t, axis=1, keepdims=True))
    cosine = (toward * dome().directions[view]).sum(axis=1)
    assert cosine.min() > np.cos(np.radians(25.0))
    assert len(np.unique(view)) > 40


def test_a_view_that_shows_no_sample_agrees_with_nothing(table):
    """As of a thin sheet seen on edge."""
    prepared, sight, _, _, every = table
    edge_on = replace(prepared, shown=replace(prepared.shown, normal_ray=0.0 * prepared.shown.normal_ray))
    blank = replace(edge_on, points=dome_points(edge_on.shown))
    assert (blank.points.point_mm2 == 0.0).all()
    assert np.abs(agreement_at_a_glance(every, blank, sight)).max() < 1e-3
