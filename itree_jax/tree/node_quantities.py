"""The numbers that a node compares, by name: of its rule, or of both rules of a pair.

Those of a relational rule are the agreements with the groups that the node tells apart.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from itree_jax.tree.classification_rules import CLASSIFICATION_RULES, PAIR, rules_in
from itree_jax.tree.tree import PRUNED, InterpretationTree


class NodeQuantity(NamedTuple):
    """One number of a node."""

    name: str
    rule: int  # index in CLASSIFICATION_RULES
    column: int  # of the rule's quantity


def node_quantities(tree: InterpretationTree, node: int) -> list[NodeQuantity]:
    """What a branch compares; nothing where it is pruned."""
    nodes, labels = tree.nodes, tree.groups.label_strings
    if nodes.rule[node] == PRUNED:
        return []
    here = np.flatnonzero((nodes.visible[node] | nodes.hidden[node]) & ~tree.groups.pruned)
    found = []
    for k in rules_in(nodes.rule[node]):
        rule = CLASSIFICATION_RULES[k]
        prefix = f"{rule.name} " if PAIR in nodes.rule[node] else ""
        if rule.relational:
            found += [NodeQuantity(f"{prefix}agreement with {labels[g]}", k, int(g)) for g in here]
        else:
            found += [NodeQuantity(f"{prefix}{name}", k, c) for c, name in enumerate(rule.quantity_names)]
    return found


def side_samples(
    tree: InterpretationTree, node: int, members: Bool[np.ndarray, "groups"]
) -> Float[np.ndarray, "draws quantities"]:
    """What the draws of some groups gave for each of `node_quantities`, one row a draw."""
    columns = []
    for quantity in node_quantities(tree, node):
        samples = tree.distributions.samples[quantity.rule]
        columns.append(samples[members & ~tree.groups.pruned][..., quantity.column].reshape(-1))
    rows = np.stack(columns, axis=1) if columns else np.zeros((0, 0), np.float32)
    return rows[~np.isnan(rows).any(axis=1)]
