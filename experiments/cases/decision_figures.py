"""Figures 6c, 7d, 8f: the decision path in bold on the tree, its steps as a table, and where it leaves the paper's."""

import numpy as np

from cases.case import ATTITUDE_NAMES, attitude_name
from cases.highest_region import HIGHEST
from cases.recognised import Recognised
from cases.two_rotations import Rotation, rule_preferences
from itree_jax.detections import Step
from itree_jax.report import svg_tree
from itree_jax.report.markup import NOT_KNOWN, number, percent, table, text
from itree_jax.report.rule_titles import rule_title
from itree_jax.tree.choice import ERROR_BOUND
from itree_jax.tree.node_quantities import node_quantities, side_samples
from itree_jax.tree.tree import PRUNED

UNDECIDED = 1.0  # [nat]
FIGURE = {1: "6c", 2: "7d", 3: "8f"}


def decision_section(r: Recognised, rotations: tuple[Rotation, Rotation]) -> str:
    return (
        f"<h3>{FIGURE[r.case.number]} · The decision path</h3>"
        f'<div class="scroll card">{svg_tree(r.tree, r.group)}</div>'
        f"{step_table(r)}<h3>Beside the paper's path</h3>{against_paper(r)}{rule_table(r, rotations)}"
    )


def step_table(r: Recognised) -> str:
    """Node, rule, measured value, margin, error, freedom before -> after."""
    head = ["node", "rule", "measured", "margin [nat]", "errs in", "freedom before", "after"]
    rows = [step_row(r, step) for step in r.steps]
    note = (
        '<p class="muted">Margins are log-likelihoods by which the side taken beats the other, errors were measured '
        "when the tree was compiled. Logarithms are natural, of lengths in mm. Probabilities of the groups, all nodes "
        "together: "
        f"{probabilities(r)}.</p>"
    )
    return table(head, rows, numeric=(3, 4)) + note


def step_row(r: Recognised, step: Step) -> list[str]:
    compared = step.compared_with if isinstance(step.compared_with, dict) else {}
    node = str(compared.get("branch", "leaf"))
    if "joined_with" in compared:
        node += f" (joined with {compared['joined_with']})"
    error = compared.get("error_rate")
    return [
        text(node), f"{text(step.rule)} <small>{text(rule_title(step.rule))}</small>", measured_words(step.measured),
        number(step.margin, 2) if step.margin is not None else NOT_KNOWN,
        percent(error) if error is not None else NOT_KNOWN, text(step.freedom_before), text(step.freedom_after),
    ]  # fmt: skip


def measured_words(measured: object) -> str:
    """Quantities of a step; groups by the names of their representative attitudes."""
    if not isinstance(measured, dict):
        return NOT_KNOWN
    words = []
    for name, value in measured.items():
        short = next((s for label, s in ATTITUDE_NAMES.items() if name == f"agreement with {label}"), name)
        words.append(f"{text(short)}: {number(value, 2)}")
    return "<br>".join(words)


def probabilities(r: Recognised) -> str:
    order = np.argsort(-r.group_probability, kind="stable")
    labels = r.tree.groups.label_strings
    return ", ".join(
        f"{attitude_name(labels[g])} {percent(r.group_probability[g], 0)}" for g in order if not r.tree.groups.pruned[g]
    )


def against_paper(r: Recognised) -> str:
    """In words: which steps differ from the paper's, and the measured errors that say why."""
    tree, case = r.tree, r.case
    wanted = r.wanted
    errors = dict(zip(tree.determination.rules, tree.determination.error[wanted], strict=True))
    walked = [tree.nodes.rule[k] for k in way_to(r, wanted)]
    chain = tree.determination.steps[wanted]
    said = [
        f"Classification: the paper takes {', '.join(case.paper_nodes)}; this tree, whose B0 and B1 are one node too, "
        f"takes {', '.join(dict.fromkeys(walked))}.",
        f"Determination: the paper takes {', '.join(case.paper_chain)}; this tree takes "
        f"{', '.join(chain) or 'no rule'}.",
    ]
    missing = [rule for rule in case.paper_chain if rule not in chain]
    over = [f"{rule} leaves {percent(errors[rule])}" for rule in missing if errors[rule] >= ERROR_BOUND]
    if over:
        said.append(
            f"A rule is adopted when it leaves less than {percent(ERROR_BOUND, 0)} of the group's noisy draws (any "
            f"viewer direction within it, not the representative one alone) beyond 20° of the truth: {'; '.join(over)}."
        )
    under = [rule for rule in missing if errors[rule] < ERROR_BOUND]
    if under:
        said.append(f"Of several under the bound the first in order is taken, {', '.join(under)} is another.")
    if int(tree.determination.rotations_left[wanted]) != 1:
        said.append("What stays open goes on as candidates, which refinement and verification decide between.")
    if r.group != wanted:
        said.append(
            f"<b>Here the region was led to {attitude_name(tree.groups.label_strings[r.group])} instead of "
            f"{attitude_name(case.label)}.</b> Poses of all groups go on with what is left for them, so that the pose "
            f"can still be right. {where_it_left(r)}"
        )
    return f"<p>{' '.join(said)}</p>"


