"""Which way through an interpretation tree an answer took."""

from collections.abc import Sequence

import numpy as np

from itree_jax.detections import Step
from itree_jax.tree.tree import InterpretationTree


def group_reached(tree: InterpretationTree, steps: Sequence[Step]) -> int | None:
    """The attitude group at the end of a decision path; None if the path does not say.

    Steps of the determination part name their group as node `branches + group`; else the last node's side tells it,
    where it holds but one group that is not pruned.
    """
    branch_count = len(tree.nodes.branch)
    for step in reversed(steps):
        if branch_count <= step.node < branch_count + tree.groups.group_count:
            return step.node - branch_count
    if not steps:
        return None
    node, said = steps[-1].node, steps[-1].compared_with
    taken = said.get("taken") if isinstance(said, dict) else None
    if not 0 <= node < branch_count or taken not in ("visible", "hidden"):
        return None
    side = tree.nodes.visible[node] if taken == "visible" else tree.nodes.hidden[node]
    left = np.flatnonzero(side & ~tree.groups.pruned)
    return int(left[0]) if len(left) == 1 else None
