"""A card for each leaf: its representative attitude, the work models that are kept of it, and how a region's attitude
is determined there (Ikeuchi 1987, sec. 2.1.3 and 2.2)."""

import numpy as np

from itree_jax.features.characteristics import CHARACTERISTICS
from itree_jax.report.attitude_pictures import Cutout
from itree_jax.report.gauss_sphere import gauss_sphere
from itree_jax.report.markup import NOT_KNOWN, count_of, image, number, percent, swatches, table, text
from itree_jax.report.palette import css
from itree_jax.report.rule_titles import rule_title
from itree_jax.report.work_model_figures import COLOURS, SHORT, shape_figure, surface_figure
from itree_jax.tree.chain import determination_chain, left_open
from itree_jax.tree.drawing import leaf_names
from itree_jax.tree.tree import InterpretationTree

LEAF_KEY = (
    "Pictures: the attitude; then of its largest region, in the face frame (x, to the right, along the maximum inertia "
    "direction; shape recovered by T), the outline d(θ) with, dashed, the rectangle of the same moments and an arrow "
    "toward each brother region, with the distance; prominent edges as lines, and the rectangles in which a surface "
    "characteristic lies; the extended Gaussian image on the half sphere toward the viewer, its mass centre as a ring."
)


def characteristic_legend() -> str:
    entries = zip(COLOURS, SHORT, CHARACTERISTICS, strict=True)
    return swatches([(css(colour), f"{short} {name}") for colour, short, name in entries])


def leaf_cards(tree: InterpretationTree, pictures: list[Cutout]) -> str:
    """The leaves of figure 4 in their order; `pictures` are those of all groups."""
    return "\n".join(leaf_card(tree, g, name, pictures[g]) for g, name in leaf_names(tree).items())


def leaf_card(tree: InterpretationTree, g: int, name: str, picture: Cutout) -> str:
    """Attitude, face frame, Gaussian sphere; numbers and determination steps below."""
    label, model = tree.groups.label_strings[g], tree.leaf_models[g]
    views = count_of(int(tree.groups.view_count[g]), "view")
    regions = count_of(int(tree.groups.representative_regions[g]), "region")
    drawn = [
        (image(picture, f"representative attitude of group {label}"), "representative attitude"),
        (shape_figure(model), "face shape, inertia, brothers"),
        (surface_figure(model), "edges, surface characteristics"),
        (gauss_sphere(model), "extended Gaussian image"),
    ]
    pictures = "".join(f"<div>{content}<small>{text(title)}</small></div>" for content, title in drawn)
    return (
        f'<article class="card leaf" id="leaf-{name}"><h3>{name} · <code>{text(label)}</code> '
        f'<span>{views}, {regions}</span></h3><div class="models">{pictures}</div>'
        f"{numbers(tree, g)}{determination(tree, g)}</article>"
    )


def numbers(tree: InterpretationTree, g: int) -> str:
    """The work models that are numbers."""
    model = tree.leaf_models[g]
    I_max, I_min, _, uniqueness = (float(v) for v in model.inertia)
    shares = [f"{name} {percent(s, 0)}" for name, s in zip(CHARACTERISTICS, model.shares, strict=True) if s > 0.005]
    entries = [
        ("surface of the region", f"{number(model.area, 0)} mm²"),
        ("inertia", f"{number(I_max, 0)} and {number(I_min, 0)} mm⁴, uniqueness {number(uniqueness, 2)}"),
        ("surface", ", ".join(shares) or NOT_KNOWN),
        ("EGI mass centre", f"{number(np.linalg.norm(model.mass_centre), 2)} from the sphere's centre"),
        ("prominent edges", str(len(model.edges))),
        ("brother regions", str(int((model.brothers[:, 5] > 0).sum()))),
    ]
    cells = "".join(f"<div><dt>{text(key)}</dt><dd>{text(value)}</dd></div>" for key, value in entries)
    return f"<dl>{cells}</dl>"


def determination(tree: InterpretationTree, g: int) -> str:
    """The determination steps with their errors and the freedom that each takes, and what is left open."""
    d = tree.determination
    rows = []
    for rule, taken in determination_chain(tree, g):
        column = d.rules.index(rule)
        low, high = (percent(v) for v in d.error_interval[g, column])
        title = f"<b>{text(rule)}</b> {text(rule_title(rule))}"
        rows.append([title, text(taken), percent(d.error[g, column]), f"{low} to {high}"])
    left = left_open(tree, g)
    said = "the attitude is unique" if left == "unique" else f"{left}: all candidates go on to refinement"
    if not rows:
        return f'<p class="freedom">No determination rule errs seldom enough; <b>{text(said)}</b>.</p>'
    head = ["attitude determination", "freedom", "error", "95 % interval"]
    return table(head, rows, numeric=(2, 3), css_class="step") + f'<p class="freedom">Then <b>{text(said)}</b>.</p>'
