"""The freedom that determination takes away, along the paper's chains and any other."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from itree_jax.tree.choice import ERROR_BOUND
from itree_jax.tree.determination_family import DETERMINATION_RULE_NAMES, DETERMINATION_RULES
from itree_jax.tree.freedom import OPEN, Freedom, choose_steps, freedom_along

ALL = Freedom(2, OPEN)


@pytest.mark.parametrize("chain", [("A1", "A4", "A5"), ("A1", "A3", "A7"), ("A1", "A4", "A7")])
def test_the_papers_chains_take_two_degrees_of_freedom_and_then_the_rotation(chain):
    """Sec. 3.2-3.4: the direction by A1, the rotation up to two by A3 or A4, and uniquely by A5 or A7."""
    assert freedom_along(chain) == (ALL, Freedom(0, OPEN), Freedom(0, 2), Freedom(0, 1))
    assert [str(f) for f in freedom_along(chain)] == [
        "viewer direction 2, rotation 360 degrees", "viewer direction 0, rotation 360 degrees",
        "viewer direction 0, rotation 2 candidates", "unique",
    ]  # fmt: skip


def test_an_attitude_by_the_whole_egi_leaves_nothing():
    assert freedom_along(("A2",))[-1] == Freedom(0, 1)
    assert freedom_along(()) == (ALL,)


def left(freedom: Freedom) -> tuple[int, float]:
    return freedom.direction, np.inf if freedom.rotations == OPEN else freedom.rotations


RATES = st.lists(st.floats(0, 0.1), min_size=8, max_size=8)


@given(RATES, st.booleans(), st.sampled_from(["paper", "measured"]))
def test_every_step_of_a_chosen_chain_takes_some_freedom_and_none_gives_any(rates, related, policy):
    steps, rotations = choose_steps(np.array(rates), related, policy)
    along = freedom_along(steps)
    assert len(along) == len(steps) + 1
    for before, after in pairwise(along):
        assert left(after)[0] <= left(before)[0]
        assert left(after)[1] <= left(before)[1]
        assert after != before
    assert along[-1].rotations == rotations
    assert not steps or rates[DETERMINATION_RULE_NAMES.index(steps[-1])] < ERROR_BOUND  # the chain stands by its end
    assert list(steps) == sorted(steps)
    assert not steps or steps[0] == "A1"
    assert "A3" not in steps or related


@given(st.lists(st.sampled_from(DETERMINATION_RULE_NAMES), max_size=6))
def test_no_rule_gives_a_direction_back(chain):
    directions = [f.direction for f in freedom_along(tuple(chain))]
    assert directions == sorted(directions, reverse=True)
    fixes = {rule.name: rule.fixes for rule in DETERMINATION_RULES}
    assert directions[-1] == (0 if any(fixes[s] in ("direction", "attitude") for s in chain) else 2)


def rates(**errors: float) -> np.ndarray:
    """Errors of A1..A8; what is not named errs always."""
    return np.array([errors.get(name, 0.9) for name in DETERMINATION_RULE_NAMES])


@pytest.mark.parametrize(
    ("errors", "related", "steps", "rotations"),
    [
        ({"A1": 0.0, "A4": 0.0, "A5": 0.0}, False, ("A1", "A4", "A5"), 1),
        ({"A1": 0.0, "A3": 0.0, "A7": 0.0}, True, ("A1", "A3", "A7"), 1),
        ({"A1": 0.0, "A3": 0.0, "A7": 0.0}, False, ("A1", "A4", "A7"), 1),  # no brother, no A3
        ({"A1": 0.2, "A4": 0.02, "A5": 0.0}, False, ("A1", "A4", "A5"), 1),
        ({"A1": 0.2, "A4": 0.2, "A5": 0.0}, False, ("A1", "A4", "A5"), 1),  # what A4 leaves, A5 puts right
        ({"A1": 0.0, "A2": 0.0, "A5": 0.0}, False, ("A1", "A2"), 1),
        ({"A1": 0.0, "A4": 0.0}, False, ("A1", "A4"), 2),
        ({"A1": 0.0}, True, ("A1",), OPEN),
        ({"A1": ERROR_BOUND}, True, (), OPEN),
    ],
)
@pytest.mark.parametrize("policy", ["paper", "measured"])
def test_steps_are_the_rules_that_decide(errors, related, steps, rotations, policy):
    assert choose_steps(rates(**errors), related, policy) == (steps, rotations)


def test_of_several_the_paper_takes_the_first_and_the_other_policy_the_best():
    errors = rates(A1=0.0, A3=0.04, A4=0.0, A5=0.04, A6=0.03, A8=0.0)
    assert choose_steps(errors, True, "paper") == (("A1", "A3", "A5"), 1)
    assert choose_steps(errors, True, "measured") == (("A1", "A4", "A8"), 1)
    as_good = rates(A1=0.0, A5=0.002, A8=0.0)
    assert choose_steps(as_good, True, "measured")[0] == ("A1", "A3", "A5")  # and cheaper


@pytest.mark.parametrize("policy", ["paper", "measured"])
def test_a_group_that_was_not_measured_has_no_steps(policy):
    assert choose_steps(np.full(8, np.nan), True, policy) == ((), OPEN)
