"""Compiling a part: the paper's seven groups, legal rules with measured errors, and the same seed the same tree."""

import dataclasses

import numpy as np
import pytest
from itree_cad.bundled import bundled_part
from itree_kernels.errors import ItreeError

import itree_jax.compile as compiling
from itree_jax.compile import compile_tree, field_of_view
from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.tree import draws as drawing
from itree_jax.tree.choice import ERROR_BOUND
from itree_jax.tree.classification_rules import PAIR, RULE_NAMES
from itree_jax.tree.dome import dome
from itree_jax.tree.error_rates import expected
from itree_jax.tree.joining import many_way_sides
from itree_jax.tree.tree import PRUNED, InterpretationTree

from .primitives import box_part, sphere_part

SENSOR = bundled_sensor("ikeuchi-1987")


@pytest.fixture(scope="module")
def paper(tree_of_the_paper) -> InterpretationTree:
    return tree_of_the_paper


@pytest.fixture
def quick(monkeypatch):
    """Compiles a box from 60 viewer directions at 2 rolls with 8 draws."""
    monkeypatch.setattr(compiling, "APPEARANCE_FREQUENCY", 1)
    monkeypatch.setattr(compiling, "ROLLS", 2)
    return lambda **options: compile_tree(box_part(40, 30, 20), SENSOR, **({"draws": 8} | options))


def test_the_papers_part_has_its_seven_groups(paper):
    counts = dict(zip(paper.groups.label_strings, paper.groups.view_count.tolist(), strict=True))
    assert counts == {
        "11100000": 10, "11000010": 10, "11000001": 10, "11000000": 10, "00010000": 8, "00001100": 10, "00000000": 2,
    }  # fmt: skip
    pruned = {label for label, p in zip(paper.groups.label_strings, paper.groups.pruned, strict=True) if p}
    assert pruned == {"00010000", "00000000"}
    assert (paper.obj_id, paper.policy, paper.seed) == (7, "paper", 0)


def test_the_papers_part_has_the_papers_rules(paper):
    """Sec. 2.1.5, figure 4: B0 and B1 by L1, joined to one three-way node; B2, B3 pruned; B4 by L6; B5 by L7.

    None of these choices is close, so that noise of the draws doesn't decide them: a rule that is passed over errs in
    over twice the bound, one that is taken is under half of it, and L7 errs half as often as the next.
    """
    nodes = paper.nodes
    assert nodes.branch == ("B0", "B1", "B2", "B3", "B4", "B5")
    assert nodes.rule == ("L1", "L1", PRUNED, PRUNED, "L6", "L7")
    np.testing.assert_array_equal(nodes.joined, [0, 0, 2, 3, 4, 5])
    sides = many_way_sides(nodes, ~paper.groups.pruned, 0)
    labels = paper.groups.label_strings
    (wide_plane,) = np.flatnonzero(sides == sides[labels.index("11100000")])
    (slotted_end,) = np.flatnonzero(sides == sides[labels.index("00001100")])
    others = {labels.index(label) for label in ("11000010", "11000001", "11000000")}
    assert sides.max() == 2
    assert {wide_plane, slotted_end, *others} == set(np.flatnonzero(~paper.groups.pruned).tolist())
    whole = nodes.rule_errors[..., 0]
    l6, l7 = RULE_NAMES.index("L6"), RULE_NAMES.index("L7")
    assert (whole[[0, 1, 4], [0, 0, l6]] < ERROR_BOUND / 2).all()
    assert (whole[4, :l6] > 2 * ERROR_BOUND).all()
    assert 0.7 * np.delete(whole[5], l7).min() > whole[5, l7]


def test_every_node_has_a_rule_and_an_error_within_its_interval(paper, paper_tree):
    for tree, most in ((paper, 100), (paper_tree, 20)):
        nodes = tree.nodes
        low, high = nodes.error_interval.T
        assert ((low >= 0) & (low <= nodes.error) & (nodes.error <= high) & (high <= 1)).all()
        for k, rule in enumerate(nodes.rule):
            if rule == PRUNED:
                assert nodes.draws[k] == 0
                continue
            assert nodes.error[k] == expected(nodes.whole_and_cut[k], tree.policy)
            if PAIR not in rule:
                np.testing.assert_array_equal(nodes.whole_and_cut[k], nodes.rule_errors[k, RULE_NAMES.index(rule)])
            assert 0 < nodes.draws[k] <= most * 5
            top = nodes.joined[k]
            assert nodes.rule[top] == rule
            assert (nodes.joined_error[top] <= 1).all()
        assert PAIR not in "".join(paper.nodes.rule)  # the paper registers one rule at a branch
        assert ((tree.confusion.expected_error >= 0) & (tree.confusion.expected_error <= 1)).all()
        np.testing.assert_array_equal(np.isnan(tree.confusion.group_error[:, 0]), tree.groups.pruned)


