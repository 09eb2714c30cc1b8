"""What the tree cannot tell apart, drawn: both views of two groups that no rule separates, and the attitudes between
which a rotation stays open."""

from typing import Any

import numpy as np
from jaxtyping import Float

from itree_jax.report.ambiguities import ambiguity_notes, group_note
from itree_jax.report.attitude_pictures import Cutout, cutout, part_views, trimmed
from itree_jax.report.markup import image, text
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
    two = [g for g, a in zip(members, found, strict=True) if a["rotations_left"] == 2]
    R_turned = np.array([half_turned(tree.leaf_models[g]) for g in two]).reshape(-1, 3, 3)
    views = part_views(tree.part, tree.sensor, R_turned)
    turned = dict(zip(two, trimmed([cutout(tree, v, v.detectable) for v in views]), strict=True))
    figures = []
    for g, a in zip(members, found, strict=True):
        shown = [(pictures[g], f"{names[g]} {labels[g]}", f"view {a['view']}")]
        note = "The rotation about the mean normal is open: refinement decides."
        if g in turned:
            shown.append((turned[g], "after the half turn", "about the region's mean normal"))
            note = "Both rotations go on to refinement."
        figures.append(side_by_side(f"{names[g]}: {a['remaining_freedom']}", shown, note))
    return "".join(figures)


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
