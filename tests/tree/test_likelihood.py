"""Kernel densities beside plain NumPy: of vectors, and of agreements against the agreements of other groups."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from itree_jax.tree.likelihood import (
    BEYOND_KERNELS,
    LEAST_BANDWIDTH,
    SHARES,
    group_log_likelihood,
    kernel_bandwidth,
    left_out_likelihood,
    relational_bandwidth,
    relational_log_likelihood,
)


def kernel_density(quantity: np.ndarray, samples: np.ndarray, bandwidth: np.ndarray) -> np.ndarray:
    """The twin: log of the mean over a group's draws of Gaussian kernels of height 1."""
    out = np.zeros((len(quantity), len(samples)))
    for i, q in enumerate(quantity):
        for g, own in enumerate(samples):
            own = own[~np.isnan(own[:, 0])]
            kernels = np.exp(-0.5 * (((q - own) / bandwidth) ** 2).sum(axis=1))
            out[i, g] = np.log(max(kernels.sum(), np.exp(BEYOND_KERNELS)) / max(len(own), 1))
    return out


@pytest.fixture(scope="module")
def three_groups():
    """Gaussian clouds of 40, 25 and 1 draws in two dimensions; NaN rows pad."""
    rng = np.random.default_rng(1)
    samples = np.full((3, 40, 2), np.nan, np.float32)
    for group, (count, middle) in enumerate(((40, 0.0), (25, 0.5), (1, 3.0))):
        samples[group, :count] = rng.normal(middle, 0.3, (count, 2))
    quantity = rng.normal(0.3, 0.6, (30, 2)).astype(np.float32)
    return quantity, samples, np.array([0.1, 0.15], np.float32)


def test_the_likelihood_is_a_kernel_density(three_groups):
    likelihood = np.asarray(group_log_likelihood(*map(jnp.asarray, three_groups)))
    np.testing.assert_allclose(likelihood, kernel_density(*(a.astype(float) for a in three_groups)), atol=1e-3)


def test_far_from_all_draws_every_group_is_as_unlikely(three_groups):
    _, samples, bandwidth = three_groups
    far = np.asarray(group_log_likelihood(jnp.full((1, 2), 99.0), jnp.asarray(samples), jnp.asarray(bandwidth)))
    np.testing.assert_allclose(far[0], BEYOND_KERNELS - np.log([40, 25, 1]), rtol=1e-5)


def test_a_groups_own_draws_are_likelier_under_it_on_average(three_groups):
    _, samples, bandwidth = three_groups
    rng = np.random.default_rng(2)  # other draws than those of the kernels
    for group, middle in ((0, 0.0), (1, 0.5)):
        fresh = rng.normal(middle, 0.3, (200, 2)).astype(np.float32)
        mean = np.asarray(group_log_likelihood(*map(jnp.asarray, (fresh, samples, bandwidth)))).mean(axis=0)
        assert mean.argmax() == group


def scott(samples: np.ndarray, group: np.ndarray) -> np.ndarray:
    within = np.sqrt(np.mean([samples[group == g].var(axis=0) for g in np.unique(group)], axis=0))
    return (len(samples) / len(np.unique(group))) ** (-1 / (samples.shape[1] + 4)) * within


def test_the_bandwidth_is_scotts_on_the_spread_within_groups_or_a_little_less():
    rng = np.random.default_rng(0)
    group = np.repeat([0, 1], 300)
    # the distance between groups is no spread; what hardly varies has the least bandwidth
    samples = rng.normal(0.0, [0.4, 1e-4], (600, 2)) + 100.0 * group[:, None]
    found = kernel_bandwidth(samples, group)
    expected = 0.4 * 300 ** (-1 / 6)
    assert 0.65 * expected < found[0] < 1.1 * expected
    assert found[1] == pytest.approx(LEAST_BANDWIDTH)


def test_two_shapes_of_a_group_ask_for_kernels_as_narrow_as_each():
    """Two clumps: their distance is no spread of a kernel, which Scott's rule takes it for."""
    rng = np.random.default_rng(0)
    group = np.repeat([0, 1], 200)
    clump = rng.integers(0, 2, 400)
    samples = rng.normal(0.0, 0.05, (400, 1)) + 2.0 * clump[:, None]
    found = kernel_bandwidth(samples, group)
    np.testing.assert_allclose(found, SHARES[-1] * scott(samples, group), rtol=1e-5)
    # wider clumps, wider kernels
    wide = rng.normal(0.0, 0.4, (400, 1)) + 2.0 * clump[:, None]
    assert kernel_bandwidth(wide, group)[0] > 1.5 * found[0]


def left_out_twin(groups: list[np.ndarray], bandwidth: np.ndarray) -> float:
    total = 0.0
    for own in groups:
        for k in range(len(own)):
            others = np.delete(own, k, axis=0)
            kernels = np.exp(-0.5 * (((own[k] - others) / bandwidth) ** 2).sum(axis=1)).sum()
            total += np.log(max(kernels, np.exp(BEYOND_KERNELS)) / len(others)) - np.log(bandwidth).sum()
    return total


