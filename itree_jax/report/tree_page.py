"""The page of one interpretation tree: `itree show --html` (one file, no network)."""

from pathlib import Path

import numpy as np

from itree_jax.report.ambiguities import ambiguity_notes
from itree_jax.report.attitude_pictures import attitude_cutouts, face_cutouts
from itree_jax.report.markup import figure, image, number, swatches, text, tiles, write_page
from itree_jax.report.palette import GREY, css, cycle
from itree_jax.report.svg_tree import TREE_KEY, svg_tree
from itree_jax.report.tree_tables import (
    branch_table,
    determination_table,
    face_table,
    group_caption,
    group_table,
    sensor_table,
)
from itree_jax.tree.tree import InterpretationTree


def write_tree_page(path: Path, tree: InterpretationTree) -> None:
    """Writes one self-contained HTML page about a compiled tree.

    Raises ItreeError when the page cannot be written.
    """
    write_page(Path(path), f"Interpretation tree of {tree.part.name}", tree_body(tree))


def tree_body(tree: InterpretationTree) -> str:
    """The page's content."""
    return f"""<header><p class="eyebrow">itree-jax · interpretation tree (Ikeuchi 1987)</p>
<h1>{text(tree.part.name)}</h1>
{tiles(key_figures(tree))}</header>
<section><h2>The tree</h2>
<p class="muted">{TREE_KEY}</p>
<div class="scroll card">{svg_tree(tree)}</div></section>
<section><h2>Identifying faces</h2>
<p class="muted">Each is a digit of the shape label: 1 where the sensor detects the face.</p>
<div class="attitudes faces">{face_figures(tree)}</div>
{face_table(tree)}</section>
<section><h2>Attitude groups</h2>
<p class="muted">Views of one shape label form a group. Each picture is the group's representative attitude: in colour
and numbered what is detectable (all lights reach it, slant under the limit); grey what is seen but not detectable.</p>
{swatches(face_legend(tree))}
<div class="attitudes">{group_figures(tree)}</div>
{group_table(tree)}</section>
<section><h2>Classification rules</h2>
<p class="muted">Share of noisy draws that each rule sends to the wrong side of a branch, groups weighted by their
views. Bold: the rule chosen (policy {text(tree.policy)}), with the 95 % interval of its error.</p>
{branch_table(tree)}</section>
<section><h2>Attitude determination rules</h2>
<p class="muted">Share of noisy draws whose attitude a rule leaves more than 20° from the truth, with 95 % intervals; in
bold the rules that are used.</p>
{determination_table(tree)}</section>
<section><h2>Ambiguities</h2>
{ambiguity_list(tree)}</section>
<section><h2>Sensor</h2>
{sensor_table(tree.sensor)}</section>
<footer>Compiled with seed {tree.seed}; {len(tree.appearances.attitude)} regions of
{len(tree.appearances.R_cam_obj)} attitudes ({tree.rolls} rotations per viewer direction,
{number(float(np.degrees(tree.spacing)))}° apart) are kept for recognition.</footer>"""


def key_figures(tree: InterpretationTree) -> list[tuple[str, str]]:
    groups = tree.groups
    pruned = int(groups.pruned.sum())
    return [
        (str(groups.group_count), f"attitude groups, {pruned} pruned" if pruned else "attitude groups"),
        (str(len(tree.nodes.branch)), "branches"),
        (str(len(groups.group_of_view)), f"views (dome of frequency {groups.frequency})"),
        (str(tree.part.face_count), "component faces"),
        (f"{number(tree.part.diameter)} mm", "diameter of the part"),
        (str(tree.obj_id), "object id"),
    ]


def face_legend(tree: InterpretationTree) -> list[tuple[str, str]]:
    digits = range(len(tree.groups.identifying_faces))
    return [*((css(cycle(k)), f"face {k + 1}") for k in digits), (css(GREY), "other faces")]


def face_figures(tree: InterpretationTree) -> str:
    alt = "the part with its identifying faces numbered"
    return "".join(figure(image(p, alt), f"From dome view {k}") for k, p in zip(*face_cutouts(tree), strict=True))


def group_figures(tree: InterpretationTree) -> str:
    labels = tree.groups.label_strings
    return "".join(
        figure(
            image(picture, f"representative attitude of group {labels[g]}"), labels[g], group_caption(tree, g),
            css_class="pruned" if tree.groups.pruned[g] else "",
        )
        for g, picture in enumerate(attitude_cutouts(tree))
    )  # fmt: skip


def ambiguity_list(tree: InterpretationTree) -> str:
    notes = ambiguity_notes(tree)
    if not notes:
        return "<p>None: the rules tell all groups and rotations apart.</p>"
    return "<ul>" + "".join(f"<li>{text(note)}</li>" for note in notes) + "</ul>"
