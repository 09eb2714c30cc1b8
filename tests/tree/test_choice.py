"""The choice of rules: error rates with their intervals, and the two policies."""

from typing import NamedTuple

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from itree_kernels.errors import ItreeError

from itree_jax.features.inertia import FaceInertia
from itree_jax.features.region import RegionFeatures
from itree_jax.tree.branches import branches
from itree_jax.tree.choice import (
    ERROR_BOUND,
    choose_rule,
    choose_rules,
    distributions,
    side_errors,
    side_margin,
    view_weights,
    wilson_interval,
)
from itree_jax.tree.draws import Draws
from itree_jax.tree.tree import PRUNED

Z = 1.96


@given(st.integers(1, 500), st.floats(0, 1))
def test_wilsons_interval_is_where_the_score_test_gives_in(count, share):
    errors = share * count
    low, high = wilson_interval(errors, count)
    assert 0.0 <= low <= errors / count <= high <= 1.0
    for end in (low, high):
        if 0 < end < 1:  # |p - f| = z sqrt(f (1 - f) / n)
            assert abs(share - end) == pytest.approx(Z * np.sqrt(end * (1 - end) / count), rel=1e-6, abs=1e-9)


def test_wilsons_interval_of_nothing_and_at_the_ends():
    assert wilson_interval(0, 0) == (0.0, 1.0)
    assert wilson_interval(0, 20)[0] == 0.0
    assert wilson_interval(20, 20)[1] == 1.0


def test_the_margin_weighs_groups_by_their_views():
    likelihood = np.log([[0.2, 0.4, 0.1], [0.9, 0.3, 0.3]])
    prior = np.array([0.5, 0.25, 0.25])
    visible, hidden = np.array([True, False, False]), np.array([False, True, True])
    margin = side_margin(likelihood, prior, visible, hidden)
    np.testing.assert_allclose(margin, np.log([0.1 / 0.125, 0.45 / 0.15]))
    np.testing.assert_allclose(side_margin(likelihood, prior, hidden, visible), -margin)
    # a group that no view belongs to says nothing
    np.testing.assert_allclose(
        side_margin(likelihood, np.array([0.5, 0.5, 0.0]), visible, hidden), np.log([0.5, 3.0])
    )


def test_a_draw_is_wrong_where_the_margin_has_the_other_sign():
    likelihood = np.log([[[0.9, 0.1], [0.2, 0.8], [0.6, 0.4]]])
    sides = np.array([True, False]), np.array([False, True])
    wrong = side_errors(likelihood, np.array([0.5, 0.5]), *sides, np.array([0, 0, 1]))
    np.testing.assert_array_equal(wrong, [[False, True, True]])


@given(st.lists(st.integers(0, 3), min_size=1, max_size=60), st.lists(st.floats(0.01, 1), min_size=4, max_size=4))
def test_weights_sum_to_1_and_give_every_group_its_share(groups, shares):
    group, prior = np.array(groups), np.array(shares) / sum(shares)
    weight = view_weights(group, prior)
    assert weight.sum() == pytest.approx(1.0)
    present = np.unique(group)
    total = np.bincount(group, weights=weight, minlength=4)[present]
    np.testing.assert_allclose(total, prior[present] / prior[present].sum())
    for g in present:
        assert len(np.unique(weight[group == g])) == 1


@pytest.mark.parametrize(
    ("rates", "paper", "measured"),
    [
        ([0.04, 0.00, 0.00], 0, 1),  # paper: the first under the bound; measured: the least
        ([0.06, 0.04, 0.01], 1, 2),
        ([0.20, 0.10, 0.15], 1, 1),  # none under the bound: both the least
        ([0.012, 0.010, 0.010], 0, 0),  # equal within half a percent: the cheapest
        ([0.30, 0.104, 0.100], 2, 1),  # none under the bound: the least; measured takes the cheaper all the same
        ([ERROR_BOUND, 0.3, 0.04], 2, 2),  # under means under
    ],
)
def test_policies(rates, paper, measured):
    assert choose_rule(np.array(rates), "paper") == paper
    assert choose_rule(np.array(rates), "measured") == measured


class Faces(NamedTuple):
    """Regions known by size (L1, L2) and by the scatter of their normals (L3)."""

    size: np.ndarray
    scatter: np.ndarray
    group: np.ndarray

    def draws(self) -> Draws:
        n = len(self.group)
        zero, normal = np.zeros(n, np.float32), np.tile(np.float32([0, 0, -1]), (n, 1))
        moment = self.size.astype(np.float32) ** 4
        features = RegionFeatures(
            inertia=FaceInertia(zero, np.zeros((n, 2), np.float32), moment, moment / 2, zero, zero + 1 / 3),
            outline=np.tile(self.size.astype(np.float32)[:, None], (1, 64)), egi=np.zeros((n, 4), np.float32),
            mass_centre=normal, mean_normal=normal,
            normal_scatter=np.stack([self.scatter, zero], axis=1).astype(np.float32) ** 2,
            area=np.full(n, 500.0, np.float32),
        )  # fmt: skip
        return Draws(features, self.group, np.tile(np.eye(3), (n, 1, 1)), 0)