def where_it_left(r: Recognised) -> str:
    """The node at which the region left the way to its true group, and what it measured that the group's draws hardly
    do."""
    tree, nodes, wanted = r.tree, r.tree.nodes, r.wanted
    node = next(
        k for k in way_to(r, wanted)
        if nodes.visible[k, wanted] != nodes.visible[k, r.group] or nodes.hidden[k, wanted] != nodes.hidden[k, r.group]
    )
    own = np.arange(tree.groups.group_count) == wanted
    samples, odd = side_samples(tree, node, own), []
    for column, quantity in enumerate(node_quantities(tree, node)):
        measured = float(r.interpretation.classification.quantities[quantity.rule][HIGHEST, quantity.column])
        low, high = np.percentile(samples[:, column], (5.0, 95.0))
        if not low <= measured <= high:
            odd.append(
                f"{text(quantity.name)} {number(measured, 2)}, where nine tenths of the draws of {r.case.name} that "
                f"the rule learned from gave {number(low, 2)} to {number(high, 2)}"
            )
    said = "; ".join(odd) or "nothing that the group's draws would not"
    note = ""
    if "L6" in nodes.rule[node] and tree.policy == "paper":
        note = (
            " Under policy paper a rule learns from whole regions, which have no other part beside them; in a pile "
            "there are some, and L6 counts regions too many against a group."
        )
    return f"It left the way at {nodes.branch[node]} ({nodes.rule[node]}), which measured {said}.{note}"


def way_to(r: Recognised, group: int) -> list[int]:
    """Nodes from the root to a group, without pruned ones."""
    nodes = r.tree.nodes
    return [
        k for k in range(len(nodes.branch))
        if (nodes.visible[k, group] or nodes.hidden[k, group]) and nodes.rule[k] != PRUNED
    ]


def rule_table(r: Recognised, rotations: tuple[Rotation, Rotation]) -> str:
    """Every determination rule of the group reached: its error, who uses it, and what it says of this region."""
    tree, group = r.tree, r.wanted
    said = rule_preferences(r, rotations)
    rows = []
    for rule, error in zip(tree.determination.rules, tree.determination.error[group], strict=True):
        a, b = said.get(rule, (None, None))
        verdict = NOT_KNOWN if a is None or b is None else f"{'a' if a < b else 'b'} by {number(abs(a - b), 2)}"
        rows.append([
            text(rule), text(rule_title(rule)), percent(error), mark(rule in r.case.paper_chain),
            mark(rule in tree.determination.steps[group]), number(a, 2), number(b, 2), verdict,
        ])  # fmt: skip
    head = ["rule", "", "errs in", "paper", "this tree", "penalty, a [nat]", "penalty, b [nat]", "prefers"]
    note = (
        f'<p class="muted">Errors in group {attitude_name(tree.groups.label_strings[group])}. Penalties: the least of '
        "the group's appearances that lie nearer to rotation a or to b, A1, A3 and A4 included; a difference under 1 "
        f"nat decides nothing. {equal_words(said)}</p>"
    )
    return table(head, rows, numeric=(2, 5, 6, 7)) + note


def equal_words(said: dict[str, tuple[float, float]]) -> str:
    """Why the two rotations may fit alike, where they do."""
    if any(abs(a - b) >= UNDECIDED for a, b in said.values()):
        return ""
    return (
        "Here no rule tells the two apart: turned by half, the part looks nearly the same from another viewer "
        "direction of the group, and what tells its ends apart (the slot, the hole) is not in the region."
    )


def mark(yes: bool) -> str:
    return "●" if yes else ""
