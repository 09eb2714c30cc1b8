"""The interpretation tree as an SVG picture, like figures 3 and 4 of the paper, read from left to right.

Boxes of the classification part name branch, rule and measured error; an edge says which faces were asked for (filled
dot: any of them is detectable, ring: none is). A leaf is an attitude group with its determination rules behind it.
"""

from dataclasses import dataclass

import numpy as np

from itree_jax.report.markup import EN_DASH, count_of, number, percent, text
from itree_jax.report.rule_titles import rule_title
from itree_jax.report.tree_path import child_of, roots
from itree_jax.tree.tree import PRUNED, InterpretationTree

BOX_W, BOX_H = 106.0, 38.0  # [px] of a branch
COLUMN = 190.0  # [px] from branch to branch
ROW = 48.0  # [px] from leaf to leaf
MARGIN = 8.0
TURN = 14  # [px] behind a branch where its edges part
CHAR = 8.0  # [px] of a leaf's digits
STEP_W, STEP_GAP = 66.0, 10.0  # [px] of a determination rule
TREE_KEY = (
    "In the tree, a box names branch, rule and measured error rate with its 95 % interval. A filled dot leads to the "
    "side where any of the numbered identifying faces is detectable, a ring to the side where none is. A leaf gives "
    "shape label and views of an attitude group, then its determination rules with the share of draws that each leaves "
    "far from the truth."
)
OPEN = {0: "rotation open", 1: "unique"}


@dataclass(frozen=True)
class Layout:
    """Where things are [px]; `end` tells where the leaves' labels start."""

    node_x: dict[int, float]
    node_y: dict[int, float]
    leaf_y: dict[int, float]
    end: float
    width: float
    height: float


def svg_tree(tree: InterpretationTree, group: int | None = None) -> str:
    """The tree as one <svg> element; the way to attitude `group` is drawn bold. It is styled by the page's style."""
    at = layout(tree)
    order = range(len(tree.nodes.branch))
    drawn = [edge(tree, at, node, visible, group) for node in order for visible in (True, False)]
    edges = [markup for _, markup in sorted(drawn, key=lambda e: e[0])]  # the path lies on top
    boxes = [node_box(tree, at, node, group) for node in order]
    leaves = [leaf(tree, at, g, group) for g in at.leaf_y]
    if not order:
        edges = [stub(at, g, group) for g in at.leaf_y]
    name = f"Interpretation tree of {tree.part.name}: {count_of(len(order), 'branch', 'branches')}, " + count_of(
        tree.groups.group_count, "attitude group"
    )
    if group is not None:
        name += f"; the path to group {tree.groups.label_strings[group]} is bold"
    inside = "\n".join([*edges, *boxes, *leaves])
    return (
        f'<svg class="tree{" has-path" if group is not None else ""}" role="img" '
        f'viewBox="0 0 {at.width:.0f} {at.height:.0f}" width="{at.width:.0f}" height="{at.height:.0f}">'
        f"<title>{text(name)}</title>\n{inside}\n</svg>"
    )


def layout(tree: InterpretationTree) -> Layout:
    """Branches by depth from left to right, leaves from top to bottom so that no edges cross."""
    nodes = tree.nodes
    leaf_y = {g: MARGIN + ROW * (k + 0.5) for k, g in enumerate(leaf_order(tree))}
    depth: dict[int, int] = {}
    for k in range(len(nodes.branch)):  # parents come first
        depth[k] = depth.get(int(nodes.parent[k]), -1) + 1
    node_x = {k: MARGIN + COLUMN * d for k, d in depth.items()}
    node_y: dict[int, float] = {}
    for k in reversed(range(len(nodes.branch))):
        sides = [side_y(tree, k, visible, node_y, leaf_y) for visible in (True, False)]
        node_y[k] = 0.5 * (sides[0] + sides[1])
    end = MARGIN + COLUMN * (max(depth.values(), default=-1) + 1)
    behind = [leaf_width(tree, g) for g in leaf_y]
    return Layout(node_x, node_y, leaf_y, end, end + max(behind) + MARGIN, 2 * MARGIN + ROW * len(leaf_y))


def leaf_order(tree: InterpretationTree) -> list[int]:
    """Groups from top to bottom: of every branch the visible side first."""

    def below(node: int | None, members: np.ndarray) -> list[int]:
        if node is None:
            return np.flatnonzero(members).tolist()
        visible, hidden = tree.nodes.visible[node], tree.nodes.hidden[node]
        return below(child_of(tree, node, True), visible) + below(child_of(tree, node, False), hidden)

    first = roots(tree)
    return below(first[0] if first else None, np.ones(tree.groups.group_count, bool))


def side_y(
    tree: InterpretationTree, node: int, visible: bool, node_y: dict[int, float], leaf_y: dict[int, float]
) -> float:
    child = child_of(tree, node, visible)
    if child is not None:
        return node_y[child]
    members = tree.nodes.visible[node] if visible else tree.nodes.hidden[node]
    return float(np.mean([leaf_y[int(g)] for g in np.flatnonzero(members)]))