def faces(sizes, scatters, seed: int, count: int = 60) -> Draws:
    """`count` draws of every group around its size [mm] and scatter."""
    rng = np.random.default_rng(seed)
    group = np.repeat(np.arange(len(sizes)), count)
    return Faces(
        np.array(sizes)[group] * np.exp(rng.normal(0, 0.02, len(group))),
        np.array(scatters)[group] + rng.normal(0, 0.01, len(group)), group,
    ).draws()  # fmt: skip


LABELS = np.array([[True, True, False], [True, False, False], [False, True, False], [False, False, True]])
AREAS = np.array([300.0, 200.0, 100.0])


def chosen(sizes, scatters, policy="measured", pruned=(False,) * 4, prior=(0.25,) * 4):
    pruned = np.array(pruned)
    tree = branches(LABELS, AREAS, pruned)
    train, test = faces(sizes, scatters, 1), faces(sizes, scatters, 2)
    return choose_rules(tree, distributions(train, 4), test, np.array(prior), ~pruned, policy)


def test_groups_of_different_size_are_told_by_the_cheapest_rule_without_error():
    nodes = chosen([10, 20, 40, 80], [0.2] * 4)
    assert nodes.branch == ("B0", "B1", "B2")
    assert nodes.rule == ("L1", "L1", "L1")
    np.testing.assert_array_equal(nodes.error, 0.0)
    np.testing.assert_array_equal(nodes.draws, [240, 120, 120])
    # no error in n draws of equal weight: the interval reaches z^2 / (n + z^2)
    np.testing.assert_allclose(nodes.error_interval[:, 1], Z**2 / (nodes.draws + Z**2), rtol=1e-5)


def test_groups_of_different_curvature_are_told_by_the_egi():
    nodes = chosen([20] * 4, [0.1, 0.3, 0.5, 0.7])
    assert nodes.rule == ("L3", "L3", "L3")
    np.testing.assert_array_equal(nodes.error, 0.0)
    assert (nodes.rule_errors[:, 0] > 0.3).all()  # size tells nothing


def test_what_no_rule_can_tell_is_a_coins_error_rate():
    nodes = chosen([20] * 4, [0.2] * 4)
    assert (np.abs(nodes.rule_errors - 0.5) < 0.15).all()
    assert (nodes.error_interval[:, 0] < 0.5).all()


def test_groups_of_few_views_weigh_little():
    """B0 divides groups 0, 1 from 2, 3; only 1 and 2 look alike."""
    often = chosen([10, 20, 20, 80], [0.2] * 4)
    seldom = chosen([10, 20, 20, 80], [0.2] * 4, prior=(0.49, 0.01, 0.01, 0.49))
    assert often.error[0] > 0.15
    assert seldom.error[0] < 0.03
    assert (often.error_interval[0, 1] - often.error_interval[0, 0]) < 0.2


def test_nothing_is_asked_where_one_side_is_pruned():
    nodes = chosen([10, 20, 40, 80], [0.2] * 4, pruned=(False, True, False, False), prior=(0.4, 0.0, 0.3, 0.3))
    assert nodes.rule == ("L1", PRUNED, "L1")
    assert nodes.draws.tolist() == [180, 0, 120]
    assert np.isnan(nodes.rule_errors[1]).all()
    np.testing.assert_array_equal(nodes.error_interval[1], 0.0)


def test_errors_lie_in_their_intervals_and_the_policies_differ():
    sizes, scatters = [20, 20.4, 21, 22], [0.1, 0.3, 0.5, 0.7]
    for policy in ("measured", "paper"):
        nodes = chosen(sizes, scatters, policy)
        assert ((nodes.error_interval[:, 0] <= nodes.error) & (nodes.error <= nodes.error_interval[:, 1])).all()
        assert set(nodes.rule) <= {"L1", "L2", "L3"}
    close = [10, 20, 21.6, 80]  # size errs in a few percent, the EGI never: the paper takes L1 all the same
    curved = [0.1, 0.3, 0.5, 0.7]
    assert chosen(close, curved, "measured").rule[0] == "L3"
    paper = chosen(close, curved, "paper")
    assert paper.rule[0] == "L1"
    assert 0.0 < paper.error[0] < ERROR_BOUND


def test_distributions_keep_every_draw_under_its_group():
    draws = faces([10, 20], [0.2, 0.4], 0, count=3)
    keep = np.array([0, 1, 2, 4])  # two draws of group 1 showed nothing; group 2 has no draw
    features = jax.tree.map(lambda a: a[keep], draws.features)
    table = distributions(Draws(features, draws.group[keep], draws.R_cam_obj[keep], 2), 3)
    assert table.rules == ("L1", "L2", "L3")
    for samples, bandwidth in zip(table.samples, table.bandwidth, strict=True):
        assert samples.shape[:2] == (3, 3)
        assert bandwidth.shape == samples.shape[2:]
        np.testing.assert_array_equal(np.isnan(samples[..., 0]).sum(axis=1), [0, 2, 3])
    own = 0.25 * np.log(draws.features.inertia.I_max[4] * np.array([1.0, 0.5]))
    np.testing.assert_allclose(table.samples[0][1, 0], own, rtol=1e-5)


def test_there_is_no_third_policy():
    with pytest.raises(ItreeError, match="no policy 'best'; use one of measured, paper"):
        chosen([10, 20, 40, 80], [0.2] * 4, policy="best")
