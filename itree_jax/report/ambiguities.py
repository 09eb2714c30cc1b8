"""What a tree cannot tell apart, in sentences: symmetries, and what `describe` lists as ambiguities."""

import numpy as np

from itree_jax.report.markup import count_of, percent
from itree_jax.tree.describe import ambiguities
from itree_jax.tree.tree import InterpretationTree


def ambiguity_notes(tree: InterpretationTree) -> tuple[str, ...]:
    """Plain text, the most fundamental first; none when the tree tells every attitude."""
    found = ambiguities(tree)
    groups = sorted((a for a in found if a["kind"] == "groups"), key=lambda a: -a["error_rate"])
    rotations = [a for a in found if a["kind"] == "rotation"]
    return (*symmetry_notes(tree), *(group_note(a) for a in groups), *rotation_notes(rotations))


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


def group_note(ambiguity: dict) -> str:
    """Two groups that every rule confuses."""
    first, second = ambiguity["groups"]
    return (
        f"{first} and {second}: the best rule between them ({ambiguity['rule']}) errs in "
        f"{percent(ambiguity['error_rate'])} of the draws; both go on as alternatives."
    )


def rotation_notes(rotations: list[dict]) -> list[str]:
    """Groups whose determination rules leave rotations, together by how many these are."""
    notes = []
    for left in sorted({a["rotations_left"] for a in rotations}):
        labels = ", ".join(a["group"] for a in rotations if a["rotations_left"] == left)
        said = "the rotation open" if left == 0 else count_of(left, "rotation")
        notes.append(f"The determination rules of {labels} leave {said}: all candidates go on to refinement.")
    return notes
