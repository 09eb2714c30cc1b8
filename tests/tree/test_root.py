"""The root of a forest: a distribution over parts that keeps the true one, and an honest account of its errors.

Other parts are the paper's with its draws moved: as much larger as one likes, or the same.
"""

from dataclasses import replace

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from itree_kernels.errors import ItreeError
from itree_kernels.mesh import ray_mesh

from itree_jax.root_answer import RootAnswer, root_quantities, root_steps
from itree_jax.tree.draws import draw_regions
from itree_jax.tree.forest import compile_forest
from itree_jax.tree.root import (
    LEAST_BEHIND,
    LEFT_OUT,
    ROOT_RULES,
    behind_best,
    log_density,
    measure_root,
    part_draws,
    parts_left,
    told_wrong,
    weighted_quantile,
    with_none_weighed,
)


def moved(tree, by: float, obj_id: int):
    """Another part whose every measurement is larger by so many of this part's standard deviations."""
    known = tree.distributions
    samples = tuple(s + by * np.nanstd(s, axis=(0, 1)).astype(np.float32) for s in known.samples)
    part = replace(tree.part, name=f"moved by {by}", vertices=tree.part.vertices * (1.0 + 0.1 * by))
    return replace(tree, obj_id=obj_id, part=part, distributions=replace(known, samples=samples))


@pytest.fixture(scope="module")
def three(paper_tree):
    """The paper's part, one a little larger, one much larger."""
    return [paper_tree, moved(paper_tree, 1.0, 2), moved(paper_tree, 8.0, 3)]


@pytest.fixture(scope="module")
def root(three):
    return measure_root(three)


@pytest.fixture(scope="module")
def fresh(paper_tree):
    """Regions of the paper's part that no tree has seen, with the weight of each."""
    part = paper_tree.part
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle)
    draws = draw_regions(mesh, paper_tree.sensor, paper_tree.groups, 40, np.random.default_rng(77))
    views = paper_tree.groups.view_count / np.bincount(draws.group, minlength=paper_tree.groups.group_count).clip(1)
    weight = views[draws.group] / views[draws.group].sum()
    return tuple(np.asarray(q) for q in root_quantities(jax.tree.map(np.asarray, draws.features))), weight


def test_what_the_root_says_sums_to_one(root, fresh):
    posterior = root.log_posterior([fresh[0]] * 3)
    np.testing.assert_allclose(np.exp(posterior).sum(axis=1), 1.0, rtol=1e-9)


def test_a_lone_part_is_every_region(paper_tree, fresh):
    root = measure_root([paper_tree])
    far = tuple(q + 100.0 for q in fresh[0])
    for measured in (fresh[0], far):
        posterior = root.log_posterior([measured])
        np.testing.assert_array_equal(posterior[:, 0], 0.0)
        assert root.left(posterior).all()
    assert (root.error, root.left_out, root.mean_left) == (0.0, 0.0, pytest.approx(1.0))


def test_a_part_keeps_its_own_fresh_regions(root, fresh):
    """All but the share that was measured to be left out, within what so many draws can tell (three sigma)."""
    measured, weight = fresh
    left = root.left(root.log_posterior([measured] * 3))
    lost = weight @ ~left[:, 0]
    sigma = np.sqrt(LEFT_OUT * (1 - LEFT_OUT) * np.sum(weight**2))
    assert lost <= LEFT_OUT + 3 * sigma
    assert left[:, 2].mean() < 0.2  # and parts that are far from it are not asked for


def test_the_account_adds_up(root):
    np.testing.assert_allclose(root.confusion.sum(axis=1), 1.0)
    assert root.error == pytest.approx(1.0 - np.diagonal(root.confusion).mean(), abs=1e-3)
    assert root.left_out <= LEFT_OUT + 1e-9
    assert 1.0 - root.left_out <= root.mean_left <= 3.0
    assert root.behind >= LEAST_BEHIND
    assert root.error <= root.rule_errors.min() + 0.005  # rules together are taken only where they help


def test_twins_are_not_told_apart_and_both_stay(paper_tree, fresh):
    twin = replace(paper_tree, obj_id=2)
    root = measure_root([paper_tree, twin])
    assert root.error >= 0.5
    posterior = root.log_posterior([fresh[0]] * 2)
    np.testing.assert_array_equal(posterior[:, 0], posterior[:, 1])
    left = root.left(posterior)
    np.testing.assert_array_equal(left[:, 0], left[:, 1])
    assert fresh[1] @ left[:, 0] > 1.0 - 2 * LEFT_OUT


def test_parts_far_from_each_other_are_told(paper_tree):
    root = measure_root([paper_tree, moved(paper_tree, 20.0, 2)])
    assert root.confusion[0, 1] == root.confusion[1, 0] == 0.0
    assert root.mean_left < 1.1


