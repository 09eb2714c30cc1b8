"""What the tree cannot tell apart, drawn: both views of two groups that no rule separates, and the attitudes between
which a rotation stays open."""

from typing import Any

import numpy as np
from jaxtyping import Float

from itree_jax.report.ambiguities import ambiguity_notes, group_note
from itree_jax.report.attitude_pictures import Cutout, cutout, part_views, trimmed
from itree_jax.report.markup import image, text
from itree_jax.tree.chain import left_open
from itree_jax.tree.describe import ambiguities
from itree_jax.tree.drawing import leaf_names
from itree_jax.tree.leaf_model import LeafModel
from itree_jax.tree.tree import InterpretationTree


def ambiguity_section(tree: InterpretationTree, pictures: list[Cutout]) -> str:
    """All of them in sentences, then those that can be looked at; `pictures` are those of all groups."""
    notes = ambiguity_notes(tree)
    if not notes:
        return "<p>None: the rules tell all groups and rotations apart.</p>"
    said = "<ul>" + "".join(f"<li>{text(note)}</li>" for note in notes) + "</ul>"
    found = ambiguities(tree)
    pairs = "".join(pair_figure(tree, a, pictures) for a in found if a["kind"] == "groups")
    turns = rotation_figures(tree, [a for a in found if a["kind"] == "rotation"], pictures)
    return f'{said}<div class="ambiguities">{pairs}{turns}</div>'


def pair_figure(tree: InterpretationTree, ambiguity: dict[str, Any], pictures: list[Cutout]) -> str:
    """The representative attitudes of two groups side by side."""
    labels, names = tree.groups.label_strings, leaf_names(tree)
    members = [labels.index(label) for label in ambiguity["groups"]]
    seen = zip(members, ambiguity["views"], strict=True)
    shown = [(pictures[g], f"{names[g]} {labels[g]}", f"view {view}") for g, view in seen]
    return side_by_side(" and ".join(names[g] for g in members), shown, group_note(ambiguity))


def rotation_figures(tree: InterpretationTree, found: list[dict[str, Any]], pictures: list[Cutout]) -> str:
    """Groups whose rotation stays open; where two are left, the attitude after the half turn as well."""
    labels, names = tree.groups.label_strings, leaf_names(tree)
    members = [labels.index(a["group"]) for a in found]
    figures = []
    for g, a in zip(members, found, strict=True):
        before, *turned = with_half_turn(tree, g) if a["rotations_left"] == 2 else [pictures[g]]
        shown = [(before, f"{names[g]} {labels[g]}", f"view {a['view']}")]
        shown += [(after, "after the half turn", "about the mean normal") for after in turned]
        note = (
            "Both rotations go on to refinement."
            if turned
            else "All rotations about the mean normal go on to refinement."
        )
        figures.append(side_by_side(f"{names[g]}: {left_open(tree, g)}", shown, note))
    return "".join(figures)


def with_half_turn(tree: InterpretationTree, group: int) -> list[Cutout]:
    """The representative attitude as it is and after the half turn, in pictures of one size."""
    model = tree.leaf_models[group]
    views = part_views(tree.part, tree.sensor, np.stack([model.R_cam_obj, half_turned(model)]))
    return trimmed([cutout(tree, view, view.detectable) for view in views])


def half_turned(model: LeafModel) -> Float[np.ndarray, "3 3"]:
    """`R_cam_obj` after a half turn about the mean normal of the target region."""
    n = np.asarray(model.mean_normal, float)
    n = n / np.linalg.norm(n)
    return (2.0 * np.outer(n, n) - np.eye(3)) @ model.R_cam_obj


def side_by_side(title: str, shown: list[tuple[Cutout, str, str]], note: str) -> str:
    pictures = "".join(
        f"<div>{image(picture, name)}<small>{text(name)}<br>{text(under)}</small></div>"
        for picture, name, under in shown
    )
    return (
        f'<figure><figcaption><b>{text(title)}</b></figcaption><div class="pair">{pictures}</div>'
        f"<figcaption><p>{text(note)}</p></figcaption></figure>"
    )
