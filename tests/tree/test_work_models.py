"""Work models of groups: exemplars agree best with their own group; brothers count for and against."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from itree_jax.features.polar import ANGLES, RADII
from itree_jax.features.relation import BROTHER_FIELDS, MOST_BROTHERS
from itree_jax.tree.appearances import STORED_BROTHERS
from itree_jax.tree.work_models import (
    ALONE,
    EXEMPLARS,
    TURN_TOLERANCE,
    GroupModels,
    allowed_turns,
    each_region,
    edge_characteristic_agreement,
    group_models,
    relation_agreement,
)

SIZE = np.float32(2.5)  # half the logarithm of the area [mm^2] of a region and of all exemplars here


@pytest.fixture(scope="module")
def models(paper_tree):
    return group_models(paper_tree.appearances, paper_tree.groups.group_count)


def exemplar_rows(table, group: int) -> np.ndarray:
    """The rows that the exemplars of a group are taken from: largest regions, spread evenly."""
    first = np.flatnonzero(np.append(True, np.diff(table.attitude) > 0))
    own = first[table.group[table.attitude[first]] == group]
    return own[np.unique(np.linspace(0, len(own) - 1, EXEMPLARS).round().astype(int))] if len(own) else own


def test_exemplars_are_appearances_of_their_group(models, paper_tree):
    table = paper_tree.appearances
    for g in range(paper_tree.groups.group_count):
        rows = exemplar_rows(table, g)
        assert int(models.there[g].sum()) == len(rows)
        np.testing.assert_array_equal(models.edge_map[g, : len(rows)], table.edge_map[rows].astype(np.float32))
        np.testing.assert_array_equal(models.brothers[g, : len(rows)], table.brothers[rows])
        np.testing.assert_array_equal(models.brothers[g, len(rows) :], 0.0)
        np.testing.assert_array_equal(table.group[table.attitude[rows]], g)
    assert (np.asarray(models.there).sum(axis=1) == EXEMPLARS).sum() >= 5


def test_an_exemplar_agrees_fully_with_its_own_group_and_with_none_more(models, paper_tree, as_features):
    table = paper_tree.appearances
    relation, joint = jax.jit(relation_agreement), jax.jit(edge_characteristic_agreement)
    for g in range(paper_tree.groups.group_count):
        for row in exemplar_rows(table, g)[::7]:
            features = as_features(table, row)
            if table.edge_map[row].any() and table.characteristic_map[row].any():
                own = np.asarray(joint(features, models))
                assert own[g] == pytest.approx(1.0, abs=1e-4)
                assert (own <= own[g] + 1e-4).all()
            beside = np.asarray(relation(features, models))
            assert beside[g] == pytest.approx(1.0, abs=1e-3)
            assert (beside <= beside[g] + 1e-3).all()


def test_a_batch_is_its_regions_one_by_one(models, paper_tree, as_features):
    table = paper_tree.appearances
    rows = np.linspace(0, len(table.attitude) - 1, 11).astype(int)
    batch = jax.tree.map(lambda *a: jnp.stack([jnp.asarray(x) for x in a]), *(as_features(table, r) for r in rows))
    for function in (relation_agreement, edge_characteristic_agreement):
        many = np.asarray(each_region(function, batch, models))
        assert many.shape == (11, paper_tree.groups.group_count)
        np.testing.assert_allclose(many[4], function(as_features(table, rows[4]), models), atol=1e-5)


def brother(along: float, across: float, size=2.0, facing=1.0) -> list[float]:
    return [along, across, 0.0, size, facing, 1.0]


def group_of(*stored: list[list[float]], unique: bool = True) -> GroupModels:
    """A group for every list of brothers, one exemplar each; maps are empty."""
    beside = np.zeros((len(stored), 1, STORED_BROTHERS, BROTHER_FIELDS), np.float32)
    for k, one in enumerate(stored):
        beside[k, 0, : len(one)] = np.reshape(one, (-1, BROTHER_FIELDS))
    shape = (len(stored), 1)
    return GroupModels(
        jnp.zeros((*shape, RADII, ANGLES, 3)), jnp.zeros((*shape, RADII, ANGLES, 5)), jnp.asarray(beside),
        jnp.full(shape, SIZE), jnp.full(shape, unique), jnp.ones(shape, bool),
    )  # fmt: skip


@pytest.fixture(scope="module")
def region(paper_tree, as_features):
    """A region with an inertia direction, beside others as asked for."""
    table = paper_tree.appearances
    plain = as_features(table, int(np.argmax(table.inertia[:, 3])))

    def with_others(*others: list[float]):
        beside = np.zeros((MOST_BROTHERS, BROTHER_FIELDS), np.float32)
        beside[: len(others)] = np.reshape(others, (-1, BROTHER_FIELDS))
        return plain._replace(brothers=beside, area=np.exp(2.0 * SIZE))

    return with_others


def test_brothers_count_for_a_group_that_has_them_and_against_one_that_has_not(region):
    right, other = brother(8, 6), brother(0, -20)
    groups = group_of([], [right], [right, other])
    alone, one, two = (np.asarray(relation_agreement(region(*o), groups)) for o in ([], [right], [right, other]))
    half, third = ALONE / (0.5 + ALONE), ALONE / (1.0 + ALONE)
    np.testing.assert_allclose(alone, [1.0, half, third], atol=1e-3)
    np.testing.assert_allclose(one, [half, 1.0, (1 + ALONE) / (1.5 + ALONE)], atol=1e-3)
    assert two.argmax() == 2
    assert two[2] == pytest.approx(1.0, abs=1e-3)
    # one that lies elsewhere belongs to another part
    elsewhere = np.asarray(relation_agreement(region(brother(-30, 30)), groups))
    np.testing.assert_allclose(elsewhere, alone, atol=2e-2)


def test_a_region_of_another_size_has_no_brothers(region):
    """What lies beside it as beside an exemplar is no brother where the region itself is not the exemplar's."""
    groups = group_of([], [brother(8, 6)])
    seen = region(brother(8, 6))
    larger = np.asarray(relation_agreement(seen._replace(area=seen.area * 16.0), groups))
    np.testing.assert_allclose(larger, [1.0, ALONE / (0.5 + ALONE)], atol=3e-2)