def edge(tree: InterpretationTree, at: Layout, node: int, visible: bool, group: int | None) -> tuple[bool, str]:
    """From a branch to what lies on one side of it; and whether the path runs along it."""
    members = tree.nodes.visible[node] if visible else tree.nodes.hidden[node]
    child = child_of(tree, node, visible)
    x0, y0 = at.node_x[node] + BOX_W, at.node_y[node]
    if child is None:
        ends = [(at.end, at.leaf_y[int(g)], g == group) for g in np.flatnonzero(members)]
    else:
        ends = [(at.node_x[child], at.node_y[child], group is not None and bool(members[group]))]
    faded = " pruned" if tree.groups.pruned[members].all() else ""
    lines = "".join(
        f'<path class="edge{" on" if on else ""}{faded}" d="M{x0:.0f} {y0:.1f}h{TURN}V{y:.1f}H{x:.0f}"/>'
        for x, y, on in ends
    )
    faces = ",".join(str(d + 1) for d in np.flatnonzero(tree.nodes.tested[node]))
    said = f"{'any' if visible else 'none'} of the faces {faces} is detectable"
    mark = "dot" if visible else "ring"
    y = side_y(tree, node, visible, at.node_y, at.leaf_y)
    x = x0 + TURN + 9
    return any(on for _, _, on in ends), (
        f'{lines}<g class="asked{faded}"><title>{text(said)}</title><circle class="{mark}" cx="{x:.0f}" '
        f'cy="{y - 8:.1f}" r="3.5"/><text x="{x + 7:.0f}" y="{y - 4:.1f}">{text(faces)}</text></g>'
    )


def stub(at: Layout, group_drawn: int, group: int | None) -> str:
    """The edge of a tree that is one leaf."""
    kind = "edge on" if group_drawn == group else "edge"
    return f'<path class="{kind}" d="M0 {at.leaf_y[group_drawn]:.1f}H{at.end:.0f}"/>'


def node_box(tree: InterpretationTree, at: Layout, node: int, group: int | None) -> str:
    """Branch, rule and measured error with its interval."""
    nodes = tree.nodes
    on = group is not None and bool(nodes.visible[node, group] or nodes.hidden[node, group])
    pruned = nodes.rule[node] == PRUNED
    low, high = (100.0 * float(v) for v in nodes.error_interval[node])
    first = f"{nodes.branch[node]} · {nodes.rule[node]}"
    second = "" if pruned else f"{percent(nodes.error[node])} [{number(low)}{EN_DASH}{number(high)}]"
    hint = f"{nodes.branch[node]}: {nodes.rule[node]}, {rule_title(nodes.rule[node])}"
    if not pruned:
        hint += f"; error {percent(nodes.error[node])}, 95 % interval {number(low)} to {number(high)} %, "
        hint += count_of(int(nodes.draws[node]), "noisy draw")
    x, y = at.node_x[node], at.node_y[node] - BOX_H / 2
    kind = ("on " if on else "") + ("pruned" if pruned else "")
    lines = f'<text class="name" x="{x + BOX_W / 2:.0f}" y="{y + (15 if second else 23):.1f}">{text(first)}</text>'
    if second:
        lines += f'<text class="small" x="{x + BOX_W / 2:.0f}" y="{y + 30:.1f}">{text(second)}</text>'
    return (
        f'<g class="box {kind.strip()}"><title>{text(hint)}</title><rect x="{x:.0f}" y="{y:.1f}" width="{BOX_W:.0f}" '
        f'height="{BOX_H:.0f}" rx="6"/>{lines}</g>'
    )


def leaf_width(tree: InterpretationTree, group: int) -> float:
    """[px] that a leaf takes: label, determination rules, what they leave open."""
    return label_width(tree) + (STEP_W + STEP_GAP) * len(tree.determination.steps[group]) + 110


def label_width(tree: InterpretationTree) -> float:
    return 24 + max(80.0, CHAR * max(len(label) for label in tree.groups.label_strings))


def leaf(tree: InterpretationTree, at: Layout, g: int, group: int | None) -> str:
    """Label and views of an attitude group, then its determination rules with their measured errors."""
    groups, determination = tree.groups, tree.determination
    pruned, on = bool(groups.pruned[g]), g == group
    x, y = at.end, at.leaf_y[g]
    views = count_of(int(groups.view_count[g]), "view")
    hint = f"attitude group {groups.label_strings[g]}, {views}"
    hint += f"; pruned: {groups.pruned_reason[g]}" if pruned else ""
    parts = [
        f'<g class="leaf{" on" if on else ""}{" pruned" if pruned else ""}"><title>{text(hint)}</title>'
        f'<text class="label" x="{x + 6:.0f}" y="{y - 1:.1f}">{text(groups.label_strings[g])}</text>'
        f'<text class="small" x="{x + 6:.0f}" y="{y + 13:.1f}">{text(views)}</text>'
    ]
    x += label_width(tree)
    for rule in determination.steps[g]:
        parts.append(step_box(tree, g, rule, x, y, on))
        x += STEP_W + STEP_GAP
    left = int(determination.rotations_left[g])
    said = "pruned" if pruned else OPEN.get(left, f"{left} rotations left")
    parts.append(f'<text class="open" x="{x:.0f}" y="{y + 4:.1f}">{text(said)}</text></g>')
    return "".join(parts)


def step_box(tree: InterpretationTree, g: int, rule: str, x: float, y: float, on: bool) -> str:
    """A determination rule with the line that leads to it."""
    determination = tree.determination
    error = float(determination.error[g, determination.rules.index(rule)])
    draws = count_of(int(determination.draws[g]), "noisy draw")
    hint = f"{rule}, {rule_title(rule)}: error {percent(error)} of {draws}"
    return (
        f'<path class="edge{" on" if on else ""}" d="M{x - STEP_GAP:.0f} {y:.1f}h{STEP_GAP:.0f}"/>'
        f'<g class="box step{" on" if on else ""}"><title>{text(hint)}</title><rect x="{x:.0f}" y="{y - 17:.1f}" '
        f'width="{STEP_W:.0f}" height="34" rx="6"/>'
        f'<text class="name" x="{x + STEP_W / 2:.0f}" y="{y - 3:.1f}">{text(rule)}</text>'
        f'<text class="small" x="{x + STEP_W / 2:.0f}" y="{y + 11:.1f}">{text(percent(error))}</text></g>'
    )
