"""Several trees at once: a forest whose root tells the parts apart by the rules of the trees.

A region is measured once for all parts of its size class, and only the parts that the root leaves for it are asked for
its attitude: the cost of a scene grows with the parts that look alike, not with the parts there are.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from itree_kernels.errors import ItreeError

from itree_jax.tree.check_sensor import check_sensor
from itree_jax.tree.root import Root, measure_root
from itree_jax.tree.tree import InterpretationTree


@dataclass(frozen=True)
class Forest:
    """Trees of different parts under one sensor, and the root above them."""

    trees: tuple[InterpretationTree, ...]
    root: Root


def compile_forest(trees: Sequence[InterpretationTree]) -> Forest:
    """A forest of compiled (or loaded) trees. Nothing is rendered: the root is made of the draws that the trees keep.

    Raises:
        ItreeError: there are no trees, two different parts have one object number, or two trees are for different
            sensors.
    """
    if not trees:
        raise ItreeError("A forest needs at least one tree; compile a part first (itree compile).")
    check_objects(trees)
    for tree in trees[1:]:
        check_sensor(tree, trees[0].sensor)
    return Forest(tuple(trees), measure_root(trees))


def check_objects(trees: Sequence[InterpretationTree]) -> None:
    """Raises ItreeError when two different parts have one object number."""
    first: dict[int, InterpretationTree] = {}
    for tree in trees:
        known = first.setdefault(tree.obj_id, tree).part
        if known.name != tree.part.name or not np.array_equal(known.vertices, tree.part.vertices):
            raise ItreeError(
                f"the trees of '{known.name}' and '{tree.part.name}', which are different parts, are both of object "
                f"{tree.obj_id}; compile one of them with another --obj-id"
            )