def test_one_region_is_not_two_brothers(region):
    """Two as far away as it, of a group without a direction: it is one of them."""
    both = group_of([brother(8, 6), brother(-8, 6)], unique=False)
    agreement = float(relation_agreement(region(brother(10, 0)), both)[0])
    assert agreement == pytest.approx((1 + ALONE) / (1.5 + ALONE), abs=1e-3)


@given(st.lists(st.tuples(st.floats(-40, 40), st.floats(-40, 40)), max_size=4),
       st.lists(st.tuples(st.floats(-40, 40), st.floats(-40, 40)), max_size=2), st.booleans())  # fmt: skip
@settings(deadline=None, max_examples=40)
def test_an_agreement_lies_between_0_and_1(region, seen, stored, unique):
    groups = group_of([brother(*xy) for xy in stored], unique=unique)
    agreement = float(relation_agreement(region(*(brother(*xy) for xy in seen)), groups)[0])
    assert 0.0 < agreement <= 1.0 + 1e-5


def test_padding_agrees_with_nothing(region):
    groups = group_of([brother(8, 6)])
    nothing = groups._replace(there=jnp.zeros_like(groups.there))
    for function in (relation_agreement, edge_characteristic_agreement):
        np.testing.assert_array_equal(function(region(brother(8, 6)), nothing), 0.0)


def test_a_direction_allows_turns_near_0_and_a_half_alone():
    none, known = np.asarray(allowed_turns(jnp.asarray([False, True])))
    assert none.all()
    expected = {(k + t) % ANGLES for k in (0, ANGLES // 2) for t in range(-TURN_TOLERANCE, TURN_TOLERANCE + 1)}
    assert set(np.flatnonzero(known).tolist()) == expected


def test_where_things_lie_must_agree_at_one_turn_for_both(region):
    """Edges that fit at one turn and characteristics at another are two half agreements."""
    rng = np.random.default_rng(0)
    edges, kinds = (rng.exponential(1.0, (RADII, ANGLES, c)).astype(np.float32) ** 3 for c in (3, 5))
    groups = group_of([], unique=False)._replace(
        edge_map=jnp.asarray(edges)[None, None], characteristic_map=jnp.asarray(kinds)[None, None]
    )
    turned = [np.roll(m, 9, axis=1) for m in (edges, kinds)]
    plain = region()
    together = plain._replace(edge_map=turned[0], characteristic_map=turned[1])
    apart = plain._replace(edge_map=turned[0], characteristic_map=kinds)
    assert float(edge_characteristic_agreement(together, groups)[0]) == pytest.approx(1.0, abs=1e-4)
    assert float(edge_characteristic_agreement(apart, groups)[0]) < 0.8
    # an inertia direction leaves no turn by a quarter open
    known = groups._replace(unique=jnp.ones_like(groups.unique))
    assert float(edge_characteristic_agreement(together, known)[0]) < 0.8
    unturned = plain._replace(edge_map=edges, characteristic_map=kinds)
    assert float(edge_characteristic_agreement(unturned, known)[0]) > 0.999
