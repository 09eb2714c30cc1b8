"""Determination: turns that are rotations, comparisons beside plain NumPy, and rolled views found again."""

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from itree_cad.symmetry import rotation
from scipy.spatial.transform import Rotation

from itree_jax.features.polar import ANGLES, RADII
from itree_jax.features.rectify import face_axes, gradient_space
from itree_jax.features.region import RegionFeatures
from itree_jax.features.relation import BROTHER_FIELDS, MOST_BROTHERS
from itree_jax.tree import determination_rules
from itree_jax.tree.appearance_rows import MOST_PENALTY, DeterminationScales, bounded, take_rows, wrapped
from itree_jax.tree.appearances import STORED_BROTHERS, appearances
from itree_jax.tree.determination import appearance_arrays, attitude_error
from itree_jax.tree.determination_family import DETERMINATION_RULE_NAMES, DETERMINATION_RULES
from itree_jax.tree.determination_relations import compare_maps, map_penalty, relation_penalty
from itree_jax.tree.determination_rules import (
    about_normal,
    compare_mass_centres,
    compare_shape,
    egi_candidates,
    egi_elsewhere,
    egi_penalty,
    mass_centre_penalty,
    outline_distance,
    shape_candidates,
    shortest_turn,
    within_roll,
)
from itree_jax.tree.dome import camera_rotation, dome
from itree_jax.tree.groups import roll_rotation

SCALES = DeterminationScales(*map(jnp.float32, [0.12, 0.05, 0.1, 0.03, 0.2, 0.15, 0.1, 0.1, 0.1, 0.1, 0.01]))
NONE_USED = np.zeros((1, 8), np.float32)
ROLL_STEP = np.pi / 6.0
NO_TURNS, NO_AXES = jnp.eye(3)[None], jnp.zeros((0, 3))
towards_viewer = st.tuples(st.floats(-1, 1), st.floats(-1, 1)).map(
    lambda pq: np.array([pq[0], pq[1], -1.0]) / np.sqrt(1 + pq[0] ** 2 + pq[1] ** 2)
)


def assert_rotation(R, atol=2e-6) -> None:
    R = np.asarray(R)
    np.testing.assert_allclose(R @ np.swapaxes(R, -1, -2), np.broadcast_to(np.eye(3), R.shape), atol=atol)
    np.testing.assert_allclose(np.linalg.det(R), 1.0, atol=atol)


@given(towards_viewer, towards_viewer)
@settings(deadline=None)
def test_the_shortest_turn_takes_one_direction_to_the_other_and_no_farther(a, b):
    R = np.asarray(shortest_turn(jnp.asarray(a, jnp.float32), jnp.asarray(b, jnp.float32)))
    assert_rotation(R)
    np.testing.assert_allclose(R @ a, b, atol=2e-6)
    axis = np.cross(a, b)
    np.testing.assert_allclose(R @ axis, axis, atol=2e-6)
    assert (np.trace(R) - 1) / 2 == pytest.approx(a @ b, abs=2e-6)


@given(towards_viewer, st.floats(-3, 3))
@settings(deadline=None)
def test_a_turn_about_the_normal_goes_from_the_faces_x_to_its_y(normal, angle):
    n = jnp.asarray(normal, jnp.float32)
    R = np.asarray(about_normal(n, jnp.asarray([angle], jnp.float32)))[0]
    e1, e2 = (np.asarray(e) for e in face_axes(*gradient_space(n)))
    assert_rotation(R)
    np.testing.assert_allclose(R @ normal, normal, atol=2e-6)
    np.testing.assert_allclose(R @ e1, np.cos(angle) * e1 + np.sin(angle) * e2, atol=5e-6)


@given(st.floats(-50, 50))
@settings(deadline=None)
def test_wrapped_is_the_same_angle_within_half_a_turn(angle):
    inside = float(wrapped(jnp.float32(angle)))
    assert abs(inside) <= np.pi + 1e-5
    assert np.cos(inside - angle) == pytest.approx(1.0, abs=1e-5)


def test_outlines_are_compared_under_every_turn():
    rng = np.random.default_rng(0)
    observed, table = rng.uniform(5, 15, 64), rng.uniform(5, 15, (3, 64))
    table[1] = np.roll(observed, 10) * 1.2
    distance = np.asarray(outline_distance(jnp.asarray(observed, jnp.float32), jnp.asarray(table, jnp.float32)))
    expected = np.array([
        [np.sqrt(np.mean((own - np.roll(observed, -k)) ** 2)) / own.mean() for k in range(64)] for own in table
    ])
    np.testing.assert_allclose(distance, expected, atol=1e-4)
    assert distance[1].argmin() == 54  # -10


