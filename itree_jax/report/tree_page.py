"""The page of one interpretation tree: `itree show --html` (one file, no network)."""

from pathlib import Path

import numpy as np

from itree_jax.report.ambiguity_figures import ambiguity_section
from itree_jax.report.attitude_pictures import Cutout, attitude_cutouts, face_cutouts
from itree_jax.report.leaf_cards import LEAF_KEY, characteristic_legend, leaf_cards
from itree_jax.report.markup import count_of, figure, image, number, percent, swatches, text, tiles, write_page
from itree_jax.report.node_figures import node_cards
from itree_jax.report.palette import GREY, css, cycle
from itree_jax.report.svg_tree import EDGE_KEY, TREE_KEY, svg_tree
from itree_jax.report.tree_tables import (
    branch_table,
    determination_table,
    face_table,
    group_table,
    pair_table,
    sensor_table,
)
from itree_jax.tree.drawing import interpretation_drawing
from itree_jax.tree.tree import InterpretationTree


def write_tree_page(path: Path, tree: InterpretationTree) -> None:
    """Writes one self-contained HTML page about a compiled tree.

    Raises ItreeError when the page cannot be written.
    """
    write_page(Path(path), f"Interpretation tree of {tree.part.name}", tree_body(tree))


def tree_body(tree: InterpretationTree) -> str:
    """The page's content."""
    pictures = attitude_cutouts(tree)
    whole, cut = (percent(e) for e in tree.confusion.expected_error)
    return f"""<header><p class="eyebrow">itree-jax · interpretation tree (Ikeuchi 1987)</p>
<h1>{text(tree.part.name)}</h1>
{tiles(key_figures(tree))}</header>
<section><h2>The interpretation tree</h2>
<p class="muted">{TREE_KEY}</p>
<div class="scroll card">{svg_tree(tree)}</div></section>
<section><h2>Identifying faces</h2>
<p class="muted">Each is a digit of the shape label: 1 where the sensor detects the face.</p>
<div class="attitudes faces">{face_figures(tree)}</div>
{face_table(tree)}</section>
<section><h2>Branches and attitude groups</h2>
<p class="muted">Views of one shape label form an attitude group; branches divide them by the faces that are
detectable. {EDGE_KEY} Dashed: pruned. At borders: views whose label differs from the group's in a digit that is
uncertain. Lost: expected share of the group's whole and cut regions that end in another leaf.</p>
<div class="scroll card">{svg_tree(tree, figure="branches")}</div>
{group_table(tree)}
{pruned_figures(tree, pictures)}</section>
<section><h2>Leaves and their work models</h2>
<p class="muted">{LEAF_KEY} In the pictures of attitudes, in colour and numbered what is detectable (all lights reach
it, slant under the limit); grey what is seen but not detectable.</p>
{swatches(face_legend(tree))}
{characteristic_legend()}
{leaf_cards(tree, pictures)}</section>
<section><h2>What the nodes compare</h2>
<p class="muted">What noisy draws of the groups on each side of a node gave, a panel for each quantity; the line is the
median. Quantities named “log” are natural logarithms of lengths in mm, all others have no unit; an agreement is how
well a region fits the work models of a group, 1 at best. Expected for the whole tree: {whole} of whole regions and
{cut} of cut ones end in another leaf than their own.</p>
{node_cards(tree)}</section>
<section><h2>Errors of the classification rules</h2>
<p class="muted">Share of noisy draws that each rule sends to the wrong side of a branch, groups weighted by their
views: above of whole regions, below of cut ones. Bold: the rule chosen (policy {text(tree.policy)}), with the 95 %
interval of the error that the policy went by.</p>
{branch_table(tree)}
<h3>Two leaves at a time</h3>
<p class="muted">Error of the best rule between two leaves alone.</p>
{pair_table(tree)}</section>
<section><h2>Errors of the attitude determination rules</h2>
<p class="muted">Share of noisy draws whose attitude a rule leaves more than 20° from the truth, with 95 % intervals; in
bold the rules that are used.</p>
{determination_table(tree)}</section>
<section><h2>Ambiguities</h2>
{ambiguity_section(tree, pictures)}</section>
<section><h2>Sensor</h2>
{sensor_table(tree.sensor)}</section>
<footer>Compiled with seed {tree.seed}; {len(tree.appearances.attitude)} regions of
{len(tree.appearances.R_cam_obj)} attitudes ({tree.rolls} rotations per viewer direction,
{number(float(np.degrees(tree.spacing)))}° apart) are kept for recognition.</footer>"""


def key_figures(tree: InterpretationTree) -> list[tuple[str, str]]:
    groups = tree.groups
    pruned = int(groups.pruned.sum())
    joined = len(interpretation_drawing(tree).nodes)
    return [
        (str(groups.group_count), f"attitude groups, {pruned} pruned" if pruned else "attitude groups"),
        (str(len(tree.nodes.branch)), f"branches, {count_of(joined, 'node')} that decide"),
        (percent(tree.confusion.expected_error[0]), "expected error, whole regions"),
        (percent(tree.confusion.expected_error[1]), "expected error, cut regions"),
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


def pruned_figures(tree: InterpretationTree, pictures: list[Cutout]) -> str:
    """The pruned groups from their views of the largest section, with the reason."""
    groups = tree.groups
    found = "".join(
        figure(
            image(pictures[g], f"group {groups.label_strings[g]}"), groups.label_strings[g],
            f"pruned: {text(groups.pruned_reason[g])}", css_class="pruned",
        )
        for g in np.flatnonzero(groups.pruned)
    )  # fmt: skip
    return f'<div class="attitudes">{found}</div>' if found else ""
