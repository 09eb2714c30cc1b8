"""What a tree cannot tell apart: symmetries, branches whose best rule errs often, rotations that no rule settles."""

import numpy as np

from itree_jax.report.markup import count_of, percent
from itree_jax.tree.choice import ERROR_BOUND
from itree_jax.tree.tree import PRUNED, InterpretationTree


def ambiguities(tree: InterpretationTree) -> tuple[str, ...]:
    """Sentences in plain text, the most fundamental first; none when the tree tells every attitude."""
    return (*symmetry_notes(tree), *branch_notes(tree), *rotation_notes(tree))


def symmetry_notes(tree: InterpretationTree) -> list[str]:
    """The part itself looks the same from several attitudes."""
    notes = []
    for axis, _ in tree.symmetries.continuous:
        direction = ", ".join(f"{v + 0.0:.2f}" for v in np.round(np.asarray(axis, float), 2))
        notes.append(f"The part is one of revolution about ({direction}): the turn about this axis cannot be told.")
    others = len(tree.symmetries.discrete) - 1
    if others:
        turns = count_of(others, "rotation carries", "rotations carry")
        notes.append(f"{turns} the part into itself: poses are known up to these.")
    return notes


def branch_notes(tree: InterpretationTree) -> list[str]:
    """Branches whose chosen rule errs more often than the bound."""
    nodes, notes = tree.nodes, []
    for k in np.argsort(-nodes.error, kind="stable"):
        if nodes.rule[k] == PRUNED or nodes.error[k] <= ERROR_BOUND:
            continue
        visible, hidden = (side_labels(tree, side[k]) for side in (nodes.visible, nodes.hidden))
        notes.append(
            f"{nodes.branch[k]}: the best rule ({nodes.rule[k]}) errs in {percent(float(nodes.error[k]))} of the draws "
            f"between {visible} and {hidden}; both sides go on with their likelihoods."
        )
    return notes


def rotation_notes(tree: InterpretationTree) -> list[str]:
    """Groups whose determination rules leave rotations."""
    left, notes = tree.determination.rotations_left, []
    kept = ~tree.groups.pruned
    for count, said in ((0, "leave the rotation open: all candidates go on to refinement"),
                        (2, "leave two rotations: both go on to refinement")):  # fmt: skip
        members = kept & (left == count)
        if members.any():
            notes.append(f"The determination rules of {side_labels(tree, members)} {said}.")
    return notes


def side_labels(tree: InterpretationTree, members: np.ndarray) -> str:
    """Labels of the groups that are not pruned."""
    chosen = np.flatnonzero(members & ~tree.groups.pruned)
    return ", ".join(tree.groups.label_strings[g] for g in chosen) or "pruned groups"
