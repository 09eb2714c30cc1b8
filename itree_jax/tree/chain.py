"""The determination rules behind a leaf, with the freedom that each takes, in words (Ikeuchi 1987, figure 4)."""

from itree_jax.tree.freedom import OPEN, Freedom, freedom_along
from itree_jax.tree.tree import InterpretationTree


def determination_chain(tree: InterpretationTree, group: int) -> list[tuple[str, str]]:
    """The determination rules of a group in order, with the freedom each takes."""
    steps = tree.determination.steps[group]
    freedom = freedom_along(steps)
    return [(rule, freedom_taken(*pair)) for rule, *pair in zip(steps, freedom[:-1], freedom[1:], strict=True)]


def freedom_taken(before: Freedom, after: Freedom) -> str:
    """Such as "direction 2 → 0" or "rotation 360 → 2" (degrees as long as all rotations are open)."""
    taken = []
    if before.direction != after.direction:
        taken.append(f"direction {before.direction} → {after.direction}")
    if before.rotations != after.rotations:
        taken.append(f"rotation {_rotations(before)} → {_rotations(after)}")
    return ", ".join(taken) or "nothing"


def left_open(tree: InterpretationTree, group: int) -> str:
    """What all steps together leave: of the viewer direction, of the rotation, or "unique"."""
    direction = freedom_along(tree.determination.steps[group])[-1].direction
    left = int(tree.determination.rotations_left[group])
    words = ["direction"] if direction else []
    if left != 1:
        words.append("rotation" if left == OPEN else f"{left} rotations")
    return f"{', '.join(words)} open" if words else "unique"


def _rotations(freedom: Freedom) -> str:
    return "360" if freedom.rotations == OPEN else str(freedom.rotations)