def test_egi_elsewhere_is_0_of_a_part_and_1_of_something_else():
    whole = np.array([4.0, 3.0, 0.0, 0.0, 1.0], np.float32)
    part, other = whole * [1, 0.2, 0, 0, 0], np.array([0, 0, 2.0, 5.0, 0])
    table = jnp.asarray(np.stack([whole, part, other]), jnp.float32)
    np.testing.assert_allclose(egi_elsewhere(jnp.asarray(part, jnp.float32), table), [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(egi_elsewhere(jnp.asarray(whole), table), [0, 1 - 4.6 / 8, 1], atol=1e-6)


@pytest.fixture(scope="module")
def rows(gem_table):
    return appearance_arrays(gem_table, NONE_USED)


class Seen(NamedTuple):
    """Regions seen of the gem from viewer directions of the table, and the attitudes they were seen at."""

    features: list[RegionFeatures]
    R_cam_obj: np.ndarray


@pytest.fixture(scope="module")
def see(gem, flash, as_features):
    def largest_regions(R_cam_obj: np.ndarray) -> Seen:
        table = appearances(gem, flash, R_cam_obj, np.arange(len(R_cam_obj)), 1)
        first = np.searchsorted(table.attitude, np.arange(len(R_cam_obj)))
        return Seen([as_features(table, row) for row in first], R_cam_obj)

    return largest_regions


@pytest.fixture(scope="module")
def rolled(see) -> Seen:
    """Views of the table rolled by k * 22.5 degrees, k = 0, 5, 10, ..., 15."""
    return see(roll_rotation(np.arange(7) * 5 % 16 * np.pi / 8) @ camera_rotation(dome(1).directions[::9]))


def by_shape(features, rows, most=1, scales=SCALES):
    find = jax.jit(partial(shape_candidates, most=most, roll_step=ROLL_STEP))
    return find(features, rows, jnp.zeros(1), scales)


def by_egi(features, rows, most=1, scales=SCALES):
    return jax.jit(partial(egi_candidates, most=most))(features, rows, jnp.zeros(1), scales)


def errors(candidates, R_true) -> np.ndarray:
    return np.degrees(np.asarray(attitude_error(candidates.R_ray_obj, jnp.asarray(R_true), NO_TURNS, NO_AXES)))


def test_a_rolled_view_of_the_table_is_found_at_its_roll(rows, rolled):
    """The law that a wrong sign anywhere breaks: theta, the face's axes, the turn about the normal."""
    for features, R_true in zip(*rolled, strict=True):
        assert errors(by_shape(features, rows), R_true)[0] < 4.0


def test_where_an_outline_is_counted_from_does_not_matter_without_an_inertia_direction(rows, rolled):
    """A round region's direction is anywhere: the outline alone then finds the turn."""
    features, R_true = rolled.features[3], rolled.R_cam_obj[3]
    round_off = SCALES._replace(least_uniqueness=jnp.float32(2.0))
    for k in (0, 5, 23, 40, 63):
        alpha = features.inertia.alpha + np.float32(2 * np.pi * k / 64)
        counted = features._replace(
            inertia=features.inertia._replace(alpha=alpha), outline=np.roll(features.outline, -k)
        )
        assert errors(by_shape(counted, rows, 1, round_off), R_true)[0] < 5.0


def test_a_cut_outline_does_not_undo_the_egi(rows, rolled):
    """With no more to be said by outline, direction and size, the attitude stays among the candidates."""
    for features, R_true in zip(*rolled, strict=True):
        nowhere = features._replace(outline=np.ones(64, np.float32), area=features.area / 3, egi=features.egi / 3)
        assert errors(by_shape(nowhere, rows, 64), R_true).min() < 20.0


def test_without_an_outline_the_egi_finds_the_attitude(rows, see):
    """Views of the table at its own rolls."""
    R = roll_rotation(np.arange(7) * np.pi / 2) @ camera_rotation(dome(1).directions[::9])
    for features, R_true in zip(*see(R), strict=True):
        assert errors(by_egi(features, rows), R_true)[0] < 0.1


def test_an_appearance_that_the_egi_finds_is_turned_to_face_as_the_region_does(rows, see, gem_table):
    """A view of the table whose camera is tipped by 4 degrees: the region's normals tip, and the attitude with them."""
    R_true = gem_table.R_cam_obj[30 * 12]
    whole = see(R_true[None]).features[0]
    tip = rotation(np.array([0.6, 0.8, 0.0]), np.radians(4.0))
    tipped = whole._replace(mean_normal=(tip @ whole.mean_normal).astype(np.float32))
    found = by_egi(tipped, rows)
    turn = np.asarray(found.R_ray_obj[0]) @ R_true.T
    np.testing.assert_allclose(turn @ whole.mean_normal, tipped.mean_normal, atol=1e-5)
    assert np.degrees(Rotation.from_matrix(turn).magnitude()) < 4.01


def test_a_cut_region_is_found_by_its_egi(rows, gem_table, as_features):
    """Half of its facets hidden: what is left lies within the whole's EGI."""
    row = int(np.flatnonzero(gem_table.attitude == 5 * 12)[0])
    whole = as_features(gem_table, row)
    cells = np.argsort(-whole.egi)
    kept = np.where(np.isin(np.arange(len(cells)), cells[:60]), whole.egi, 0.0).astype(np.float32)
    cut = whole._replace(egi=kept, area=kept.sum())
    np.testing.assert_allclose(egi_elsewhere(jnp.asarray(kept), rows.egi)[row], 0.0, atol=1e-5)
    assert row in by_egi(cut, rows, 8).row


def test_candidates_are_rotations_that_give_the_region_its_mean_normal(rows, rolled):
    features = rolled.features[2]
    for found in (by_shape(features, rows, 50), by_egi(features, rows, 50)):
        assert_rotation(found.R_ray_obj)
        normal_obj = np.einsum("kij,ki->kj", rows.R_cam_obj[found.row], rows.mean_normal[found.row])
        shown = np.einsum("kij,kj->ki", found.R_ray_obj, normal_obj)
        np.testing.assert_allclose(shown, np.tile(features.mean_normal, (50, 1)), atol=1e-5)
        assert (np.diff(found.log_likelihood) <= 0).all()
        assert len(set(np.asarray(found.row).tolist())) == 50
        assert (np.asarray(rows.area)[found.row] > 0).all()  # no padding


def test_an_appearance_beside_itself_needs_no_turn(rows, gem_table, as_features):
    seen = jax.jit(compare_shape)(as_features(gem_table, 7), rows)
    assert float(seen.tilt[7]) < 1e-3
    assert float(seen.size[7]) == pytest.approx(0.0, abs=1e-6)
    assert float(seen.distance[7, 0]) < 1e-3
    assert float(seen.turn[7, 0]) == pytest.approx(0.0, abs=1e-3)
    np.testing.assert_allclose(seen.direction[::16], [0, np.pi / 2, 0, np.pi / 2], atol=1e-6)


def test_every_appearance_has_a_turn_within_its_roll(rows, gem_table, as_features):
    compare = jax.jit(compare_shape)
    for row in range(0, len(gem_table.attitude), 97):
        allowed = within_roll(compare(as_features(gem_table, row), rows).turn, ROLL_STEP)
        assert np.asarray(allowed).any(axis=1).all()
        assert np.asarray(allowed).sum(axis=1).max() <= 7  # of 64 directions, 30 degrees and a little


@pytest.mark.parametrize("promising", [40, 128])
def test_no_appearance_that_is_left_out_could_have_been_likelier(promising, rows, rolled, monkeypatch):
    """What mean normal, EGI and group leave bounds an appearance's likelihood: whatever is above the bound of all that
    are left out is found as if none were.
    """
    assert promising < np.count_nonzero(np.asarray(rows.area)) / 2
    sure = 0
    for features in rolled.features:
        excess, elsewhere = egi_penalty(features, rows, SCALES)
        a1 = mass_centre_penalty(*compare_mass_centres(features, rows), SCALES)
        bound = np.where(rows.area > 0, -(a1 + elsewhere + jnp.minimum(excess, MOST_PENALTY)), -np.inf)
        monkeypatch.setattr(determination_rules, "PROMISING", 10**6)
        of_all = by_shape(features, rows, most=8)
        monkeypatch.setattr(determination_rules, "PROMISING", promising)
        found = by_shape(features, rows, most=8)
        above = np.count_nonzero(np.asarray(of_all.log_likelihood) > np.sort(bound)[-promising - 1])
        sure += above
        np.testing.assert_array_equal(found.row[:above], of_all.row[:above])
        np.testing.assert_allclose(found.log_likelihood[:above], of_all.log_likelihood[:above], atol=1e-4)
        np.testing.assert_allclose(found.R_ray_obj[:above], of_all.R_ray_obj[:above], atol=1e-5)
        assert (np.asarray(found.log_likelihood) <= np.asarray(of_all.log_likelihood) + 1e-4).all()
    assert sure >= len(rolled.features)  # of each the best one, and more


def test_the_prior_of_groups_decides_between_like_appearances(gem_table, as_features):
    halves = replace(gem_table, group=gem_table.view // 30)
    rows = appearance_arrays(halves, np.zeros((2, 8), np.float32))
    features = as_features(gem_table, 7)
    find = jax.jit(partial(shape_candidates, most=40, roll_step=ROLL_STEP))
    for wanted in (0, 1):
        prior = jnp.where(jnp.arange(2) == wanted, 0.0, -jnp.inf)
        found = find(features, rows, prior, SCALES)
        assert (np.asarray(rows.group)[found.row] == wanted).all()


# A3 and A6-A8: what stands beside a region and what lies on it turn with it.


def test_rules_are_a1_to_a8_and_all_that_turn_have_a_penalty(rows, rolled):
    assert DETERMINATION_RULE_NAMES == ("A1", "A2", "A3", "A4", "A5", "A6", "A7", "A8")
    fixed = {rule.name: rule.fixes for rule in DETERMINATION_RULES}
    assert fixed["A1"] == "direction"
    assert fixed["A2"] == "attitude"
    assert fixed["A3"] == fixed["A4"] == "two rotations"
    assert {fixed[name] for name in ("A5", "A6", "A7", "A8")} == {"rotation"}
    for rule in DETERMINATION_RULES:
        assert rule.cost >= 1.0
        assert (rule.penalty is None) == (rule.name in ("A1", "A2"))
        if rule.penalty is not None:
            penalty = np.asarray(jax.jit(rule.penalty)(rolled.features[0], rows, SCALES))
            assert penalty.shape == rows.outline.shape
            assert (penalty >= 0.0).all()
            assert (penalty <= 2.0 * MOST_PENALTY + 1e-5).all()  # nothing outweighs everything else


def beside(angle: float, distance: float = 40.0) -> np.ndarray:
    """A brother in this direction [rad] of the face, from the maximum inertia direction."""
    return np.float32([distance * np.cos(angle), distance * np.sin(angle), 0.0, 2.0, 1.0, 1.0])


def with_brother(features: RegionFeatures, *angles: float) -> RegionFeatures:
    brothers = np.zeros((MOST_BROTHERS, BROTHER_FIELDS), np.float32)
    for row, angle in zip(brothers, angles, strict=False):
        row[:] = beside(angle)
    return features._replace(brothers=brothers)


def stored_beside(rows, *angles: float):
    """The appearances, each with a brother in every one of these directions."""
    brothers = np.zeros((len(rows.area), STORED_BROTHERS, BROTHER_FIELDS), np.float32)
    for k, angle in enumerate(angles):
        brothers[:, k] = beside(angle)
    return rows._replace(brothers=jnp.asarray(brothers))


@pytest.mark.parametrize("k", [0, 5, 32, 50])
def test_a_brother_that_has_turned_turns_a3s_least_penalty(rows, rolled, k):
    turned = with_brother(rolled.features[0], 0.7 + 2 * np.pi * k / 64)
    penalty = np.asarray(jax.jit(relation_penalty)(turned, stored_beside(rows, 0.7), SCALES))
    np.testing.assert_array_equal(penalty.argmin(axis=1), k)
    np.testing.assert_allclose(penalty[:, k], 0.0, atol=1e-4)
    away = 2 * np.pi / 64 / float(SCALES.relation)
    np.testing.assert_allclose(penalty[:, (k + 1) % 64], min(0.5 * away**2, MOST_PENALTY), rtol=1e-3)


def test_of_two_brothers_the_one_that_fits_is_looked_at(rows, rolled):
    seen = with_brother(rolled.features[0], 0.5, 2.0)
    penalty = np.asarray(relation_penalty(seen, stored_beside(rows, 2.0 - 2 * np.pi * 4 / 64), SCALES))
    np.testing.assert_array_equal(penalty.argmin(axis=1), 4)
    np.testing.assert_allclose(penalty[:, 4], 0.0, atol=1e-4)


def test_without_a_brother_on_either_side_a3_says_nothing(rows, rolled):
    alone, with_one = with_brother(rolled.features[0]), with_brother(rolled.features[0], 0.5)
    for features, table in ((alone, stored_beside(rows, 0.5)), (with_one, stored_beside(rows))):
        np.testing.assert_array_equal(relation_penalty(features, table, SCALES), 0.0)


@pytest.fixture(scope="module")
def patterned(rows):
    """Twenty appearances with maps that are like nothing else and nothing like themselves turned."""
    rng = np.random.default_rng(0)
    some = take_rows(rows, jnp.arange(20))
    edges, kinds = (rng.exponential(1.0, (20, RADII, ANGLES, c)) ** 3 for c in (3, 5))
    return some._replace(edge_map=jnp.asarray(edges, jnp.float16), characteristic_map=jnp.asarray(kinds, jnp.float16))


def turned_maps(features: RegionFeatures, row: int, patterned, edges: int, kinds: int) -> RegionFeatures:
    """A region with the maps of an appearance, each turned by so many cells."""
    return features._replace(
        edge_map=np.roll(np.asarray(patterned.edge_map[row], np.float32), edges, axis=1),
        characteristic_map=np.roll(np.asarray(patterned.characteristic_map[row], np.float32), kinds, axis=1),
    )


@pytest.mark.parametrize("cells", [0, 3, 17])
def test_maps_that_have_turned_turn_the_least_penalty_of_a6_a7_and_a8(patterned, rolled, cells):
    seen = turned_maps(rolled.features[0], 7, patterned, cells, cells)
    for name in ("A6", "A7", "A8"):
        rule = DETERMINATION_RULES[DETERMINATION_RULE_NAMES.index(name)]
        penalty = np.asarray(jax.jit(rule.penalty)(seen, patterned, SCALES))
        row, turn = np.unravel_index(penalty.argmin(), penalty.shape)
        assert (row, turn) == (7, cells * 64 // ANGLES)
        assert penalty[row, turn] == pytest.approx(0.0, abs=1e-3)


def test_a8_asks_for_edges_where_the_characteristics_are_right(patterned, rolled):
    """Both turned, but not by the same: each finds its own turn, together they find none."""
    maps = compare_maps(turned_maps(rolled.features[0], 7, patterned, 3, 11), patterned)
    assert int(maps.edges[7].argmin()) == 6
    assert int(maps.characteristic[7].argmin()) == 22
    assert float(maps.both[7].min()) > 0.3
    for disagreement in maps:
        assert ((disagreement > -1e-5) & (disagreement < 1 + 1e-5)).all()


def test_between_the_cells_of_a_map_agreement_is_interpolated(patterned, rolled):
    maps = compare_maps(turned_maps(rolled.features[0], 7, patterned, 2, 2), patterned)
    for m in maps[:2]:
        np.testing.assert_allclose(m[:, 1::2], (m[:, ::2] + np.roll(m, -1, axis=1)[:, 1::2]) / 2.0, atol=1e-5)


def test_maps_and_brothers_count_where_the_groups_steps_use_them(patterned, rolled):
    seen = with_brother(turned_maps(rolled.features[0], 7, patterned, 3, 3), 0.7)
    table, at = stored_beside(patterned, 0.7), jnp.full(20, 12)
    maps = compare_maps(seen, table)
    expected = {
        "A3": relation_penalty(seen, table, SCALES), "A6": bounded(maps.characteristic / SCALES.characteristic),
        "A7": bounded(maps.edges / SCALES.edges), "A8": bounded(maps.both / SCALES.both),
    }  # fmt: skip
    for k, name in enumerate(DETERMINATION_RULE_NAMES):
        found = map_penalty(seen, table._replace(uses=jnp.eye(8)[k][None]), SCALES, at)
        wanted = np.asarray(expected[name])[:, 12] if name in expected else np.zeros(20)
        np.testing.assert_allclose(found, wanted, atol=1e-5, err_msg=name)
    every = map_penalty(seen, table._replace(uses=jnp.ones((1, 8))), SCALES, at)
    np.testing.assert_allclose(every, sum(np.asarray(p)[:, 12] for p in expected.values()), atol=1e-4)


def test_the_length_of_the_mass_centre_is_a1s_too(rows, gem_table, as_features):
    """A plane's is 1 and a curved surface's less: looking the same way, they differ."""
    features = as_features(gem_table, 7)
    same = compare_mass_centres(features, rows)
    np.testing.assert_allclose(mass_centre_penalty(*same, SCALES)[7], 0.0, atol=1e-3)
    flatter = features._replace(mass_centre=features.mean_normal)
    shorter = float(np.linalg.norm(features.mass_centre))
    expected = min(0.5 * ((1 - shorter) / float(SCALES.concentration)) ** 2, MOST_PENALTY)
    other = compare_mass_centres(flatter, rows)
    np.testing.assert_allclose(mass_centre_penalty(*other, SCALES)[7], expected, rtol=0.05)
