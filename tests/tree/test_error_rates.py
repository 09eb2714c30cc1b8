"""Error rates of draws: margins by views, whole and cut regions apart, intervals."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from itree_jax.tree.error_rates import (
    Measured,
    at_stake,
    expected,
    independent_draws,
    side_margin,
    view_weights,
    whole_and_cut,
    wilson_interval,
)

Z = 1.96
TWO_SIDES = np.array([True, False]), np.array([False, True])


@given(st.integers(1, 500), st.floats(0, 1))
def test_wilsons_interval_is_where_the_score_test_gives_in(count, share):
    """(p - f)^2 = z^2 f (1 - f)/n at both ends. That is compared, not |p - f|: where p is all but 1, one end is too,
    and neither p - f nor 1 - f has any digit left; both sides are then 0 as far as they can be."""
    errors = share * count
    low, high = wilson_interval(errors, count)
    assert 0.0 <= low <= errors / count <= high <= 1.0
    for end in (low, high):
        if 0 < end < 1:
            assert (share - end) ** 2 == pytest.approx(Z**2 * end * (1 - end) / count, rel=1e-6, abs=1e-14)


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


def test_draws_of_equal_weight_count_all_and_others_less():
    prior = np.array([0.5, 0.5])
    assert independent_draws(np.repeat([0, 1], 30), prior) == pytest.approx(60.0)
    assert independent_draws(np.array([0] * 30 + [1] * 3), prior) < 12.0
    assert independent_draws(np.zeros(0, int), prior) == 0.0


def made(wrong_whole: list[bool], wrong_cut: list[bool]) -> Measured:
    """Draws of group 0 under one rule, right or wrong as given; whole ones, then cut ones."""
    margin = np.where([*wrong_whole, *wrong_cut], -1.0, 1.0)
    cut = np.repeat([False, True], [len(wrong_whole), len(wrong_cut)])
    return Measured(np.stack([margin, np.zeros_like(margin)], axis=1)[None], np.zeros(len(cut), int), cut)


def test_whole_and_cut_regions_are_counted_apart():
    at = made([True, False, False, False], [True, True, False, False, False])
    np.testing.assert_allclose(whole_and_cut(at, (0,), np.array([0.5, 0.5]), *TWO_SIDES), [0.25, 0.4])


def test_the_errors_of_a_kind_that_was_not_drawn_are_those_of_the_other():
    prior = np.array([0.5, 0.5])
    np.testing.assert_allclose(whole_and_cut(made([True, False], []), (0,), prior, *TWO_SIDES), [0.5, 0.5])
    np.testing.assert_allclose(whole_and_cut(made([], [True, False, False, False]), (0,), prior, *TWO_SIDES), 0.25)


@given(st.integers(0, 1000))
def test_error_rates_are_those_of_plain_counting(seed):
    rng = np.random.default_rng(seed)
    group, cut = np.repeat([0, 1, 2], [7, 4, 9]), np.arange(20) % 2 == 1
    likelihood, prior = rng.normal(size=(3, 20, 3)), np.array([0.5, 0.3, 0.2])
    visible, hidden = np.array([True, False, False]), np.array([False, True, True])
    found = whole_and_cut(Measured(likelihood, group, cut), (0, 2), prior, visible, hidden)
    weight = prior * np.exp(likelihood[0] + likelihood[2])
    says_visible = weight[:, 0] > weight[:, 1] + weight[:, 2]
    for kind, share in zip((~cut, cut), found, strict=True):
        rates = [np.mean(says_visible[kind & (group == g)] != (g == 0)) for g in range(3)]
        assert share == pytest.approx(prior @ rates, abs=1e-6)


def test_the_paper_goes_by_whole_regions_and_the_other_policy_by_both_alike():
    rates = np.array([[0.1, 0.3], [0.2, 0.0]])
    np.testing.assert_allclose(expected(rates, "paper"), [0.1, 0.2])
    np.testing.assert_allclose(expected(rates, "measured"), [0.2, 0.1])
    at = made([True, False], [True])
    assert len(at_stake(at, "paper").group) == 2
    assert not at_stake(at, "paper").cut.any()
    assert at_stake(at, "measured") is at
