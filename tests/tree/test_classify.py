"""Classification at run time: a distribution over the kept groups that is the product along the path."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from itree_kernels.mesh import ray_mesh

from itree_jax.tree.classification_rules import RULE_NAMES, log_likelihoods
from itree_jax.tree.classify import CUT_REGION_ERROR, PRUNED_PRIOR, classification_arrays, classify
from itree_jax.tree.dome import dome, parent_view
from itree_jax.tree.draws import Draws, noisy_draws, random_attitudes
from itree_jax.tree.tree import PRUNED


@pytest.fixture(scope="module")
def arrays(paper_tree):
    return classification_arrays(paper_tree)


@pytest.fixture(scope="module")
def draws(paper_tree) -> Draws:
    """30 regions of every kept group, of another seed than any of the tree's."""
    part, parent = paper_tree.part, parent_view(1, 2)
    group = paper_tree.groups.group_of_view[parent]
    kept = ~paper_tree.groups.pruned[group]
    rng = np.random.default_rng(77)
    R, of_draw = random_attitudes(dome(2).triangles[kept], group[kept], 30, rng)
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle)
    return noisy_draws(mesh, paper_tree.sensor, R, of_draw, rng)


@pytest.fixture(scope="module")
def answer(draws, arrays):
    return classify(draws.features, arrays)


def test_probabilities_of_the_kept_groups_sum_to_one(answer, paper_tree):
    kept = ~paper_tree.groups.pruned
    probability = np.exp(np.asarray(answer.group_log_probability))
    np.testing.assert_allclose(probability[:, kept].sum(axis=1), 1.0, rtol=1e-5)
    np.testing.assert_allclose(probability[:, ~kept], PRUNED_PRIOR, rtol=1e-5)


def test_a_group_has_the_product_of_what_its_path_gave_it(answer, arrays, paper_tree):
    """The twin walks from the root to every leaf, node by node."""
    nodes, kept = paper_tree.nodes, ~paper_tree.groups.pruned
    likelihood = np.asarray(log_likelihoods(answer.quantities, arrays.samples, arrays.bandwidth), float)
    prior = np.where(kept, paper_tree.groups.view_count, 0) / paper_tree.groups.view_count[kept].sum()
    for region in range(0, likelihood.shape[1], 13):
        product = np.where(kept, 1.0, 0.0)
        for k, rule in enumerate(nodes.rule):
            if rule == PRUNED:
                continue
            weight = prior * np.exp(likelihood[RULE_NAMES.index(rule), region])
            p = weight[nodes.visible[k]].sum() / weight[nodes.visible[k] | nodes.hidden[k]].sum()
            error = min(max(float(nodes.error[k]), CUT_REGION_ERROR), 0.5)
            believed = (1 - error) * p + error * (1 - p)
            product *= np.where(nodes.visible[k], believed, np.where(nodes.hidden[k], 1 - believed, 1.0))
            assert answer.node_margin[region, k] == pytest.approx(np.log(p / (1 - p)), abs=2e-3)
        expected = product[kept] / product[kept].sum()
        np.testing.assert_allclose(np.exp(answer.group_log_probability[region])[kept], expected, rtol=1e-3)


def test_rules_that_err_as_often_as_not_divide_every_node_in_halves(arrays, draws, paper_tree):
    useless = classify(draws.features, arrays._replace(error=jnp.full_like(arrays.error, 0.5)))
    decided = np.array([rule != PRUNED for rule in paper_tree.nodes.rule])
    depth = (paper_tree.nodes.visible | paper_tree.nodes.hidden)[decided].sum(axis=0)
    kept = ~paper_tree.groups.pruned
    expected = 0.5 ** depth[kept] / np.sum(0.5 ** depth[kept])
    probability = np.exp(np.asarray(useless.group_log_probability))[:, kept]
    np.testing.assert_allclose(probability, np.tile(expected, (len(probability), 1)), rtol=1e-5)


def test_no_node_is_believed_further_than_cut_regions_allow(answer, paper_tree):
    """No group falls under the product of the least error rates of its nodes, whatever was measured."""
    decided = np.array([rule != PRUNED for rule in paper_tree.nodes.rule])
    depth = (paper_tree.nodes.visible | paper_tree.nodes.hidden)[decided].sum(axis=0)
    kept = ~paper_tree.groups.pruned
    probability = np.exp(np.asarray(answer.group_log_probability))
    assert (probability >= 0.999 * CUT_REGION_ERROR**depth)[:, kept].all()


def test_a_pruned_node_says_nothing(answer, paper_tree):
    pruned = np.array([rule == PRUNED for rule in paper_tree.nodes.rule])
    assert pruned.any()
    np.testing.assert_array_equal(answer.node_margin[:, pruned], 0.0)
    assert np.isfinite(answer.node_margin).all()


def test_a_region_makes_its_own_group_likelier_than_regions_of_other_groups_do(answer, draws):
    probability = np.exp(np.asarray(answer.group_log_probability))
    groups = np.unique(draws.group)
    assert len(groups) == 5
    for g in groups:
        own = draws.group == g
        assert probability[own, g].mean() > probability[~own, g].mean()


def test_a_region_makes_its_own_group_likelier_than_before_on_average(answer, draws, paper_tree):
    kept = ~paper_tree.groups.pruned
    prior = paper_tree.groups.view_count / paper_tree.groups.view_count[kept].sum()
    own = np.asarray(answer.group_log_probability)[np.arange(len(draws.group)), draws.group]
    assert (own - np.log(prior[draws.group])).mean() > 0.2  # log-likelihood gained


def test_a_region_is_classified_alike_whatever_else_is_in_the_batch(answer, draws, arrays):
    for k in (0, 41):
        alone = classify(jax.tree.map(lambda a, k=k: jnp.asarray(a[k : k + 1]), draws.features), arrays)
        for one, many in zip(jax.tree.leaves(alone), jax.tree.leaves(answer), strict=True):
            np.testing.assert_allclose(one[0], many[k], rtol=1e-4, atol=1e-4)


def test_an_empty_region_gets_numbers_too(arrays, draws):
    nothing = jax.tree.map(lambda a: jnp.zeros_like(a[:1]), draws.features)
    for leaf in jax.tree.leaves(classify(nothing, arrays)):
        assert np.isfinite(leaf).all()
