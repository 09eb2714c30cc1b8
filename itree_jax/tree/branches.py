"""Branches B0..Bn from the root to the attitude groups (Ikeuchi 1987, sec. 2.1.2, figure 3).

Faces are taken in area order; each divides the groups found so far by whether it is detectable. Faces of nearly equal
area would make that order unstable, so a class of them divides by "any" (xx) against "none" (00) first, and its faces
one by one only after all classes, since groups that resemble each other are best divided late. Only divisions of
groups that exist are branches.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

EQUAL_AREA = 0.05  # areas within 5 % are a tie
ROOT = -1  # parent of the first branch


@dataclass(frozen=True)
class Branches:
    """A binary tree in arrays; branch k tests whether any of its digits' faces is detectable.

    Branches come in the order of the levels, so that a parent comes before its children.
    """

    names: tuple[str, ...]  # "B0", "B1", ...
    tested: Bool[np.ndarray, "branches digits"]  # the digits (identifying faces) whose "any" is tested
    parent: Int[np.ndarray, "branches"]  # branch above, or ROOT
    on_visible_side: Bool[np.ndarray, "branches"]  # which side of the parent the branch hangs on; False for the root
    visible: Bool[np.ndarray, "branches groups"]  # groups where any tested face is detectable
    hidden: Bool[np.ndarray, "branches groups"]  # groups that reach the branch where none is
    pruned: Bool[np.ndarray, "branches"]  # a side holds nothing but pruned groups: there is nothing to decide

    @property
    def branch_count(self) -> int:
        return len(self.names)


def branches(
    group_labels: Bool[np.ndarray, "groups digits"],
    face_areas: Float[np.ndarray, "digits"],
    pruned_groups: Bool[np.ndarray, "groups"],
) -> Branches:
    """The branches that divide these groups.

    Args:
        group_labels: distinct labels, digits in falling order of their faces' areas.
        face_areas: [mm^2] of the digits' faces.
        pruned_groups: groups without a representative attitude.
    """
    divisions: list[_Division] = []
    # Sets of groups not divided any further yet, each with the branch and the side that made it.
    open_sets = [(np.ones(len(group_labels), dtype=bool), ROOT, False)]
    for tested in division_tests(face_areas):
        any_visible = group_labels[:, tested].any(axis=1)
        next_sets = []
        for members, parent, side in open_sets:
            visible, hidden = members & any_visible, members & ~any_visible
            if visible.any() and hidden.any():
                next_sets += [(visible, len(divisions), True), (hidden, len(divisions), False)]
                divisions.append(_Division(tested, parent, side, visible, hidden))
            else:
                next_sets.append((members, parent, side))
        open_sets = next_sets
    return _as_arrays(divisions, len(face_areas), pruned_groups)


def classification_part(tree: Branches) -> Branches:
    """The branches that are left to be decided: pruned ones taken out, what hung below them moved up."""
    keep = np.flatnonzero(~tree.pruned)
    new_index = {int(old): new for new, old in enumerate(keep)}
    parent, side = [], []
    for k in keep:
        above, on = int(tree.parent[k]), bool(tree.on_visible_side[k])
        while above != ROOT and tree.pruned[above]:
            above, on = int(tree.parent[above]), bool(tree.on_visible_side[above])
        parent.append(new_index.get(above, ROOT))
        side.append(on)
    return Branches(
        names=tuple(tree.names[k] for k in keep),
        tested=tree.tested[keep],
        parent=np.array(parent, dtype=np.int32),
        on_visible_side=np.array(side, dtype=bool),
        visible=tree.visible[keep],
        hidden=tree.hidden[keep],
        pruned=tree.pruned[keep],
    )


class _Division(NamedTuple):
    """One branch while the tree grows; fields as in `Branches`."""

    tested: np.ndarray
    parent: int
    on_visible_side: bool
    visible: np.ndarray
    hidden: np.ndarray


def _as_arrays(divisions: list[_Division], digits: int, pruned_groups: Bool[np.ndarray, "groups"]) -> Branches:
    groups = len(pruned_groups)
    visible = np.array([d.visible for d in divisions], dtype=bool).reshape(len(divisions), groups)
    hidden = np.array([d.hidden for d in divisions], dtype=bool).reshape(len(divisions), groups)
    kept = ~pruned_groups
    return Branches(
        names=tuple(f"B{k}" for k in range(len(divisions))),
        tested=np.array([d.tested for d in divisions], dtype=bool).reshape(len(divisions), digits),
        parent=np.array([d.parent for d in divisions], dtype=np.int32),
        on_visible_side=np.array([d.on_visible_side for d in divisions], dtype=bool),
        visible=visible,
        hidden=hidden,
        pruned=np.logical_not(np.any(visible & kept, axis=1) & np.any(hidden & kept, axis=1)),
    )


def division_tests(face_areas: Float[np.ndarray, "digits"]) -> Bool[np.ndarray, "tests digits"]:
    """The digits tested at each level: every tie class as a whole in area order, then the faces of the ties alone."""
    classes = tie_classes(face_areas)
    alone = [[digit] for members in classes if len(members) > 1 for digit in members]
    tests = np.zeros((len(classes) + len(alone), len(face_areas)), dtype=bool)
    for row, members in zip(tests, [*classes, *alone], strict=True):
        row[members] = True
    return tests


def tie_classes(face_areas: Float[np.ndarray, "digits"]) -> list[list[int]]:
    """Digits whose areas lie within 5 % of the largest of their class; areas are falling."""
    classes: list[list[int]] = []
    for digit, area in enumerate(face_areas):
        if classes and area >= (1.0 - EQUAL_AREA) * face_areas[classes[-1][0]]:
            classes[-1].append(digit)
        else:
            classes.append([digit])
    return classes


def level_partitions(
    group_labels: Bool[np.ndarray, "groups digits"], face_areas: Float[np.ndarray, "digits"]
) -> Int[np.ndarray, "levels groups"]:
    """The block each group belongs to after every level; level 0 is the root, where all are together."""
    outcome = np.stack([group_labels[:, test].any(axis=1) for test in division_tests(face_areas)], axis=1)
    blocks = [np.zeros(len(group_labels), dtype=int)]
    for level in range(1, outcome.shape[1] + 1):
        blocks.append(np.unique(outcome[:, :level], axis=0, return_inverse=True)[1].reshape(-1))
    return np.stack(blocks)
