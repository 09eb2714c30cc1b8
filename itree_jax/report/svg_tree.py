"""The interpretation tree as an SVG picture, read from left to right.

`interpretation` is figure 4 of the paper: the nodes that decide, with rule and error, joined branches as one box, and
behind each leaf the chain of its determination rules. `branches` is figure 3: every branch and every attitude group,
those that are pruned dashed. An edge says which faces were asked for (filled dot: any of them is detectable, ring: none
is); the names on it are digits of the shape label.
"""

from typing import Literal

from itree_jax.report.markup import count_of, percent, text
from itree_jax.report.rule_titles import rule_title
from itree_jax.report.svg_leaf import leaf, leaf_width
from itree_jax.report.tree_layout import (
    BOX_H,
    MARGIN,
    MARK,
    MARK_GAP,
    SMALL_CHAR,
    TURN,
    Layout,
    faces_asked,
    layout,
    node_lines,
)
from itree_jax.tree.drawing import Drawing, DrawnNode, Side, branch_drawing, interpretation_drawing, node_name
from itree_jax.tree.tree import PRUNED, InterpretationTree

LEAST_SCALE = 0.8  # of its size: a page that is narrower than that scrolls
Figure = Literal["interpretation", "branches"]
EDGE_KEY = (
    "A filled dot leads to the side where any of the numbered identifying faces is detectable, a ring to the side "
    "where none is."
)
TREE_KEY = (
    "A box names branches and rule, then the error rates of the decision on whole / on cut regions; branches joined by "
    f"+ follow each other with one rule and are decided at once. {EDGE_KEY} S1, S2, ... are the representative "
    "attitudes with the shape label and the views of their groups, then the determination rules that are used, each "
    "with the share of draws that it leaves far from the truth and the freedom that it takes (degrees of freedom of "
    "the viewer direction, candidates of the rotation: 360 while all are open)."
)


def svg_tree(tree: InterpretationTree, group: int | None = None, figure: Figure = "interpretation") -> str:
    """The tree as one <svg> element; the way to attitude `group` is drawn bold. It is styled by the page's style."""
    drawing = interpretation_drawing(tree) if figure == "interpretation" else branch_drawing(tree)
    at = layout(tree, drawing)
    chains = figure == "interpretation"
    drawn = [edge(tree, drawing, at, k, side, group) for k, node in enumerate(drawing.nodes) for side in node.sides]
    edges = [markup for _, markup in sorted(drawn, key=lambda e: e[0])]  # the path lies on top
    if not drawing.nodes:
        edges = [stub(at, g, group) for g in drawing.leaves]
    boxes = [node_box(tree, at, k, node, group) for k, node in enumerate(drawing.nodes)]
    leaves = [leaf(tree, g, at.end, at.leaf_y[g], g == group, chains) for g in drawing.leaves]
    inside = "\n".join([*edges, *boxes, *leaves])
    width = at.end + max((leaf_width(tree, g, chains) for g in drawing.leaves), default=0.0) + MARGIN
    least = f"max-width:100%;min-width:{LEAST_SCALE * width:.0f}px"
    return (
        f'<svg class="tree{" has-path" if group in drawing.leaves else ""}" role="img" style="{least}" '
        f'viewBox="0 0 {width:.0f} {at.height:.0f}" width="{width:.0f}" height="{at.height:.0f}">'
        f"<title>{text(title(tree, drawing, group))}</title>\n{inside}\n</svg>"
    )


def title(tree: InterpretationTree, drawing: Drawing, group: int | None) -> str:
    what = count_of(len(drawing.nodes), "node") + ", " + count_of(len(drawing.leaves), "attitude group")
    path = "" if group is None else f"; the path to group {tree.groups.label_strings[group]} is bold"
    return f"Interpretation tree of {tree.part.name}: {what}{path}"


def edge(
    tree: InterpretationTree, drawing: Drawing, at: Layout, node: int, side: Side, group: int | None
) -> tuple[bool, str]:
    """From a node to what lies on one side of it; and whether the path runs along it."""
    x0, y0 = at.node_x[node] + at.node_w[node], at.node_y[node]
    if side.below is None:
        ends = [(at.end, at.leaf_y[g], g == group) for g in side.groups]
    else:
        ends = [(at.node_x[side.below], at.node_y[side.below], group in side.groups)]
    faded = " pruned" if tree.groups.pruned[list(side.groups)].all() else ""
    lines = "".join(
        f'<path class="edge{" on" if on else ""}{faded}" d="M{x0:.0f} {y0:.1f}h{TURN}V{y:.1f}H{x:.0f}"/>'
        for x, y, on in ends
    )
    return any(on for _, _, on in ends), lines + asked(tree, side, x0 + TURN + 9, at.side_y(side), faded)


def asked(tree: InterpretationTree, side: Side, x: float, y: float, faded: str) -> str:
    """The faces asked for along an edge, with a dot or a ring each."""
    said, marks = [], ""
    for k, visible in side.answers:
        faces = faces_asked(tree, k)
        said.append(f"{'any' if visible else 'none'} of the faces {faces} is detectable")
        marks += (
            f'<circle class="{"dot" if visible else "ring"}" cx="{x:.0f}" cy="{y - 8:.1f}" r="3.5"/>'
            f'<text x="{x + 7:.0f}" y="{y - 4:.1f}">{text(faces)}</text>'
        )
        x += MARK + SMALL_CHAR * len(faces) + MARK_GAP
    return f'<g class="asked{faded}"><title>{text("; ".join(said))}</title>{marks}</g>'


def stub(at: Layout, group_drawn: int, group: int | None) -> str:
    """The edge of a tree that is one leaf."""
    kind = "edge on" if group_drawn == group else "edge"
    return f'<path class="{kind}" d="M0 {at.leaf_y[group_drawn]:.1f}H{at.end:.0f}"/>'


def node_box(tree: InterpretationTree, at: Layout, k: int, node: DrawnNode, group: int | None) -> str:
    """Branches, rule and errors."""
    rule = tree.nodes.rule[node.branches[0]]
    first, second = node_lines(tree, node)
    x, y, width = at.node_x[k], at.node_y[k] - BOX_H / 2, at.node_w[k]
    kind = ("on " if group in node.groups else "") + ("pruned" if rule == PRUNED else "")
    lines = f'<text class="name" x="{x + width / 2:.0f}" y="{y + (15 if second else 23):.1f}">{text(first)}</text>'
    if second:
        lines += f'<text class="small" x="{x + width / 2:.0f}" y="{y + 30:.1f}">{text(second)}</text>'
    return (
        f'<g class="box {kind.strip()}"><title>{text(hint(tree, node))}</title><rect x="{x:.0f}" y="{y:.1f}" '
        f'width="{width:.0f}" height="{BOX_H:.0f}" rx="6"/>{lines}</g>'
    )


def hint(tree: InterpretationTree, node: DrawnNode) -> str:
    """What a box tells to the mouse: the rule's title, and of each branch the error with its interval."""
    nodes = tree.nodes
    rule = nodes.rule[node.branches[0]]
    said = f"{node_name(tree, node)}: {rule}, {rule_title(rule)}"
    if rule == PRUNED:
        return said
    for k in node.branches:
        low, high = (percent(v) for v in nodes.error_interval[k])
        said += f"; {nodes.branch[k]} errs in {percent(nodes.error[k])}, 95 % interval {low} to {high}"
        said += f", {count_of(int(nodes.draws[k]), 'noisy draw')}"
    return said
