"""The freedom that determination takes away, step by step (Ikeuchi 1987, sec. 2.2.2-2.2.6).

An attitude group leaves a viewer direction (two degrees of freedom) and a rotation about it (360 degrees). "Each rule
that can reduce some of remaining freedom in the viewer direction and rotation will be adopted into the tree."
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from itree_jax.tree.choice import ERROR_BOUND, cheapest_of_equals
from itree_jax.tree.determination_family import DETERMINATION_RULE_NAMES, DETERMINATION_RULES

OPEN = 0  # rotations left: all of them
PICKING = ("A5", "A6", "A7", "A8")


class Freedom(NamedTuple):
    """What is not determined yet."""

    direction: int  # degrees of freedom of the viewer direction: 2 or 0
    rotations: int  # candidates of the rotation; OPEN (0): 360 degrees

    def __str__(self) -> str:
        if self == Freedom(0, 1):
            return "unique"
        rotation = "360 degrees" if self.rotations == OPEN else f"{self.rotations} candidates"
        return f"viewer direction {self.direction}, rotation {rotation}"


def freedom_along(steps: tuple[str, ...]) -> tuple[Freedom, ...]:
    """The freedom before the first step and after every one."""
    found = [Freedom(2, OPEN)]
    fixes = {rule.name: rule.fixes for rule in DETERMINATION_RULES}
    for step in steps:
        direction, rotations = found[-1]
        after = {
            "direction": Freedom(0, rotations), "two rotations": Freedom(direction, 2),
            "rotation": Freedom(direction, 1), "attitude": Freedom(0, 1),
        }[fixes[step]]  # fmt: skip
        found.append(after)
    return tuple(found)


def choose_steps(rate: Float[np.ndarray, "rules"], related: bool, policy: str) -> tuple[tuple[str, ...], int]:
    """The steps of a group and the rotations that they leave (`OPEN`: all go on), by the measured errors of A1..A8.

    The error of a rule is that of the attitude which it leaves, given the rules before it, so a chain stands by that
    of its last rule: A1 then A2 where the EGI alone gives the attitude; A1, then A3 (of a group that shows brother
    regions) or A4, then one of A5-A8; A1 and A3 or A4 where none of these decides; A1 alone. `paper` takes the first of
    several rules under the bound, `measured` the one of least error, then of least cost.
    """
    if np.isnan(rate).all():
        return (), OPEN
    of = dict(zip(DETERMINATION_RULE_NAMES, rate, strict=True))
    if of["A2"] < ERROR_BOUND:
        return ("A1", "A2"), 1
    directions = ("A3", "A4") if related else ("A4",)
    two, last = _adopted(of, directions, policy), _adopted(of, PICKING, policy)
    if last is not None:
        return ("A1", two or min(directions, key=lambda rule: of[rule]), last), 1
    if two is not None:
        return ("A1", two), 2
    return (("A1",) if of["A1"] < ERROR_BOUND else ()), OPEN


def _adopted(of: dict[str, float], names: tuple[str, ...], policy: str) -> str | None:
    under = [name for name in names if of[name] < ERROR_BOUND]
    if not under or policy == "paper":
        return under[0] if under else None
    cost = {rule.name: rule.cost for rule in DETERMINATION_RULES}
    return under[cheapest_of_equals(np.array([of[n] for n in under]), [cost[n] for n in under])]
