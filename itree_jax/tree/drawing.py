"""What the paper's tree drawings hold: the branches of figure 3, and the many-way nodes of figure 4.

Figure 4, "the interpretation tree", has no pruned branches and no pruned groups, and consecutive branches of one rule
are one node with several sides (Ikeuchi 1987, sec. 2.1.5). Its leaves are the representative attitudes S1, S2, ...
"""

from typing import NamedTuple

import numpy as np

from itree_jax.tree.joining import many_way_nodes, many_way_sides
from itree_jax.tree.tree import ROOT, InterpretationTree


class Side(NamedTuple):
    """One way on from a node."""

    groups: tuple[int, ...]
    answers: tuple[tuple[int, bool], ...]  # branch, and whether any of its faces is detectable on this side
    below: int | None  # the drawn node that divides it further; None: its groups are leaves


class DrawnNode(NamedTuple):
    """A box of the drawing."""

    branches: tuple[int, ...]  # the top one first; more than one where they are joined
    above: int | None  # drawn node
    sides: tuple[Side, ...]  # from top to bottom: detectable before not detectable

    @property
    def groups(self) -> tuple[int, ...]:
        """Groups that reach it."""
        return tuple(g for side in self.sides for g in side.groups)


class Drawing(NamedTuple):
    """Nodes, parents first, and the groups that are drawn, from top to bottom."""

    nodes: tuple[DrawnNode, ...]
    leaves: tuple[int, ...]


def branch_drawing(tree: InterpretationTree) -> Drawing:
    """Figure 3: every branch with two sides, pruned ones as well, and every attitude group."""
    nodes = tree.nodes
    drawn = []
    for k in range(len(nodes.branch)):
        sides = []
        for visible, members in ((True, nodes.visible[k]), (False, nodes.hidden[k])):
            below = np.flatnonzero((nodes.parent == k) & (nodes.on_visible_side == visible))
            groups = tuple(np.flatnonzero(members).tolist())
            sides.append(Side(groups, ((k, visible),), int(below[0]) if len(below) else None))
        above = int(nodes.parent[k])
        drawn.append(DrawnNode((k,), None if above == ROOT else above, tuple(sides)))
    return Drawing(tuple(drawn), leaves_of(drawn, np.arange(tree.groups.group_count)))


def interpretation_drawing(tree: InterpretationTree) -> Drawing:
    """Figure 4: the nodes that decide something, and the groups that have a representative attitude."""
    kept = ~tree.groups.pruned
    tops = many_way_nodes(tree.nodes)
    reached = [frozenset(np.flatnonzero((tree.nodes.visible[k] | tree.nodes.hidden[k]) & kept).tolist()) for k in tops]
    above: dict[int, int] = {}
    drawn = []
    for own, top in enumerate(tops):
        side_of = many_way_sides(tree.nodes, kept, top)
        branches = tuple(np.flatnonzero(tree.nodes.joined == top).tolist())
        sides = []
        for s in range(int(side_of.max()) + 1):
            groups = tuple(np.flatnonzero(side_of == s).tolist())
            below = reached.index(frozenset(groups)) if frozenset(groups) in reached else None
            if below is not None:
                above[below] = own
            sides.append(Side(groups, answers_of(tree, branches, groups[0]), below))
        drawn.append(DrawnNode(branches, above.get(own), tuple(sides)))
    return Drawing(tuple(drawn), leaves_of(drawn, np.flatnonzero(kept)))


def answers_of(tree: InterpretationTree, branches: tuple[int, ...], group: int) -> tuple[tuple[int, bool], ...]:
    """What a group answers to the branches that it reaches."""
    visible, hidden = tree.nodes.visible[:, group], tree.nodes.hidden[:, group]
    return tuple((k, bool(visible[k])) for k in branches if visible[k] or hidden[k])


def leaves_of(nodes: list[DrawnNode], groups: np.ndarray) -> tuple[int, ...]:
    """The groups in the order of the picture, in which no edges cross."""

    def below(node: int) -> list[int]:
        found: list[int] = []
        for side in nodes[node].sides:
            found += list(side.groups) if side.below is None else below(side.below)
        return found

    return tuple(below(0)) if nodes else tuple(int(g) for g in groups)


def leaf_names(tree: InterpretationTree) -> dict[int, str]:
    """S1, S2, ... for the groups with a representative attitude, from top to bottom of figure 4."""
    return {g: f"S{k + 1}" for k, g in enumerate(interpretation_drawing(tree).leaves)}


def node_name(tree: InterpretationTree, node: DrawnNode) -> str:
    """Such as "B0+B1"."""
    return "+".join(tree.nodes.branch[k] for k in node.branches)


def node_error(tree: InterpretationTree, node: DrawnNode) -> tuple[float, float]:
    """Error rates of the node's decision on whole and on cut regions: of all its sides at once where it is joined."""
    top = node.branches[0]
    whole, cut = tree.nodes.joined_error[top] if len(node.branches) > 1 else tree.nodes.whole_and_cut[top]
    return float(whole), float(cut)
