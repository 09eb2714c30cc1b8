"""The three cases of the paper: which attitude group lies on top, and how the paper went through the tree."""

from dataclasses import dataclass

import numpy as np
from itree_kernels.errors import ItreeError

from itree_jax.tree.tree import InterpretationTree


@dataclass(frozen=True)
class Case:
    """One case. `label` is its attitude group's, `against` that of the group it is told from at its last node."""

    number: int
    section: str
    label: str
    name: str  # of the representative attitude
    against: str
    figures: str
    paper_nodes: tuple[str, ...]  # rules of the classification part, in order
    paper_chain: tuple[str, ...]  # rules of the determination part


CASES = (
    Case(1, "3.2", "11100000", "S1", "11000000", "5 and 6", ("L1",), ("A1", "A4", "A5")),
    Case(2, "3.3", "11000000", "S2", "11000001", "7", ("L1", "L6"), ("A1", "A3", "A7")),
    Case(3, "3.4", "11000001", "S4", "11000010", "8", ("L1", "L6", "L7"), ("A1", "A4", "A7")),
)
BROTHERS_LABEL = "11000000"  # of the cylinders seen as two regions
ATTITUDE_NAMES = {"11100000": "S1", "11000000": "S2", "11000010": "S3", "11000001": "S4", "00001100": "S5"}


def group_labelled(tree: InterpretationTree, label: str) -> int:
    """Index of the attitude group. Raises ItreeError if the tree has none: it is of another part or sensor."""
    found = np.flatnonzero([label == other for other in tree.groups.label_strings])
    if len(found) == 0:
        raise ItreeError(
            f"the tree of {tree.part.name!r} has no attitude group {label}, but "
            f"{', '.join(tree.groups.label_strings)}: the cases of the paper need its part; "
            "compile bundled:ikeuchi-1987 for bundled:bench with policy paper"
        )
    return int(found[0])


def attitude_name(label: str) -> str:
    """A label with the paper's name of its representative attitude."""
    name = ATTITUDE_NAMES.get(label)
    return f"{label} ({name})" if name else label
