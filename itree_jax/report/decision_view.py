"""A decision path as a person reads it: every step with rule, measured, compared with, margin, and what it settled."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from itree_jax.detections import Step
from itree_jax.report.distribution_strip import distribution_strip
from itree_jax.report.markup import NOT_KNOWN, number, percent, table, text
from itree_jax.report.rule_titles import rule_title
from itree_jax.tree.node_quantities import node_quantities, side_samples
from itree_jax.tree.tree import InterpretationTree

SIDES = ("visible", "hidden")
MOST_LABELS = 6  # of groups named on one side
KINDS = (("whole", "error_whole"), ("cut", "error_cut"))  # regions that errors are measured on
SHARES = ("error_left_out",)
TOLD = ("branch", "error_rate", "error_whole", "error_cut", "joined_with")  # in the heading and its chips
WORDS = {
    "open": "left open", "alternatives": "no rule tells it from", "rivals": "evidence of rivals", "left": "parts left",
    "error_left_out": "regions whose part is not left",
}  # fmt: skip


def decision_path_view(tree: InterpretationTree, steps: Sequence[Step]) -> str:
    """An ordered list of the steps as HTML."""
    if not steps:
        return '<p class="muted">This answer carries no decision path.</p>'
    return '<ol class="steps">' + "\n".join(f"<li>{step_view(tree, step)}</li>" for step in steps) + "</ol>"


def step_view(tree: InterpretationTree, step: Step) -> str:
    """One step: what was asked, what was measured, what came of it."""
    compared = step.compared_with
    two_sided = isinstance(compared, dict) and all(isinstance(compared.get(side), dict) for side in SIDES)
    body = two_sided_comparison(tree, step) if two_sided else plain_comparison(step)
    freedom = ""
    if step.freedom_before != step.freedom_after:
        freedom = f'<p class="freedom">{text(step.freedom_before)} <b>→</b> {text(step.freedom_after)}</p>'
    return f"<h4>{heading(step)} {chips(step)}</h4>{freedom}{body}"


def heading(step: Step) -> str:
    compared = step.compared_with
    branch = f"{text(compared['branch'])} · " if isinstance(compared, dict) and "branch" in compared else ""
    title = rule_title(step.rule)
    return f"{branch}{text(step.rule)} <span>{text(title)}</span>"


def chips(step: Step) -> str:
    """Margin, error rates, and the branch that this one is decided with. A negative margin is a step that the rest of
    the evidence took against this rule."""
    shown = []
    if step.margin is not None:
        against = step.margin < 0
        note = "against this rule's preference: other evidence decided" if against else "log-likelihood ratio"
        mark = "▼ " if against else ""
        shown.append(
            f'<span class="chip{" warn" if against else ""}" title="{text(note)}">{mark}margin '
            f"{number(step.margin, 2)} nat</span>"
        )
    compared = step.compared_with if isinstance(step.compared_with, dict) else {}
    if compared.get("error_rate") is not None:
        kinds = [f"{kind} {percent(compared[key])}" for kind, key in KINDS if compared.get(key) is not None]
        of = f" ({', '.join(kinds)})" if kinds else ""
        shown.append(
            '<span class="chip" title="measured when the tree was compiled">errs in '
            f"{percent(compared['error_rate'])}{of}</span>"
        )
    if "joined_with" in compared:
        shown.append(
            '<span class="chip" title="consecutive branches of one rule are one node">joined with '
            f"{text(compared['joined_with'])}</span>"
        )
    return " ".join(shown)


def two_sided_comparison(tree: InterpretationTree, step: Step) -> str:
    """Measured quantities beside the means of both sides, with the distributions they come from."""
    visible, hidden = (step.compared_with[side] for side in SIDES)
    taken = step.compared_with.get("taken")
    heads = [side_head(side, side == taken) for side in SIDES]
    samples = samples_of_sides(tree, step)
    measured = step.measured if isinstance(step.measured, dict) else {"": step.measured}
    groups = " · ".join(f"{side} side {side_groups(step.compared_with[side])}" for side in SIDES)
    rows = []
    for name, value in measured.items():
        strip = distribution_strip(*samples[name], float(value), name) if name in samples and is_number(value) else ""
        rows.append([text(name), shown(value), shown(visible.get(name)), shown(hidden.get(name)), strip])
    head = ["quantity", "measured", *heads, "draws of both sides"]
    return f'<p class="groups">{groups}</p>' + table(head, rows, numeric=(1, 2, 3), css_class="step")


def samples_of_sides(tree: InterpretationTree, step: Step) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """What the draws of both sides gave, by the name of the quantity; nothing where the tree doesn't know the step."""
    nodes = tree.nodes
    if not 0 <= step.node < len(nodes.branch) or step.rule != nodes.rule[step.node]:
        return {}
    visible, hidden = (side_samples(tree, step.node, side[step.node]) for side in (nodes.visible, nodes.hidden))
    if not len(visible) or not len(hidden):
        return {}
    names = [q.name for q in node_quantities(tree, step.node)]
    return {name: (visible[:, k], hidden[:, k]) for k, name in enumerate(names)}


def side_head(side: str, taken: bool) -> str:
    """Head of a side's column, and whether it was taken."""
    mark = ' <span class="chip taken">taken</span>' if taken else ""
    return f'<span class="{side}-key"></span>{side} mean{mark}'


def side_groups(compared: dict[str, Any]) -> str:
    """The labels of a side's groups."""
    labels = compared.get("groups", ())
    more = f" and {len(labels) - MOST_LABELS} more" if len(labels) > MOST_LABELS else ""
    return f"<code>{', '.join(text(label) for label in labels[:MOST_LABELS])}</code>{more}"


def plain_comparison(step: Step) -> str:
    """Measured value and what it was compared with, whatever their form."""
    cells = []
    if step.measured is not None:
        cells.append(("measured", shown(step.measured)))
    if isinstance(step.compared_with, dict):
        cells += [
            (text(WORDS.get(key, key.replace("_", " "))), percent(value) if key in SHARES else shown(value))
            for key, value in step.compared_with.items()
            if key not in TOLD
        ]
    elif step.compared_with is not None:
        cells.append(("compared with", shown(step.compared_with)))
    return "<dl>" + "".join(f"<div><dt>{key}</dt><dd>{value}</dd></div>" for key, value in cells) + "</dl>"


def shown(value: Any) -> str:
    """A number, a list or a dict of plain data as HTML."""
    if value is None:
        return NOT_KNOWN
    if is_number(value):
        return number(float(value), 3)
    if isinstance(value, dict):
        return ", ".join(f"{text(key)} {shown(v)}" for key, v in value.items())
    if isinstance(value, (list, tuple, np.ndarray)):
        if not len(value):
            return "none"
        return ", ".join(shown(v) for v in value)
    return text(value)


def is_number(value: Any) -> bool:
    return isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
