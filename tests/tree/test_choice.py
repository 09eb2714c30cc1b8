"""The choice of rules: the two policies, pairs, and error rates on whole and on cut regions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from itree_kernels.errors import ItreeError

from itree_jax.features.inertia import FaceInertia
from itree_jax.features.polar import ANGLES, RADII
from itree_jax.features.region import RegionFeatures
from itree_jax.features.relation import BROTHER_FIELDS, MOST_BROTHERS
from itree_jax.tree.appearances import STORED_BROTHERS
from itree_jax.tree.choice import (
    EQUAL_ERROR,
    ERROR_BOUND,
    WORTH_A_PAIR,
    cheapest_of_equals,
    choose_rule,
    choose_rules,
    distributions,
    measure_rules,
)
from itree_jax.tree.classification_rules import CLASSIFICATION_RULES, PAIR, RULE_NAMES, rules_in
from itree_jax.tree.draws import Draws
from itree_jax.tree.error_rates import Measured, expected, whole_and_cut
from itree_jax.tree.tree import PRUNED
from itree_jax.tree.work_models import GroupModels

from .crafted import four_groups, random_told, told

Z = 1.96
EVEN = np.array([0.5, 0.5])
TWO_SIDES = np.array([True, False]), np.array([False, True])
NOTHING = told({}, np.array([0, 1]))  # draws about which no rule says anything


def rates_of(*rates: float, rest: float = 0.5) -> np.ndarray:
    """Errors of L1, L2, ... on whole and cut regions alike."""
    return np.repeat([*rates, *[rest] * (len(RULE_NAMES) - len(rates))], 2).reshape(-1, 2)


@pytest.mark.parametrize(
    ("rates", "paper", "measured"),
    [
        ([0.04, 0.00, 0.00], "L1", "L2"),  # paper: the first under the bound; measured: the least
        ([0.06, 0.04, 0.01], "L2", "L3"),
        ([0.20, 0.10, 0.15], "L2", "L2"),  # none under the bound: both the least
        ([0.012, 0.010, 0.010], "L1", "L1"),  # equal within half a percent: the cheapest
        ([0.30, 0.104, 0.100], "L3", "L2"),  # none under the bound: the least; measured takes the cheaper all the same
        ([ERROR_BOUND, 0.3, 0.04], "L3", "L3"),  # under means under
    ],
)
def test_policies(rates, paper, measured):
    table = rates_of(*rates)
    for policy, wanted in (("paper", paper), ("measured", measured)):
        rule, own = choose_rule(NOTHING, table, EVEN, *TWO_SIDES, policy)
        assert rule == wanted
        np.testing.assert_array_equal(own, table[RULE_NAMES.index(rule)])


def test_the_paper_looks_at_whole_regions_and_the_other_policy_at_cut_ones_too():
    table = rates_of(0.5)
    table[[0, 3]] = [[0.01, 0.30], [0.04, 0.06]]
    assert choose_rule(NOTHING, table, EVEN, *TWO_SIDES, "paper")[0] == "L1"
    assert choose_rule(NOTHING, table, EVEN, *TWO_SIDES, "measured")[0] == "L4"


def test_of_equals_the_cheapest_and_of_equal_cost_the_better_one():
    assert cheapest_of_equals(np.array([0.2, 0.1, 0.1 + EQUAL_ERROR / 2]), [1.0, 3.0, 2.0]) == 2
    assert cheapest_of_equals(np.array([0.2, 0.102, 0.1]), [1.0, 2.0, 2.0]) == 2
    assert cheapest_of_equals(np.array([0.2, 0.1 + 2 * EQUAL_ERROR, 0.1]), [1.0, 2.0, 3.0]) == 2


def test_two_rules_are_used_where_each_is_sure_of_what_the_other_mistakes():
    """L2 knows the even draws and L6 the odd ones; on the others each leans the wrong way."""
    group = np.repeat([0, 1], 40)
    knows = np.arange(80) % 4 < 2
    at = told({"L2": np.where(knows, 5.0, -1.0), "L6": np.where(knows, -1.0, 5.0)}, group, np.arange(80) % 2 == 1)
    rates = np.array([whole_and_cut(at, (r,), EVEN, *TWO_SIDES) for r in range(len(RULE_NAMES))])
    assert expected(rates, "measured").min() == pytest.approx(0.5)
    rule, own = choose_rule(at, rates, EVEN, *TWO_SIDES, "measured")
    assert rule == f"L2{PAIR}L6"
    np.testing.assert_array_equal(own, 0.0)
    alone, _ = choose_rule(at, rates, EVEN, *TWO_SIDES, "paper")
    assert alone in RULE_NAMES  # the paper registers one rule


def test_a_second_rule_that_helps_little_is_not_measured():
    group = np.repeat([0, 1], 50)
    wrong = np.zeros(100, bool)
    wrong[[0, 1, 2, 3, 50, 51, 52, 53]] = True  # 8 %
    helps = np.isin(np.arange(100), [0, 50])  # 2 %: no more than it has to be worth
    cut = np.arange(100) % 2 == 1
    margins = {"L1": np.where(wrong, -1.0, 1.0), "L2": np.where(helps, 2.0, np.where(wrong, -2.0, -0.5))}
    at = told(margins, group, cut)
    rates = np.array([whole_and_cut(at, (r,), EVEN, *TWO_SIDES) for r in range(len(RULE_NAMES))])
    together = float(expected(whole_and_cut(at, (0, 1), EVEN, *TWO_SIDES), "measured"))
    assert float(expected(rates[0], "measured")) - together == pytest.approx(WORTH_A_PAIR, abs=1e-6)
    assert choose_rule(at, rates, EVEN, *TWO_SIDES, "measured")[0] == "L1"


@given(st.integers(0, 10_000))
@settings(max_examples=30, deadline=None)
def test_at_no_branch_does_the_measured_policy_err_more_than_the_papers(seed):
    """On the same draws, by the same measure; up to what counts as equal."""
    at, kept, prior = random_told(seed), np.ones(4, bool), np.array([0.4, 0.3, 0.2, 0.1])
    paper, measured = (choose_rules(four_groups(), at, prior, kept, policy) for policy in ("paper", "measured"))
    ours, theirs = (expected(nodes.whole_and_cut, "measured") for nodes in (measured, paper))
    assert (ours <= theirs + EQUAL_ERROR + 1e-6).all()
    for nodes, policy in ((paper, "paper"), (measured, "measured")):
        np.testing.assert_allclose(nodes.error, expected(nodes.whole_and_cut, policy))
        assert ((nodes.error_interval[:, 0] <= nodes.error) & (nodes.error <= nodes.error_interval[:, 1])).all()
        for k, rule in enumerate(nodes.rule):
            side = nodes.visible[k], nodes.hidden[k]
            here = at.take(np.flatnonzero((side[0] | side[1])[at.group]))
            np.testing.assert_allclose(nodes.whole_and_cut[k], whole_and_cut(here, rules_in(rule), prior, *side))
            for r in range(len(RULE_NAMES)):
                np.testing.assert_allclose(nodes.rule_errors[k, r], whole_and_cut(here, (r,), prior, *side))
    np.testing.assert_array_equal(paper.draws, [50, 25, 25])  # whole ones
    np.testing.assert_array_equal(measured.draws, [100, 50, 50])


def faces(sizes, scatters, seed: int, count: int = 60) -> Draws:
    """`count` draws of every group around its size [mm] (L1, L2) and scatter of normals (L3), every second one cut."""
    rng = np.random.default_rng(seed)
    group = np.repeat(np.arange(len(sizes)), count)
    n = len(group)
    size = (np.array(sizes)[group] * np.exp(rng.normal(0, 0.02, n))).astype(np.float32)
    scatter = (np.array(scatters)[group] + rng.normal(0, 0.01, n)).astype(np.float32)
    zero, normal = np.zeros(n, np.float32), np.tile(np.float32([0, 0, -1]), (n, 1))
    features = RegionFeatures(
        inertia=FaceInertia(zero, np.zeros((n, 2), np.float32), size**4, size**4 / 2, zero, zero + 1 / 3),
        outline=np.tile(size[:, None], (1, 64)), egi=np.zeros((n, 4), np.float32), mass_centre=normal,
        mean_normal=normal, normal_scatter=np.stack([scatter, zero], axis=1) ** 2, area=np.full(n, 500.0, np.float32),
        shares=np.tile(np.float32([1, 0, 0, 0, 0]), (n, 1)),
        characteristic_map=np.zeros((n, RADII, ANGLES, 5), np.float32),
        edge_map=np.zeros((n, RADII, ANGLES, 3), np.float32),
        brothers=np.zeros((n, MOST_BROTHERS, BROTHER_FIELDS), np.float32),
    )  # fmt: skip
    R = np.tile(np.eye(3), (n, 1, 1))
    return Draws(features, group, R, np.arange(n) % 2 == 1, np.zeros((n, 3)), 0)


def models_of(groups: int) -> GroupModels:
    """Groups that show nothing which relations could be compared with."""
    shape = (groups, 1)
    return GroupModels(
        jnp.zeros((*shape, RADII, ANGLES, 3)), jnp.zeros((*shape, RADII, ANGLES, 5)),
        jnp.zeros((*shape, STORED_BROTHERS, BROTHER_FIELDS)), jnp.zeros(shape), jnp.zeros(shape, bool),
        jnp.ones(shape, bool),
    )  # fmt: skip


def measured_of(sizes, scatters, prior=(0.25,) * 4) -> Measured:
    known = distributions(faces(sizes, scatters, 1), models_of(4), 4)
    return measure_rules(faces(sizes, scatters, 2), models_of(4), known, np.array(prior))


def chosen(sizes, scatters, policy="measured", pruned=(False,) * 4, prior=(0.25,) * 4):
    kept = ~np.array(pruned)
    return choose_rules(four_groups(pruned), measured_of(sizes, scatters, prior), np.array(prior), kept, policy)


def test_groups_of_different_size_are_told_by_the_cheapest_rule_without_error():
    nodes = chosen([10, 20, 40, 80], [0.2] * 4)
    assert nodes.branch == ("B0", "B1", "B2")
    assert nodes.rule == ("L1", "L1", "L1")
    np.testing.assert_array_equal(nodes.error, 0.0)
    np.testing.assert_array_equal(nodes.draws, [240, 120, 120])
    # no error in n draws of equal weight: the interval reaches z^2 / (n + z^2)
    np.testing.assert_allclose(nodes.error_interval[:, 1], Z**2 / (nodes.draws + Z**2), rtol=1e-5)
    np.testing.assert_array_equal(nodes.joined, [0, 0, 0])
    np.testing.assert_array_equal(nodes.joined_error[0], 0.0)


def test_groups_of_different_curvature_are_told_by_the_egi():
    nodes = chosen([20] * 4, [0.1, 0.3, 0.5, 0.7])
    assert nodes.rule == ("L3", "L3", "L3")
    np.testing.assert_array_equal(nodes.error, 0.0)
    assert (nodes.rule_errors[:, [0, 1, 3, 4, 5, 6]] > 0.3).all()  # nothing else tells anything


def test_what_no_rule_can_tell_is_a_coins_error_rate():
    nodes = chosen([20] * 4, [0.2] * 4)
    assert (np.abs(nodes.rule_errors - 0.5) < 0.25).all()
    assert (nodes.error_interval[:, 0] < 0.5).all()


def test_two_measurements_tell_what_neither_does_alone():
    """Sizes and scatters each overlap by 1.5 deviations; together they are 2.1 apart."""
    nodes = chosen([20, 20.6, 40, 80], [0.2, 0.215, 0.2, 0.2])
    assert nodes.rule[1] in (f"L1{PAIR}L3", f"L2{PAIR}L3")
    single = expected(nodes.rule_errors[1], "measured").min()
    assert nodes.error[1] < single - WORTH_A_PAIR
    assert chosen([20, 20.6, 40, 80], [0.2, 0.215, 0.2, 0.2], "paper").rule[1] in RULE_NAMES


def test_groups_of_few_views_weigh_little():
    """B0 divides groups 0, 1 from 2, 3; only 1 and 2 look alike."""
    often = chosen([10, 20, 20, 80], [0.2] * 4)
    seldom = chosen([10, 20, 20, 80], [0.2] * 4, prior=(0.49, 0.01, 0.01, 0.49))
    assert often.error[0] > 0.1
    assert seldom.error[0] < 0.03
    assert (often.error_interval[0, 1] - often.error_interval[0, 0]) < 0.2


def test_nothing_is_asked_where_one_side_is_pruned():
    nodes = chosen([10, 20, 40, 80], [0.2] * 4, pruned=(False, True, False, False), prior=(0.4, 0.0, 0.3, 0.3))
    assert nodes.rule == ("L1", PRUNED, "L1")
    assert nodes.draws.tolist() == [180, 0, 120]
    assert np.isnan(nodes.rule_errors[1]).all()
    np.testing.assert_array_equal(nodes.error_interval[1], 0.0)
    np.testing.assert_array_equal(nodes.whole_and_cut[1], 0.0)


def test_the_paper_takes_the_first_rule_that_is_good_enough():
    close, curved = [10, 20, 21.6, 80], [0.1, 0.3, 0.5, 0.7]  # size errs in a few percent, the EGI never
    assert chosen(close, curved, "measured").rule[0] == "L3"
    paper = chosen(close, curved, "paper")
    assert paper.rule[0] == "L1"
    assert 0.0 < paper.error[0] < ERROR_BOUND


def test_distributions_keep_every_draw_under_its_group():
    draws = faces([10, 20], [0.2, 0.4], 0, count=3)
    table = distributions(draws.take(np.array([0, 1, 2, 4])), models_of(3), 3)  # group 1 has one draw left, 2 none
    assert table.rules == RULE_NAMES
    for rule, samples, bandwidth in zip(CLASSIFICATION_RULES, table.samples, table.bandwidth, strict=True):
        assert samples.shape == (3, 3, len(rule.quantity_names) or 3)
        assert bandwidth.shape == samples.shape[2:]
        np.testing.assert_array_equal(np.isnan(samples[..., 0]).sum(axis=1), [0, 2, 3])
    own = 0.25 * np.log(draws.features.inertia.I_max[4] * np.array([1.0, 0.5]))
    np.testing.assert_allclose(table.samples[0][1, 0], own, rtol=1e-5)


def test_draws_are_measured_with_their_group_and_kind():
    draws = faces([10, 20], [0.2, 0.4], 0, count=10)
    said = measure_rules(draws, models_of(2), distributions(draws, models_of(2), 2), EVEN)
    assert said.log_likelihood.shape == (7, 20, 2)
    np.testing.assert_array_equal(said.group, draws.group)
    np.testing.assert_array_equal(said.cut, draws.cut)
    assert np.isfinite(jax.tree.leaves(said)[0]).all()


def test_there_is_no_third_policy():
    with pytest.raises(ItreeError, match="no policy 'best'; use one of measured, paper"):
        choose_rules(four_groups(), random_told(0), np.full(4, 0.25), np.ones(4, bool), "best")
