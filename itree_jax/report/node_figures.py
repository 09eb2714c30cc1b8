"""The distributions that a node decides by: what noisy draws of the groups on each of its sides gave, a panel for each
quantity (Ikeuchi 1987, sec. 2.1.4; there the choice "is made by humans at present")."""

import numpy as np
from jaxtyping import Float

from itree_jax.report.markup import count_of, percent, text
from itree_jax.report.palette import css, cycle
from itree_jax.report.ridge import ridge
from itree_jax.report.rule_titles import rule_title
from itree_jax.tree.drawing import DrawnNode, interpretation_drawing, leaf_names, node_error, node_name
from itree_jax.tree.node_quantities import node_quantities, side_samples
from itree_jax.tree.tree import InterpretationTree

MOST_PANELS = 8  # shown at once, the most telling ones; the rest is folded away
MOST_NAMES = 6  # leaves named of one side


def node_cards(tree: InterpretationTree) -> str:
    """One card for each node of figure 4."""
    nodes = interpretation_drawing(tree).nodes
    if not nodes:
        return '<p class="empty">There is one leaf only: nothing to decide.</p>'
    return "\n".join(node_card(tree, node) for node in nodes)


def node_card(tree: InterpretationTree, node: DrawnNode) -> str:
    """Rule, errors and sides of a node, then its distributions."""
    rule = tree.nodes.rule[node.branches[0]]
    whole, cut = node_error(tree, node)
    names = leaf_names(tree)
    sides = "".join(
        f'<li><i style="background:{css(cycle(s))}"></i><b>{letter(s)}</b>&nbsp;'
        f"{side_names([name for g, name in names.items() if g in side.groups])}</li>"
        for s, side in enumerate(node.sides)
    )
    draws = count_of(int(tree.nodes.draws[list(node.branches)].max()), "noisy draw")
    shown, folded = panels(tree, node)
    more = f"<details><summary>{count_of(len(folded), 'more quantity', 'more quantities')}</summary>"
    more += f'<div class="panels">{"".join(folded)}</div></details>'
    return (
        f'<article class="card node"><h3>{text(node_name(tree, node))} · {text(rule)} <span>{text(rule_title(rule))}'
        f'</span></h3><p><span class="chip">errs in {percent(whole)} of whole regions</span> '
        f'<span class="chip">in {percent(cut)} of cut ones</span> <span class="chip">{draws}</span></p>'
        f'<ul class="legend">{sides}</ul><div class="panels">{"".join(shown)}</div>{more if folded else ""}</article>'
    )


def side_names(names: list[str]) -> str:
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return text(", ".join(names[:MOST_NAMES]) + more)


def letter(side: int) -> str:
    """a, b, c, ...: colour is not the only sign of a side."""
    return chr(ord("a") + side % 26)


def panels(tree: InterpretationTree, node: DrawnNode) -> tuple[list[str], list[str]]:
    """The panels that are shown, in the order of the rule's quantities, and those that are folded away."""
    top = node.branches[0]
    samples = [side_samples(tree, top, np.isin(np.arange(tree.groups.group_count), side.groups)) for side in node.sides]
    names = leaf_names(tree)
    known = dict(zip(tree.groups.label_strings, range(tree.groups.group_count), strict=True))
    drawn, telling = [], []
    for k, quantity in enumerate(node_quantities(tree, top)):
        columns = [rows[:, k] for rows in samples]
        label = quantity.name.split()[-1]
        title = f"{quantity.name} ({names[known[label]]})" if label in known else quantity.name
        drawn.append(ridge(columns, [letter(s) for s in range(len(columns))], title))
        telling.append(apart(columns))
    first = sorted(np.argsort(-np.array(telling), kind="stable")[:MOST_PANELS].tolist())
    return [drawn[k] for k in first], [drawn[k] for k in range(len(drawn)) if k not in first]


def apart(columns: list[Float[np.ndarray, "_"]]) -> float:
    """How well a quantity alone parts one side from the others: the largest distance between their shares below any
    value (Kolmogorov and Smirnov's), of the side that it parts best."""
    best = 0.0
    for s, own in enumerate(columns):
        others = np.concatenate([c for t, c in enumerate(columns) if t != s])
        if len(own) and len(others):
            at = np.concatenate([own, others])
            below = [np.searchsorted(np.sort(c), at, side="right") / len(c) for c in (own, others)]
            best = max(best, float(np.abs(below[0] - below[1]).max()))
    return best
