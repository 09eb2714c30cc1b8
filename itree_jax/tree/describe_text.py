"""What is in a tree, as tables for the terminal, and the tree as figure 4 of the paper draws it (`itree show`)."""

from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text
from rich.tree import Tree

from itree_jax.tree.chain import determination_chain, left_open
from itree_jax.tree.confusion import AMBIGUOUS
from itree_jax.tree.describe import describe
from itree_jax.tree.drawing import Drawing, interpretation_drawing, leaf_names, node_error, node_name
from itree_jax.tree.tree import PRUNED, InterpretationTree


def as_text(tree: InterpretationTree) -> Group:
    """Something that a rich console prints: heading, groups, rules with their errors, the tree, what it can't tell."""
    facts = describe(tree)
    blocks: list[RenderableType] = [heading(facts), group_table(facts), face_line(facts)]
    if facts["nodes"]:
        blocks += [node_table(facts), expected_line(facts)]
    blocks += [leaf_table(facts, tree), drawn_tree(tree), ambiguity_list(facts)]
    return Group(*(item for block in blocks for item in (block, Text(""))))


def heading(facts: dict[str, Any]) -> Text:
    part, sensor, symmetries = facts["part"], facts["sensor"], facts["symmetries"]
    turns, axes = len(symmetries["discrete"]) - 1, len(symmetries["continuous"])
    symmetric = ", ".join(
        text for count, text in ((axes, f"{axes} axis of revolution"), (turns, f"{turns} symmetric turns")) if count
    )
    of_depth = f"depth camera with {sensor['depth_noise_mm']} mm of noise"
    lights = f"{len(sensor['lights'])} lights" if len(sensor["lights"]) else of_depth
    lines = [
        f"{part['name']} (object {facts['obj_id']}): {part['diameter_mm']:.1f} mm across, {part['faces']} faces, "
        f"{part['triangles']} triangles, {'watertight' if part['watertight'] else 'NOT watertight'}, "
        f"{symmetric or 'no symmetry'}",
        f"{sensor['camera']} camera, {lights}, "
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
    return Text(f"Expected of the whole tree: {whole} % of whole regions, {cut} % of cut ones end in another leaf.")


def by_kind(errors: dict[str, float | None]) -> str:
    return "-" if errors["whole"] is None else f"{percent(errors['whole'])}/{percent(errors['cut'])}"


def leaf_table(facts: dict[str, Any], tree: InterpretationTree) -> Table:
    rules = list(facts["leaves"][0]["rule_errors"]) if facts["leaves"] else []
    heads = ["leaf", "group", "steps", "left", *(f"{rule} %" for rule in rules)]
    table = Table(*heads, title="Attitude determination", title_justify="left")
    leaf = {entry["group"]: entry for entry in facts["leaves"]}
    for g, name in leaf_names(tree).items():
        label = tree.groups.label_strings[g]
        others = [percent(leaf[label]["rule_errors"][rule]) for rule in rules]
        table.add_row(name, label, " ".join(tree.determination.steps[g]) or "-", left_open(tree, g), *others)
    return table


def drawn_tree(tree: InterpretationTree) -> Tree:
    """Figure 4: the nodes that decide, with rule and errors on whole / on cut regions; the leaves with the chain of
    determination rules and the freedom that each takes."""
    drawing = interpretation_drawing(tree)
    root = Tree("Interpretation tree (errors of whole / of cut regions)")
    if drawing.nodes:
        _draw(root, tree, drawing, 0, "")
    else:
        for g in drawing.leaves:
            root.add(Text(_leaf(tree, g)))
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
        bound = f"{percent(AMBIGUOUS)} % of draws"
        return Text(f"No ambiguities: no two groups are confused in over {bound}, no rotation stays open.")
    return Text("Ambiguities\n" + "\n".join(lines))


def percent(share: float | None) -> str:
    return "-" if share is None else f"{100.0 * share:.1f}"


def _draw(at: Tree, tree: InterpretationTree, drawing: Drawing, node: int, asked: str) -> None:
    """Adds a node and what hangs on its sides."""
    drawn = drawing.nodes[node]
    whole, cut = (percent(error) for error in node_error(tree, drawn))
    rule = tree.nodes.rule[drawn.branches[0]]
    branch = at.add(Text(f"{asked}{node_name(tree, drawn)}: {rule}, errs in {whole} / {cut} %"))
    for side in drawn.sides:
        answer = ", ".join(f"{'any' if visible else 'none'} of {_digits(tree, k)}" for k, visible in side.answers)
        if side.below is not None:
            _draw(branch, tree, drawing, side.below, f"{answer} → ")
        else:
            for g in side.groups:
                branch.add(Text(f"{answer} → {_leaf(tree, g)}"))


def _leaf(tree: InterpretationTree, group: int) -> str:
    chain = "".join(f"{rule} ({taken}), " for rule, taken in determination_chain(tree, group))
    return f"{leaf_names(tree)[group]} {tree.groups.label_strings[group]}: {chain}{left_open(tree, group)}"


def _digits(tree: InterpretationTree, branch: int) -> str:
    """The faces that a branch asks for: f1 is the first digit of the label, as in the paper."""
    return " ".join(f"f{digit + 1}" for digit in tree.nodes.tested[branch].nonzero()[0])


def _face_names(facts: dict[str, Any], node: dict[str, Any]) -> str:
    """The tested faces by their digits: f1 is the first digit of the label, as in the paper."""
    return " ".join(f"f{facts['faces'][face]['digit'] + 1}" for face in node["tested_faces"])
