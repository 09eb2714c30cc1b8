"""A leaf of the drawn tree: representative attitude, then the chain of determination rules with the freedom each takes
(figure 4 of the paper)."""

import numpy as np

from itree_jax.report.markup import NOT_KNOWN, count_of, percent, text
from itree_jax.report.rule_titles import rule_title
from itree_jax.report.tree_layout import PADDING, SMALL_CHAR
from itree_jax.tree.chain import determination_chain, left_open
from itree_jax.tree.drawing import leaf_names
from itree_jax.tree.tree import InterpretationTree

CHAR = 8.0  # [px] of a leaf's digits
NAME_W = 36.0  # [px] of S1, S2, ...
STEP_W, STEP_H, STEP_GAP = 108.0, 36.0, 12.0  # [px] of a determination rule; wider where it takes all freedom at once
OPEN_W = 150.0  # [px] of what is left open


def leaf_width(tree: InterpretationTree, group: int, chain: bool) -> float:
    """[px] that a leaf takes."""
    boxes = sum(step_width(taken) + STEP_GAP for _, taken in determination_chain(tree, group)) if chain else 0.0
    return label_width(tree) + boxes + OPEN_W


def step_width(taken: str) -> float:
    return max(STEP_W, PADDING + SMALL_CHAR * len(taken))


def label_width(tree: InterpretationTree) -> float:
    return NAME_W + 24 + max(80.0, CHAR * max(len(label) for label in tree.groups.label_strings))


def leaf(tree: InterpretationTree, g: int, x: float, y: float, on: bool, chain: bool) -> str:
    """Name, label and views of an attitude group; its determination rules with what they leave, or why it is pruned."""
    groups = tree.groups
    pruned = bool(groups.pruned[g])
    views = count_of(int(groups.view_count[g]), "view")
    hint = f"attitude group {groups.label_strings[g]}, {views}"
    hint += f"; pruned: {groups.pruned_reason[g]}" if pruned else ""
    name = leaf_names(tree).get(g, NOT_KNOWN)
    parts = [
        f'<g class="leaf{" on" if on else ""}{" pruned" if pruned else ""}"><title>{text(hint)}</title>'
        f'<text class="attitude" x="{x + 6:.0f}" y="{y + 5:.1f}">{name}</text>'
        f'<text class="label" x="{x + NAME_W + 6:.0f}" y="{y - 1:.1f}">{text(groups.label_strings[g])}</text>'
        f'<text class="small" x="{x + NAME_W + 6:.0f}" y="{y + 13:.1f}">{text(views)}</text>'
    ]
    x += label_width(tree)
    if chain and not pruned:
        for rule, taken in determination_chain(tree, g):
            parts.append(step_box(tree, g, rule, taken, x, y, on))
            x += step_width(taken) + STEP_GAP
    said = "pruned" if pruned else left_open(tree, g) if chain else ""
    parts.append(f'<text class="open" x="{x:.0f}" y="{y + 4:.1f}">{text(said)}</text></g>')
    return "".join(parts)


def step_box(tree: InterpretationTree, g: int, rule: str, taken: str, x: float, y: float, on: bool) -> str:
    """A determination rule with the line that leads to it."""
    determination = tree.determination
    column = determination.rules.index(rule)
    error = float(determination.error[g, column])
    low, high = (percent(v) for v in determination.error_interval[g, column])
    draws = count_of(int(determination.draws[g]), "noisy draw")
    hint = f"{rule}, {rule_title(rule)}: error {percent(error)} of {draws}, 95 % interval {low} to {high}; {taken}"
    shown = f"{rule} · {percent(error)}" if np.isfinite(error) else rule
    width = step_width(taken)
    return (
        f'<path class="edge{" on" if on else ""}" d="M{x - STEP_GAP:.0f} {y:.1f}h{STEP_GAP:.0f}"/>'
        f'<g class="box step{" on" if on else ""}"><title>{text(hint)}</title><rect x="{x:.0f}" '
        f'y="{y - STEP_H / 2:.1f}" width="{width:.0f}" height="{STEP_H:.0f}" rx="6"/>'
        f'<text class="name" x="{x + width / 2:.0f}" y="{y - 3:.1f}">{text(shown)}</text>'
        f'<text class="small" x="{x + width / 2:.0f}" y="{y + 11:.1f}">{text(taken)}</text></g>'
    )
