"""The reason for an answer: every node and determination step, with what was measured and what it was compared with."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from itree_jax.detections import Alternative, Step, count_of_poses
from itree_jax.tree.classify import Classification
from itree_jax.tree.confusion import inseparable
from itree_jax.tree.determine import remaining_freedom
from itree_jax.tree.freedom import freedom_along
from itree_jax.tree.node_quantities import node_quantities, side_samples
from itree_jax.tree.tree import PRUNED, ROOT, InterpretationTree


def decision_path(tree: InterpretationTree, said: Classification, region: int, row: int) -> tuple[Step, ...]:
    """The path of a region to the group of appearance `row`, from the root."""
    group = int(tree.appearances.group[tree.appearances.attitude[row]])
    nodes = path_to(tree, group)
    steps = [classification_step(tree, said, region, node, group) for node in nodes if tree.nodes.rule[node] != PRUNED]
    return (*steps, *determination_steps(tree, group))


def path_to(tree: InterpretationTree, group: int) -> list[int]:
    """Nodes from the root to a group."""
    nodes = tree.nodes
    through = [k for k in range(len(nodes.branch)) if nodes.visible[k, group] or nodes.hidden[k, group]]
    return sorted(through, key=lambda k: depth_of(tree, k))


def depth_of(tree: InterpretationTree, node: int) -> int:
    depth = 0
    while tree.nodes.parent[node] != ROOT:
        node, depth = int(tree.nodes.parent[node]), depth + 1
    return depth


def classification_step(tree: InterpretationTree, said: Classification, region: int, node: int, group: int) -> Step:
    """One node: what its rule measured, the means of both sides, and the margin toward the side taken."""
    nodes, labels = tree.nodes, tree.groups.label_strings
    asked = node_quantities(tree, node)
    measured = np.array([said.quantities[q.rule][region, q.column] for q in asked], float)
    kept = ~tree.groups.pruned
    sides = {"visible": nodes.visible[node] & kept, "hidden": nodes.hidden[node] & kept}
    taken = bool(nodes.visible[node, group])
    margin = float(said.node_margin[region, node]) * (1.0 if taken else -1.0)
    names = [q.name for q in asked]
    compared = {
        side: {
            "groups": [labels[g] for g in np.flatnonzero(members)],
            **dict(zip(names, _rounded(side_mean(tree, node, members)), strict=True)),
        }
        for side, members in sides.items()
    }
    before = int(np.sum(sides["visible"] | sides["hidden"]))
    after = int(np.sum(sides["visible"] if taken else sides["hidden"]))
    whole, cut = nodes.whole_and_cut[node]
    top = int(nodes.joined[node])
    also = {"joined_with": nodes.branch[top]} if top != node else {}
    return Step(
        node=node, rule=nodes.rule[node], measured=dict(zip(names, _rounded(measured), strict=True)),
        compared_with={
            **compared, "taken": "visible" if taken else "hidden", "branch": nodes.branch[node], **also,
            "error_rate": round(float(nodes.error[node]), 4), "error_whole": round(float(whole), 4),
            "error_cut": round(float(cut), 4),
        },
        margin=round(margin, 3), freedom_before=counted_groups(before), freedom_after=counted_groups(after),
    )


def counted_groups(count: int) -> str:
    return f"{count} attitude group" if count == 1 else f"{count} attitude groups"


def determination_steps(tree: InterpretationTree, group: int) -> list[Step]:
    """The group's determination steps with their measured errors and the freedom each takes away; last, what is left to
    refinement, with the groups that no rule tells from this one."""
    determination, labels = tree.determination, tree.groups.label_strings
    node = len(tree.nodes.branch) + group
    chain = determination.steps[group]
    freedom = freedom_along(chain)
    steps = []
    for rule, before, after in zip(chain, freedom[:-1], freedom[1:], strict=True):
        error = float(determination.error[group, determination.rules.index(rule)])
        steps.append(Step(
            node=node, rule=rule, measured=None,
            compared_with={"group": labels[group], "error_rate": round(error, 4)}, margin=None,
            freedom_before=str(before), freedom_after=str(after),
        ))
    alternatives = [labels[g] for g in inseparable(tree, group)]
    left = int(determination.rotations_left[group])
    if left != 1 or alternatives:
        also = {"alternatives": alternatives} if alternatives else {}
        steps.append(Step(
            node=node, rule="refinement", measured=None,
            compared_with={"group": labels[group], "open": remaining_freedom(left), **also}, margin=None,
            freedom_before=str(freedom[-1]), freedom_after="unique",
        ))
    return steps


def side_mean(tree: InterpretationTree, node: int, members: np.ndarray) -> Float[np.ndarray, "d"]:
    rows = side_samples(tree, node, members)
    return rows.mean(axis=0) if len(rows) else np.full(len(node_quantities(tree, node)), np.nan)


def _rounded(values: np.ndarray) -> list[float]:
    return [round(float(v), 4) for v in values]


def verification_step(
    tree: InterpretationTree, evidence: float, rivals: Sequence[float], margins: Sequence[float],
    alternatives: tuple[Alternative, ...],
) -> Step:
    """The last word: the log-likelihood [nats] of the rendered pose and of those that explain the same place nearly as
    well, with the margins over them in the pixels that tell them apart.
    """
    count = len(tree.nodes.branch) + tree.groups.group_count
    left = count_of_poses(alternatives)
    return Step(
        node=count, rule="verification", measured={"evidence": round(evidence, 1)},
        compared_with={
            "rivals": [round(r, 1) for r in rivals], "shares": [round(a.share, 3) for a in alternatives],
        },
        margin=round(min(margins), 3) if margins else None,
        freedom_before="unique" if not rivals else f"{1 + len(rivals)} poses of this place",
        freedom_after="unique" if left == 1 else f"ambiguous: {left} poses that the scene does not tell apart",
    )
