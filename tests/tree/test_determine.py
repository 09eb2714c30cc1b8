"""Determination at run time: two lists of candidate attitudes of every region."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from itree_jax.tree.determine import determination_arrays, determine, remaining_freedom

BY_SHAPE, BY_EGI = 6, 9


@pytest.fixture(scope="module")
def arrays(paper_tree):
    return determination_arrays(paper_tree)


@pytest.fixture(scope="module")
def regions(paper_tree, as_features):
    """Five appearances as a batch of regions, without any idea of their group."""
    table = paper_tree.appearances
    rows = np.linspace(0, len(table.attitude) - 1, 5).astype(int)
    features = jax.tree.map(lambda *a: jnp.stack([jnp.asarray(x) for x in a]), *(as_features(table, r) for r in rows))
    return rows, features, jnp.zeros((5, paper_tree.groups.group_count))


@pytest.fixture(scope="module")
def found(regions, arrays):
    _, features, prior = regions
    return determine(features, prior, arrays, BY_SHAPE, BY_EGI)


def test_every_region_has_both_lists_best_first(found, paper_tree):
    assert found.R_ray_obj.shape == (5, BY_SHAPE + BY_EGI, 3, 3)
    score = np.asarray(found.log_likelihood)
    assert np.isfinite(score).all()
    for part in (score[:, :BY_SHAPE], score[:, BY_SHAPE:]):
        assert (np.diff(part, axis=1) <= 1e-6).all()
    assert (found.row >= 0).all()
    assert (found.row < len(paper_tree.appearances.attitude)).all()


def test_candidates_are_rotations(found):
    R = np.asarray(found.R_ray_obj)
    np.testing.assert_allclose(R @ R.swapaxes(-1, -2), np.broadcast_to(np.eye(3), R.shape), atol=1e-5)
    np.testing.assert_allclose(np.linalg.det(R), 1.0, atol=1e-5)


def test_an_appearance_finds_itself_without_a_turn(regions, found, paper_tree):
    rows, _, _ = regions
    table = paper_tree.appearances
    for region, row in enumerate(rows):
        for part in (slice(0, BY_SHAPE), slice(BY_SHAPE, None)):
            best = found.log_likelihood[region, part].max()
            assert best > -0.51  # all that it loses, if any, is for mass that the region might have had
        own = np.flatnonzero(np.asarray(found.row[region, :BY_SHAPE]) == row)
        assert len(own) == 1
        R_true = table.R_cam_obj[table.attitude[row]]
        np.testing.assert_allclose(found.R_ray_obj[region, own[0]], R_true, atol=2e-3)


def test_a_region_is_determined_alike_whatever_else_is_in_the_batch(regions, found, arrays):
    _, features, prior = regions
    alone = determine(jax.tree.map(lambda a: a[3:4], features), prior[3:4], arrays, BY_SHAPE, BY_EGI)
    np.testing.assert_allclose(alone.log_likelihood[0], found.log_likelihood[3], atol=1e-4)
    np.testing.assert_array_equal(alone.row[0], found.row[3])


def test_a_group_that_is_ruled_out_has_no_candidate(regions, arrays):
    _, features, prior = regions
    group = int(arrays.rows.group[0])
    only = jnp.full_like(prior, -jnp.inf).at[:, group].set(0.0)
    candidates = determine(features, only, arrays, BY_SHAPE, BY_EGI)
    offered = np.isfinite(candidates.log_likelihood)
    assert offered.any()
    assert (np.asarray(arrays.rows.group)[candidates.row][offered] == group).all()


def test_no_more_are_asked_for_than_there_are_appearances(regions, arrays):
    _, features, prior = regions
    count = len(arrays.rows.area)
    one = jax.tree.map(lambda a: a[:1], features)
    candidates = determine(one, prior[:1], arrays, count + 5, 1)
    assert candidates.row.shape == (1, count + 1)


def test_the_freedom_left_in_words():
    assert [remaining_freedom(k) for k in (0, 1, 2)] == ["rotation open", "unique", "2 rotations"]