def test_leaves_have_measured_determination_and_pruned_groups_none(paper):
    d, pruned = paper.determination, paper.groups.pruned
    assert np.isfinite(d.error[~pruned]).all()
    assert np.isnan(d.error[pruned]).all()
    low, high = d.error_interval[~pruned, :, 0], d.error_interval[~pruned, :, 1]
    assert ((low >= 0) & (low <= d.error[~pruned]) & (d.error[~pruned] <= high) & (high <= 1)).all()
    assert (d.draws[~pruned] > 0).all()
    assert set(d.rotations_left.tolist()) <= {0, 1, 2}
    assert (d.scales > 0).all()


def test_appearances_cover_views_and_rolls(paper):
    table = paper.appearances
    assert len(table.R_cam_obj) == len(table.view) == len(dome(2).directions) * paper.rolls
    np.testing.assert_allclose(-table.R_cam_obj[:: paper.rolls, 2], dome(2).directions, atol=1e-6)
    assert np.degrees(paper.spacing) == pytest.approx(13.1, abs=0.1)
    # the cell of the paper's dome that a view is counted to is the one that it lies in
    nearest = (dome(2).directions @ dome(1).directions.T).argmax(axis=1)
    assert (table.view[:: paper.rolls] == nearest).mean() > 0.9


def arrays_of(tree: InterpretationTree) -> list[np.ndarray]:
    owners = (tree.groups, tree.nodes, tree.distributions, tree.determination, tree.appearances)
    values = [getattr(owner, f.name) for owner in owners for f in dataclasses.fields(owner)]
    flat = [v for value in values for v in (value if isinstance(value, tuple) else (value,))]
    return [np.asarray(v) for v in flat]


def test_the_same_seed_gives_the_same_tree_and_another_other_draws(quick):
    first, again, other = quick(seed=3), quick(seed=3), quick(seed=4)
    for a, b in zip(arrays_of(first), arrays_of(again), strict=True):
        np.testing.assert_array_equal(a, b)
    for samples, different in zip(first.distributions.samples, other.distributions.samples, strict=True):
        assert not np.array_equal(samples, different, equal_nan=True)
    assert first.groups.label_strings == other.groups.label_strings
    np.testing.assert_array_equal(first.groups.group_of_view, other.groups.group_of_view)
    np.testing.assert_array_equal(first.appearances.outline, other.appearances.outline)


def test_error_rates_are_measured_on_other_draws_than_the_distributions(quick, monkeypatch):
    made, render = [], drawing.noisy_draws
    monkeypatch.setattr(drawing, "noisy_draws", lambda *args: made.append(render(*args)) or made[-1])
    tree = quick()
    train, test = made
    assert len(train.group) == 8 * int((~tree.groups.pruned).sum()) - train.empty
    apart = np.abs(train.R_cam_obj[:, None] - test.R_cam_obj[None]).max(axis=(2, 3))
    assert apart.min() > 1e-3
    assert len(made) == 2


def test_progress_goes_from_0_to_1(quick):
    told = []
    quick(report=lambda what, share: told.append((what, share)))
    shares = [share for _, share in told]
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0.0, 1.0)
    assert len({what for what, _ in told}) == len(told)


def test_a_finer_dome_has_more_views(quick):
    tree = quick(dome_frequency=2)
    assert tree.groups.frequency == 2
    assert len(tree.groups.directions) == 240


def test_an_implausible_size_is_refused_with_the_likely_unit():
    part = bundled_part("ikeuchi-1987")
    large = dataclasses.replace(part, vertices=part.vertices * 25.4, diameter=part.diameter * 25.4, unit="in")
    with pytest.raises(ItreeError, match=r"measures 18\d\d mm across .* larger than .* --units mm"):
        compile_tree(large, SENSOR)
    assert field_of_view(SENSOR) == pytest.approx(400.0)


def test_a_part_of_which_nothing_is_detectable_is_refused():
    blind = dataclasses.replace(SENSOR, smallest_region=1000.0)
    with pytest.raises(ItreeError, match="No face of part 'sphere'"):
        compile_tree(sphere_part(10, 48), blind)


def test_a_part_of_which_only_a_hole_counts_is_refused(paper):
    hole = paper.groups.identifying_faces[paper.groups.group_labels[paper.groups.label_strings.index("00010000")]]
    with pytest.raises(ItreeError, match="No attitude group of 'ikeuchi-1987' can be told"):
        compile_tree(dataclasses.replace(paper.part, identifying_faces=tuple(hole.tolist())), SENSOR)


def test_an_unknown_policy_is_refused_before_any_work():
    with pytest.raises(ItreeError, match="no policy 'best'"):
        compile_tree(box_part(4000, 10, 10), SENSOR, policy="best")


def test_progress_counts_the_views_of_the_dome_and_never_falls(quick, monkeypatch):
    monkeypatch.setattr("itree_jax.tree.detectable.PIXELS_AT_ONCE", 20 * 60 * 60)  # the 60 views in several launches
    told = []
    quick(report=lambda what, share: told.append((what, share)))
    shares = [share for _, share in told]
    assert shares == sorted(shares)
    assert len([what for what, _ in told if what.endswith("of 60 views")]) > 3
