"""L1-L3: closed forms, what no rotation changes, and kernel densities beside plain NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from itree_kernels.apparent import cast_apparent_shapes

from itree_jax.features.region import measure, measure_batch
from itree_jax.features.window import Window
from itree_jax.tree.appearances import measured, mesh_reach, turned, window_camera
from itree_jax.tree.classification_rules import (
    BEYOND_KERNELS,
    CLASSIFICATION_RULES,
    LEAST_BANDWIDTH,
    RULE_NAMES,
    group_log_likelihood,
    kernel_bandwidth,
    log_likelihoods,
    quantities,
)
from itree_jax.tree.dome import camera_rotation, dome

L1, L2, L3 = CLASSIFICATION_RULES


def rectangle(a: int, b: int, pitch: float = 1.0, size: int = 64) -> Window:
    """Facing the viewer, a x b pixels."""
    mask = np.zeros((size, size), bool)
    mask[size // 2 - b // 2 : size // 2 + b // 2, size // 2 - a // 2 : size // 2 + a // 2] = True
    normals = np.where(mask[..., None], [0.0, 0.0, -1.0], 0.0).astype(np.float32)
    return Window(mask, normals, np.float32(pitch))


def test_rules_have_a_name_a_cost_and_a_name_for_every_number():
    assert RULE_NAMES == ("L1", "L2", "L3")
    features = measure_batch(jax.tree.map(lambda a: np.asarray(a)[None], rectangle(20, 10)))
    for rule, quantity in zip(CLASSIFICATION_RULES, quantities(features), strict=True):
        assert quantity.shape == (1, len(rule.quantity_names))
    costs = [rule.cost for rule in CLASSIFICATION_RULES]
    assert costs == sorted(costs)


@pytest.mark.parametrize(("a", "b", "pitch"), [(30, 10, 1.0), (24, 20, 0.5), (40, 12, 2.0)])
def test_l1_of_a_rectangle_is_a_quarter_log_of_a3b_over_12(a, b, pitch):
    x, y = a * pitch, b * pitch
    quantity = np.asarray(L1.quantity(measure(rectangle(a, b, pitch))))
    np.testing.assert_allclose(quantity, 0.25 * np.log([x**3 * y / 12, y**3 * x / 12]), atol=1e-4)


def test_a_length_twice_as_long_adds_log_2_to_every_size():
    small, large = (measure(rectangle(30, 10, pitch)) for pitch in (1.0, 2.0))
    for rule, sizes in ((L1, [0, 1]), (L2, [0]), (L3, [3])):
        change = np.asarray(rule.quantity(large)) - np.asarray(rule.quantity(small))
        expected = np.zeros(len(change))
        expected[sizes] = np.log(2.0)
        np.testing.assert_allclose(change, expected, atol=1e-4, err_msg=rule.name)


def test_l3_of_a_plane_is_its_area_without_spread():
    spread, major, minor, mass = np.asarray(L3.quantity(measure(rectangle(30, 10))))
    assert max(spread, major, minor) < 2e-3
    assert mass == pytest.approx(0.5 * np.log(300.0), abs=1e-5)


def test_no_rotation_in_the_image_changes_what_the_rules_compare(gem, flash):
    R = turned(camera_rotation(dome(1).directions[[3, 20, 47]]), 24)
    camera, pitch = window_camera(mesh_reach(gem))
    masks, normals = [], []
    for view in R:
        shapes = cast_apparent_shapes(
            gem, view, np.zeros((24, 3)), camera, flash.light_directions, flash.slant_limit
        )
        masks += list(shapes.detectable)
        normals += list(np.where(shapes.detectable[..., None], shapes.normal, 0.0))
    for rule, quantity in zip(CLASSIFICATION_RULES, quantities(measured(masks, normals, pitch)), strict=True):
        of_view = np.asarray(quantity).reshape(3, 24, -1)
        raster = of_view.std(axis=1).max()
        between = np.linalg.norm(np.diff(of_view.mean(axis=1), axis=0), axis=1).min()
        assert raster < 0.02, rule.name  # 2 % of a length
        assert between > 3.0 * raster, rule.name


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


def test_all_rules_at_once_equal_each_on_its_own(three_groups):
    quantity, samples, bandwidth = three_groups
    other = (quantity[:, :1], samples[..., :1], bandwidth[:1])
    both = log_likelihoods(*zip(three_groups, other, strict=True))
    assert both.shape == (2, 30, 3)
    for together, alone in zip(both, (three_groups, other), strict=True):
        np.testing.assert_allclose(together, group_log_likelihood(*map(jnp.asarray, alone)), atol=1e-5)


def test_the_bandwidth_is_scotts_on_the_spread_within_groups():
    rng = np.random.default_rng(0)
    group = np.repeat([0, 1], 500)
    # the distance between groups is no spread
    samples = rng.normal(0.0, [0.4, 1e-4], (1000, 2)) + 100.0 * group[:, None]
    expected = 0.4 * 500 ** (-1 / 6)
    np.testing.assert_allclose(kernel_bandwidth(samples, group), [expected, LEAST_BANDWIDTH], rtol=0.05)
