"""Classification at run time: a distribution over the kept groups that is the product along the path."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from itree_kernels.mesh import ray_mesh

from itree_jax.tree.classification_rules import PAIR, RULE_NAMES, log_likelihoods
from itree_jax.tree.classify import LEAST_ERROR, PRUNED_PRIOR, classification_arrays, classify
from itree_jax.tree.dome import dome, parent_view
from itree_jax.tree.draws import Draws, noisy_draws, random_attitudes
from itree_jax.tree.error_rates import side_margin
from itree_jax.tree.joining import tops
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


def decisions_of(tree) -> list[tuple[str, float, np.ndarray]]:
    """Rule, believed error and sides of every many-way node, from the branches themselves."""
    nodes, kept = tree.nodes, ~tree.groups.pruned
    found = []
    for top in sorted({int(t) for t, rule in zip(nodes.joined, nodes.rule, strict=True) if rule != PRUNED}):
        paths = {}
        for g in np.flatnonzero(kept & (nodes.visible[top] | nodes.hidden[top])):
            member = [k for k in range(len(nodes.branch)) if nodes.joined[k] == top]
            paths[g] = tuple(0 if nodes.visible[k, g] else 1 if nodes.hidden[k, g] else 2 for k in member)
        order = sorted(set(paths.values()))
        side = np.full(len(kept), -1)
        for g, path in paths.items():
            side[g] = order.index(path)
        error = min(max(float(nodes.joined_error[top].mean()), LEAST_ERROR), 1.0 - 1.0 / len(order))
        found.append((nodes.rule[top], error, side))
    return found


def classification_twin(tree, likelihood: np.ndarray) -> np.ndarray:
    """Probabilities of the groups from log-likelihoods [rules, groups], node by node."""
    kept = ~tree.groups.pruned
    prior = np.where(kept, tree.groups.view_count, 0) / tree.groups.view_count[kept].sum()
    product = np.where(kept, 1.0, 0.0)
    for rule, error, side in decisions_of(tree):
        weight = prior * np.exp(likelihood[[RULE_NAMES.index(r) for r in rule.split(PAIR)]].sum(axis=0))
        p = np.array([weight[side == s].sum() for s in range(side.max() + 1)])
        p = p / p.sum()
        # a wrong answer is any other side's alike
        believed = (1 - error) * p + error * (1 - p) / (len(p) - 1)
        product *= np.where(side >= 0, believed[side], 1.0)
    return product[kept] / product[kept].sum()


def likelihoods(answer, arrays) -> np.ndarray:
    return np.asarray(log_likelihoods(answer.quantities, arrays.samples, arrays.bandwidth, arrays.prior), float)


def test_a_group_has_the_product_of_what_its_path_gave_it(answer, arrays, paper_tree):
    likelihood = likelihoods(answer, arrays)
    kept = ~paper_tree.groups.pruned
    for region in range(0, likelihood.shape[1], 7):
        expected = classification_twin(paper_tree, likelihood[:, region])
        np.testing.assert_allclose(np.exp(answer.group_log_probability[region])[kept], expected, rtol=2e-3)


def test_a_margin_is_that_of_the_branchs_own_rule(answer, arrays, paper_tree):
    nodes, kept = paper_tree.nodes, ~paper_tree.groups.pruned
    likelihood, prior = likelihoods(answer, arrays), np.asarray(arrays.prior, float)
    for k in np.flatnonzero([rule != PRUNED for rule in nodes.rule]):
        said = likelihood[[RULE_NAMES.index(r) for r in nodes.rule[k].split(PAIR)]].sum(axis=0)
        margin = side_margin(said, prior, nodes.visible[k] & kept, nodes.hidden[k] & kept)
        np.testing.assert_allclose(answer.node_margin[:, k], margin, atol=5e-3)


def test_nodes_joined_and_pairs_of_rules_are_walked_too(paper_tree, draws):
    """One three-way node of a pair, then single rules."""
    nodes = paper_tree.nodes
    rule = tuple(r if r == PRUNED else "L1+L4" if k < 2 else "L3" for k, r in enumerate(nodes.rule))
    joined = tops(nodes.parent, rule)
    assert joined[1] == 0
    error = np.where(joined[:, None] == np.arange(len(rule))[:, None], 0.2, 0.0).astype(np.float32).repeat(2, axis=1)
    tree = replace(paper_tree, nodes=replace(nodes, rule=rule, joined=joined, joined_error=error))
    arrays = classification_arrays(tree)
    assert int(arrays.side.shape[1]) >= 3
    answer = classify(draws.features, arrays)
    likelihood, kept = likelihoods(answer, arrays), ~tree.groups.pruned
    for region in range(0, likelihood.shape[1], 11):
        expected = classification_twin(tree, likelihood[:, region])
        np.testing.assert_allclose(np.exp(answer.group_log_probability[region])[kept], expected, rtol=2e-3)


def test_rules_that_always_err_divide_every_node_evenly(arrays, draws, paper_tree):
    useless = classify(draws.features, arrays._replace(error=jnp.ones_like(arrays.error)))
    kept = ~paper_tree.groups.pruned
    expected = np.ones(kept.sum())
    for _, _, side in decisions_of(paper_tree):
        expected *= np.where(side >= 0, 1.0 / (side.max() + 1), 1.0)[kept]
    probability = np.exp(np.asarray(useless.group_log_probability))[:, kept]
    np.testing.assert_allclose(probability, np.tile(expected / expected.sum(), (len(probability), 1)), rtol=1e-5)


def test_no_node_is_believed_further_than_the_light_of_a_bin_allows(answer, paper_tree):
    """No group falls under the product of the least error rates of its nodes, whatever was measured."""
    kept = ~paper_tree.groups.pruned
    least = np.ones(len(kept))
    for _, _, side in decisions_of(paper_tree):
        least *= np.where(side >= 0, LEAST_ERROR / max(side.max(), 1), 1.0)
    probability = np.exp(np.asarray(answer.group_log_probability))
    assert (probability >= 0.999 * least)[:, kept].all()


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