@given(st.integers(0, 1000), st.floats(0.02, 2.0))
@settings(max_examples=20)
def test_a_draw_is_left_out_of_its_own_density(seed, width):
    rng = np.random.default_rng(seed)
    groups = [rng.normal(size=(n, 2)) for n in (9, 2)]
    bandwidth = np.array([width, 0.5])
    assert left_out_likelihood(groups, bandwidth) == pytest.approx(left_out_twin(groups, bandwidth), abs=1e-6)
    # a draw without others says nothing
    assert left_out_likelihood([*groups, rng.normal(size=(1, 2))], bandwidth) == left_out_likelihood(groups, bandwidth)


@given(st.integers(0, 1000))
@settings(max_examples=20)
def test_of_the_bandwidths_tried_the_likeliest_is_taken(seed):
    rng = np.random.default_rng(seed)
    group = np.repeat([0, 1], 15)
    samples = rng.normal(size=(30, 2)) ** 3
    widths = [np.maximum(s * scott(samples, group), LEAST_BANDWIDTH) for s in SHARES]
    likelihoods = [left_out_twin([samples[:15], samples[15:]], w) for w in widths]
    np.testing.assert_allclose(kernel_bandwidth(samples, group), widths[int(np.argmax(likelihoods))], rtol=1e-5)


def test_agreements_have_a_bandwidth_each():
    rng = np.random.default_rng(0)
    group = np.repeat([0, 1], 50)
    samples = rng.normal(0.0, [0.3, 0.1], (100, 2))
    each = [kernel_bandwidth(samples[:, k : k + 1], group)[0] for k in range(2)]
    np.testing.assert_array_equal(relational_bandwidth(samples, group), each)


def relational_twin(agreement, samples, bandwidth, prior) -> np.ndarray:
    """log p(agreement with k | k) - log sum_g share_g p(agreement with k | g), g other than k."""
    groups = len(samples)
    out = np.zeros(groups)
    for k in range(groups):
        density = np.exp(kernel_density(agreement[k : k + 1][None], samples[:, :, k : k + 1], bandwidth[k : k + 1])[0])
        others = [g for g in range(groups) if g != k]
        share = np.maximum(prior[others], 1e-12)
        out[k] = np.log(density[k] / (share @ density[others] / share.sum()))
    return out


@pytest.fixture(scope="module")
def agreements():
    """Three groups of 30, 20 and 12 draws: the agreement with a group is larger for its own."""
    rng = np.random.default_rng(3)
    samples = np.full((3, 30, 3), np.nan, np.float32)
    for g, count in enumerate((30, 20, 12)):
        samples[g, :count] = rng.normal(0.4 + 0.3 * (np.arange(3) == g), 0.08, (count, 3))
    return samples, np.array([0.05, 0.06, 0.04], np.float32), np.array([0.5, 0.3, 0.2], np.float32)


def test_an_agreement_is_as_likely_as_it_is_seldom_with_other_groups(agreements):
    rng = np.random.default_rng(0)
    for one in rng.uniform(0.1, 1.0, (10, 3)).astype(np.float32):
        found = relational_log_likelihood(jnp.asarray(one), *map(jnp.asarray, agreements))
        np.testing.assert_allclose(found, relational_twin(one, *agreements), atol=2e-3)


def test_a_groups_own_draws_speak_for_it_and_others_against(agreements):
    rng = np.random.default_rng(9)
    for g in range(3):
        fresh = rng.normal(0.4 + 0.3 * (np.arange(3) == g), 0.08, (50, 3)).astype(np.float32)
        ratio = np.array([relational_log_likelihood(jnp.asarray(f), *map(jnp.asarray, agreements)) for f in fresh])
        assert (ratio[:, g] > 0).mean() > 0.8
        assert (np.delete(ratio, g, axis=1) < 0).mean() > 0.8


def test_a_group_without_views_is_no_background(agreements):
    samples, bandwidth, _ = agreements
    one = jnp.asarray(np.float32([0.6, 0.5, 0.4]))
    without = relational_log_likelihood(
        one, jnp.asarray(samples), jnp.asarray(bandwidth), jnp.asarray([0.625, 0.375, 0.0])
    )
    pair = relational_twin(np.asarray(one)[:2], samples[:2, :, :2], bandwidth[:2], np.array([0.625, 0.375]))
    np.testing.assert_allclose(without[:2], pair, atol=2e-3)


def test_one_group_alone_is_compared_with_nothing():
    samples = jnp.asarray(np.random.default_rng(0).uniform(size=(1, 5, 1)), jnp.float32)
    found = relational_log_likelihood(jnp.asarray([0.5]), samples, jnp.asarray([0.1]), jnp.asarray([1.0]))
    np.testing.assert_array_equal(found, [0.0])