def test_what_is_like_no_part_is_left_to_none(root, fresh):
    """Far from all parts, in every quantity."""
    strange = tuple(q + 1e3 for q in fresh[0])
    posterior = root.log_posterior([strange] * 3)
    assert (posterior.argmax(axis=1) == 3).all()
    assert not root.left(posterior).any()


def test_the_order_of_the_trees_does_not_matter(three, root, fresh):
    turned = measure_root([three[2], three[0], three[1]])
    assert turned.rule == root.rule
    assert turned.error == pytest.approx(root.error)
    assert turned.behind == pytest.approx(root.behind)
    posterior = root.log_posterior([fresh[0]] * 3)
    np.testing.assert_allclose(turned.log_posterior([fresh[0]] * 3), posterior[:, [2, 0, 1, 3]], atol=1e-9)


def test_the_order_of_the_trees_does_not_show_in_a_decision_path(paper_tree, three, fresh):
    """Nor where parts are as likely as each other: twins under two names."""
    twin = replace(paper_tree, obj_id=4, part=replace(paper_tree.part, name="a twin"))
    trees, order = [*three[:2], twin], [2, 0, 1]
    regions = tuple(q[:20] for q in fresh[0])

    def said_by(trees):
        root, measured = measure_root(trees), (regions,) * len(trees)
        posterior = root.log_posterior(measured)
        return root, RootAnswer(posterior, root.left(posterior), measured)

    (root, said), (turned, said_turned) = said_by(trees), said_by([trees[k] for k in order])
    assert said.left[:, [0, 2]].all(axis=1).any()
    for region in range(20):
        for place, part in enumerate(order):
            assert repr(root_steps(root, said, region, part)) == repr(root_steps(turned, said_turned, region, place))


def test_a_part_is_its_groups_by_their_share_of_the_views(paper_tree):
    groups, draws = paper_tree.groups, part_draws(paper_tree)
    assert draws.weight.sum() == pytest.approx(1.0)
    assert all(len(s) == len(draws.weight) and np.isfinite(s).all() for s in draws.samples)
    kept = np.where(groups.pruned, 0, groups.view_count)
    of_group = np.array([
        draws.weight[np.isin(draws.samples[0][:, 0], paper_tree.distributions.samples[0][g, :, 0])].sum()
        for g in range(groups.group_count)
    ])  # fmt: skip
    np.testing.assert_allclose(of_group, kept / kept.sum(), atol=1e-9)


def test_one_kernel_is_a_normal_distribution():
    q, s, h = np.array([[1.0, 2.0]]), np.array([[0.0, 0.0]]), np.array([0.5, 2.0])
    np.testing.assert_allclose(log_density(q, s, h, np.ones(1)), -0.5 * (4.0 + 1.0) - np.log(1.0))
    both = log_density(q, np.concatenate([s, q]), h, np.array([0.25, 0.75]))
    np.testing.assert_allclose(both, np.log(0.25 * np.exp(-2.5) + 0.75))


def test_as_likely_parts_share_a_draw():
    said = np.array([[0.0, 0.0, -5.0], [0.0, 0.0, -5.0], [-9.0, 0.0, -5.0], [-9.0, -7.0, 0.0]])
    true, weight = np.array([0, 1, 0, 1]), np.full(4, 0.25)
    assert told_wrong(said, true, weight) == pytest.approx((0.5 + 0.5 + 1.0 + 1.0) / 4)
    np.testing.assert_array_equal(behind_best(said)[3], [9.0, 7.0, 0.0])
    np.testing.assert_array_equal(parts_left(said, 7.0), [[1, 1], [1, 1], [0, 1], [0, 1]])
    np.testing.assert_allclose(with_none_weighed(said)[:, 2] - said[:, 2], np.log(2.0))


@given(st.lists(st.tuples(st.floats(-50, 50), st.floats(0.01, 1)), min_size=1, max_size=30), st.floats(0.01, 1.0))
def test_a_quantile_is_the_least_value_that_so_much_weight_does_not_exceed(pairs, share):
    values, weight = (np.array(x) for x in zip(*pairs, strict=True))
    q = weighted_quantile(values, weight, share)
    assert weight[values <= q].sum() >= share * weight.sum() - 1e-9
    assert weight[values < q].sum() < share * weight.sum() + 1e-9


def test_trees_that_make_no_forest_are_refused(paper_tree):
    with pytest.raises(ItreeError, match="at least one tree"):
        compile_forest([])
    with pytest.raises(ItreeError, match=r"'ikeuchi-1987' and 'moved by 1.0', .* are both of object 1; compile one"):
        compile_forest([paper_tree, moved(paper_tree, 1.0, 1)])
    narrow = replace(paper_tree, obj_id=2, sensor=replace(paper_tree.sensor, slant_limit=0.5))
    with pytest.raises(ItreeError, match=r"object 2\) was compiled for another sensor: its slant limit"):
        compile_forest([paper_tree, narrow])
    assert compile_forest([paper_tree]).trees == (paper_tree,)
    assert len(ROOT_RULES) == 5
