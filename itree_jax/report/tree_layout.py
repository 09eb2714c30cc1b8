"""Where the boxes of a drawn tree are: nodes by depth from left to right, leaves from top to bottom."""

from dataclasses import dataclass

import numpy as np

from itree_jax.report.markup import EN_DASH, percent
from itree_jax.tree.drawing import Drawing, DrawnNode, Side, node_error, node_name
from itree_jax.tree.tree import PRUNED, InterpretationTree

BOX_H = 38.0  # [px] of a node
LEAST_W, PADDING = 92.0, 14.0  # [px] of a node
NAME_CHAR, SMALL_CHAR = 8.8, 5.9  # [px] of a character, on the wide side: fonts differ
ROW = 50.0  # [px] from leaf to leaf
MARGIN = 8.0
TURN = 14  # [px] behind a node where its edges part
MARK, MARK_GAP = 11.0, 5.0  # [px] of the dot before the faces that were asked for, and between two of them


@dataclass(frozen=True)
class Layout:
    """Places [px] by drawn node and by group; `end` tells where the leaves start."""

    node_x: tuple[float, ...]
    node_y: tuple[float, ...]
    node_w: tuple[float, ...]
    leaf_y: dict[int, float]
    end: float
    height: float

    def side_y(self, side: Side) -> float:
        """Where a side goes on."""
        if side.below is not None:
            return self.node_y[side.below]
        return float(np.mean([self.leaf_y[g] for g in side.groups]))


def layout(tree: InterpretationTree, drawing: Drawing) -> Layout:
    """A column for each depth, as wide as its widest box and the widest words on its edges."""
    nodes = drawing.nodes
    depth: list[int] = []
    for node in nodes:  # parents come first
        depth.append(0 if node.above is None else depth[node.above] + 1)
    width = [max(LEAST_W, *(PADDING + w for w in text_widths(tree, node))) for node in nodes]
    gap = [TURN + 22.0 + max(asked_width(tree, side) for side in node.sides) for node in nodes]
    starts = [MARGIN]
    for d in range(max(depth, default=-1) + 1):
        own = [k for k in range(len(nodes)) if depth[k] == d]
        starts.append(starts[-1] + max(width[k] for k in own) + max(gap[k] for k in own))
    at = Layout(
        node_x=tuple(starts[d] for d in depth), node_y=(0.0,) * len(nodes), node_w=tuple(width),
        leaf_y={g: MARGIN + ROW * (k + 0.5) for k, g in enumerate(drawing.leaves)},
        end=starts[-1] if nodes else MARGIN + 2.0 * TURN, height=2.0 * MARGIN + ROW * len(drawing.leaves),
    )  # fmt: skip
    node_y = list(at.node_y)
    for k in reversed(range(len(nodes))):
        first, last = nodes[k].sides[0], nodes[k].sides[-1]
        below = Layout(at.node_x, tuple(node_y), at.node_w, at.leaf_y, at.end, at.height)
        node_y[k] = 0.5 * (below.side_y(first) + below.side_y(last))
    return Layout(at.node_x, tuple(node_y), at.node_w, at.leaf_y, at.end, at.height)


def node_lines(tree: InterpretationTree, node: DrawnNode) -> tuple[str, str]:
    """What a box says: branches and rule; error on whole and on cut regions (nothing where it is pruned)."""
    rule = tree.nodes.rule[node.branches[0]]
    first = f"{node_name(tree, node)} · {rule}"
    if rule == PRUNED:
        return first, ""
    whole, cut = node_error(tree, node)
    return first, f"{percent(whole).removesuffix(' %')} / {percent(cut)}"


def text_widths(tree: InterpretationTree, node: DrawnNode) -> tuple[float, float]:
    first, second = node_lines(tree, node)
    return NAME_CHAR * len(first), SMALL_CHAR * len(second)


def asked_width(tree: InterpretationTree, side: Side) -> float:
    """[px] of the words on an edge."""
    return sum(MARK + SMALL_CHAR * len(faces_asked(tree, k)) + MARK_GAP for k, _ in side.answers)


def faces_asked(tree: InterpretationTree, branch: int) -> str:
    """Digits of the faces that a branch asks for, counted from 1 as in the paper: "1,2", "1-5", "1,3-5"."""
    digits = (np.flatnonzero(tree.nodes.tested[branch]) + 1).tolist()
    runs: list[list[int]] = []
    for d in digits:
        if runs and d == runs[-1][-1] + 1:
            runs[-1].append(d)
        else:
            runs.append([d])
    words = [",".join(map(str, run)) if len(run) < 3 else f"{run[0]}{EN_DASH}{run[-1]}" for run in runs]
    return ",".join(words)
