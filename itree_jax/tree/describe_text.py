"""What is in a tree, as tables for the terminal (`itree show`)."""

from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text
from rich.tree import Tree

from itree_jax.tree.confusion import AMBIGUOUS
from itree_jax.tree.describe import describe
from itree_jax.tree.tree import PRUNED, InterpretationTree


def as_text(tree: InterpretationTree) -> Group:
    """Something that a rich console prints: heading, groups, rules with their errors, the tree, what it can't tell."""
    facts = describe(tree)
    blocks: list[RenderableType] = [heading(facts), group_table(facts), face_line(facts)]
    if facts["nodes"]:
        blocks += [node_table(facts), expected_line(facts)]
    blocks += [leaf_table(facts), drawn_tree(facts), ambiguity_list(facts)]
    return Group(*(item for block in blocks for item in (block, Text(""))))


def heading(facts: dict[str, Any]) -> Text:
    part, sensor, symmetries = facts["part"], facts["sensor"], facts["symmetries"]
    turns, axes = len(symmetries["discrete"]) - 1, len(symmetries["continuous"])
    symmetric = ", ".join(
        text for count, text in ((axes, f"{axes} axis of revolution"), (turns, f"{turns} symmetric turns")) if count
    )
    lines = [
        f"{part['name']} (object {facts['obj_id']}): {part['diameter_mm']:.1f} mm across, {part['faces']} faces, "
        f"{part['triangles']} triangles, {'watertight' if part['watertight'] else 'NOT watertight'}, "
        f"{symmetric or 'no symmetry'}",
        f"{sensor['camera']} camera, {len(sensor['lights'])} lights, "
        f"slant under {sensor['slant_limit_deg']:.1f} degrees, regions over {sensor['smallest_region_mm2']:.0f} mm^2",
        f"{facts['dome']['views']} views, {facts['appearances']['attitudes']} attitudes, policy {facts['policy']}, "
        f"seed {facts['seed']}",
    ]
    return Text("\n".join(lines))


def group_table(facts: dict[str, Any]) -> Table:
    table = Table("label", "views", "seen in view", "regions", "", title="Attitude groups", title_justify="left")
    for g in facts["groups"]:
        note = f"pruned: {g['pruned_reason']}" if g["pruned"] else ""
        table.add_row(g["label"], str(g["view_count"]), str(g["representative_view"]), str(g["regions"]), note)
    return table


def face_line(facts: dict[str, Any]) -> Text:
    named = [facts["faces"][k] for k in facts["identifying_faces"]]
    words = [f"f{face['digit'] + 1} {face['type']} {face['area_mm2']:.0f} mm^2" for face in named]
    return Text("Digits of the label: " + ", ".join(words))


def node_table(facts: dict[str, Any]) -> Table:
    rules = list(facts["nodes"][0]["rule_errors"])
    heads = ["branch", "any detectable?", "rule", "error % (95 %)", *rules]
    title = "Rules, with errors in % measured under noise on whole / on cut regions"
    table = Table(*heads, title=title, title_justify="left")
    for n in facts["nodes"]:
        low, high = n["error_interval"]
        error = "-" if n["rule"] == PRUNED else f"{percent(n['error_rate'])} ({percent(low)}-{percent(high)})"
        others = [by_kind(n["rule_errors"][rule]) for rule in rules]
        top = facts["nodes"][n["joined_to"]]
        branch = n["branch"] if top is n else f"{n['branch']} (joined to {top['branch']})"
        table.add_row(branch, _face_names(facts, n), n["rule"], error, *others)
    return table


def expected_line(facts: dict[str, Any]) -> Text:
    whole, cut = (percent(facts["expected_error"][kind]) for kind in ("whole", "cut"))
    return Text(f"Expected error of the whole tree: {whole} % of whole regions, {cut} % of cut ones end in another leaf.")


def by_kind(errors: dict[str, float | None]) -> str:
    return "-" if errors["whole"] is None else f"{percent(errors['whole'])}/{percent(errors['cut'])}"


def leaf_table(facts: dict[str, Any]) -> Table:
    rules = list(facts["leaves"][0]["rule_errors"]) if facts["leaves"] else []
    heads = ["group", "steps", "rotation", *(f"{rule} %" for rule in rules)]
    table = Table(*heads, title="Attitude determination", title_justify="left")
    for leaf in facts["leaves"]:
        others = [percent(leaf["rule_errors"][rule]) for rule in rules]
        table.add_row(leaf["group"], _steps(leaf), leaf["remaining_freedom"], *others)
    return table


def drawn_tree(facts: dict[str, Any]) -> Tree:
    """Branches from the root to the groups; a set of pruned groups alone is one line."""
    root = Tree("Interpretation tree")
    _draw(root, facts, None, None)
    return root


def ambiguity_list(facts: dict[str, Any]) -> Text:
    lines = []
    for a in facts["ambiguities"]:
        if a["kind"] == "groups":
            g, h = a["groups"]
            error = f"the best rule, {a['rule']}, errs in {percent(a['error_rate'])} %"
            lines.append(f"  {g} and {h}: {error} (views {a['views'][0]} and {a['views'][1]})")
        else:
            lines.append(f"  {a['group']}: {a['remaining_freedom']} (view {a['view']}); refinement decides")
    if not lines:
        return Text(f"No ambiguities: no two groups are confused in over {percent(AMBIGUOUS)} % of draws, no rotation stays open.")
    return Text("Ambiguities\n" + "\n".join(lines))


def percent(share: float | None) -> str:
    return "-" if share is None else f"{100.0 * share:.1f}"


def _draw(at: Tree, facts: dict[str, Any], parent: int | None, side: str | None) -> None:
    """Adds what hangs on one side of a node (or the root) to the drawing."""
    below = [n for n in facts["nodes"] if (n["parent"], n["side"]) == (parent, side)]
    if below:
        node = below[0]
        error = "" if node["rule"] == PRUNED else f", errs in {percent(node['error_rate'])} %"
        branch = at.add(f"{node['branch']}: any of {_face_names(facts, node)}? {node['rule']}{error}")
        for answer, name in (("yes", "visible"), ("no", "hidden")):
            _draw(branch.add(answer), facts, node["id"], name)
        return
    members = [g["label"] for g in facts["groups"]] if parent is None else facts["nodes"][parent][side]
    leaf = {entry["group"]: entry for entry in facts["leaves"]}
    for label in members:
        known = f"{_steps(leaf[label])}, {leaf[label]['remaining_freedom']}" if label in leaf else "pruned"
        at.add(f"{label}: {known}")


def _steps(leaf: dict[str, Any]) -> str:
    return " ".join(step["rule"] for step in leaf["steps"]) or "-"


def _face_names(facts: dict[str, Any], node: dict[str, Any]) -> str:
    """The tested faces by their digits: f1 is the first digit of the label, as in the paper."""
    return " ".join(f"f{facts['faces'][face]['digit'] + 1}" for face in node["tested_faces"])
