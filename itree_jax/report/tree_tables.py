"""The tables of a tree's page: faces, groups, branches, determination rules, sensor."""

import numpy as np

from itree_jax.report.markup import EN_DASH, NOT_KNOWN, number, percent, table, text
from itree_jax.report.palette import css, cycle
from itree_jax.report.rule_titles import rule_title
from itree_jax.sensor import Sensor
from itree_jax.tree.chain import left_open
from itree_jax.tree.classification_rules import rules_in
from itree_jax.tree.confusion import AMBIGUOUS
from itree_jax.tree.drawing import leaf_names
from itree_jax.tree.tree import PRUNED, InterpretationTree


def face_table(tree: InterpretationTree) -> str:
    """Identifying faces with type, area, and how often each is detectable."""
    groups, part = tree.groups, tree.part
    rows = []
    for digit, face in enumerate(groups.identifying_faces):
        key = f'<i class="key" style="background:{css(cycle(digit))}"></i>{digit + 1}'
        seen = int(groups.labels[:, digit].sum())
        rows.append([
            key, str(int(face)), text(part.face_types[face]), number(float(part.face_areas[face]), 0),
            f"{seen} of {len(groups.labels)}", percent(float(groups.self_blocking[digit]), 0),
        ])  # fmt: skip
    head = ["digit", "component face", "type", "area [mm²]", "detectable in views", "light it blocks itself"]
    return table(head, rows, numeric=(1, 3, 4, 5))


def determination_words(tree: InterpretationTree, g: int) -> str:
    """How the attitude is found, as HTML."""
    if tree.groups.pruned[g]:
        return "pruned"
    steps = " → ".join(text(rule) for rule in tree.determination.steps[g])
    return f"{steps} → {left_open(tree, g)}" if steps else left_open(tree, g)


def group_table(tree: InterpretationTree) -> str:
    """One row for each attitude group."""
    groups, names = tree.groups, leaf_names(tree)
    rows = []
    for g in (*names, *np.flatnonzero(groups.pruned).tolist()):
        whole, cut = tree.confusion.group_error[g]
        borders = int((groups.membership[groups.group_of_view == g] < 1.0).sum())
        rows.append([
            names.get(g, NOT_KNOWN), f"<code>{text(groups.label_strings[g])}</code>", str(int(groups.view_count[g])),
            str(borders), str(int(groups.representative_view[g])),
            number(float(np.degrees(groups.representative_roll[g])), 0), str(int(groups.representative_regions[g])),
            percent(whole), percent(cut), determination_words(tree, g),
        ])  # fmt: skip
    head = [
        "", "label", "views", "at borders", "shown in view", "rotation [°]", "regions",
        "lost whole", "lost cut", "attitude determination",
    ]  # fmt: skip
    return table(head, rows, numeric=range(2, 9))


def branch_table(tree: InterpretationTree) -> str:
    """Measured error of every rule at every branch on whole and on cut regions, the chosen one in bold."""
    nodes = tree.nodes
    rows = []
    for k, branch in enumerate(nodes.branch):
        used = () if nodes.rule[k] == PRUNED else rules_in(nodes.rule[k])
        cells = [whole_cut(errors, r in used) for r, errors in enumerate(nodes.rule_errors[k])]
        faces = ", ".join(str(d + 1) for d in np.flatnonzero(nodes.tested[k]))
        joined = int(nodes.joined[k])
        top = f"<br><small>joined with {text(nodes.branch[joined])}</small>" if joined != k else ""
        rows.append([
            f"{text(branch)}{top}", f"any of {faces}" if "," in faces else faces, side_cell(tree, nodes.visible[k]),
            side_cell(tree, nodes.hidden[k]), f"<b>{text(nodes.rule[k])}</b>", *cells, chosen_error(tree, k),
            str(int(nodes.draws[k])),
        ])  # fmt: skip
    rules = [f"{name}<br><small>{text(rule_title(name))}</small>" for name in tree.distributions.rules]
    head = ["branch", "faces asked", "detectable", "not detectable", "rule", *rules, "error of the rule", "draws"]
    first = 5
    return table(head, rows, numeric=range(first, first + len(rules) + 2), css_class="rates")


def whole_cut(errors: np.ndarray, bold: bool) -> str:
    """Two rates in percent, one above the other."""
    if np.isnan(errors).all():
        return NOT_KNOWN
    whole, cut = (percent(float(e)) for e in errors)
    return f"{f'<b>{whole}</b>' if bold else whole}<br><small>{cut}</small>"


def chosen_error(tree: InterpretationTree, k: int) -> str:
    """The rate that the policy went by, with its interval."""
    nodes = tree.nodes
    if nodes.rule[k] == PRUNED:
        return NOT_KNOWN
    return f"<b>{percent(nodes.error[k])}</b><br><small>{interval(nodes.error_interval[k])}</small>"


def side_cell(tree: InterpretationTree, members: np.ndarray) -> str:
    labels = [text(tree.groups.label_strings[g]) for g in np.flatnonzero(members)]
    if len(labels) > 4:
        return f'<span title="{", ".join(labels)}">{len(labels)} groups</span>'
    return "<br>".join(f"<code>{label}</code>" for label in labels)


def interval(low_high: np.ndarray) -> str:
    low, high = (100.0 * float(v) for v in low_high)
    return f"{number(low)}{EN_DASH}{number(high)} %"


def pair_table(tree: InterpretationTree) -> str:
    """Of every two leaves the error of the best rule between them alone, with its name; large ones are marked."""
    confusion, names = tree.confusion, leaf_names(tree)
    leaves = list(names)
    rows = []
    for g in leaves:
        cells = []
        for h in leaves:
            error = float(confusion.pair_error[g, h])
            shown = f"{percent(error)}<br><small>{text(confusion.pair_rule[g][h])}</small>"
            marked = f'<span class="chip warn">{shown}</span>' if error > AMBIGUOUS else shown
            cells.append(NOT_KNOWN if g == h or np.isnan(error) else marked)
        rows.append([f"<b>{names[g]}</b> <code>{text(tree.groups.label_strings[g])}</code>", *cells])
    return table(["", *names.values()], rows, numeric=range(1, len(leaves) + 1))


def determination_table(tree: InterpretationTree) -> str:
    """Measured error of every determination rule for every group."""
    determination, groups, names = tree.determination, tree.groups, leaf_names(tree)
    rows = []
    for g in names:
        cells = [rule_cell(tree, g, k) for k in range(len(determination.rules))]
        rows.append([
            f"{names[g]} <code>{text(groups.label_strings[g])}</code>", *cells, left_open(tree, g),
            str(int(determination.draws[g])),
        ])  # fmt: skip
    rules = [f"{text(name)}<br><small>{text(rule_title(name))}</small>" for name in determination.rules]
    head = ["group", *rules, "left", "draws"]
    return table(head, rows, numeric=(*range(1, 1 + len(rules)), len(head) - 1), css_class="rates")


def rule_cell(tree: InterpretationTree, g: int, k: int) -> str:
    """Error and interval, bold if the rule is used."""
    determination = tree.determination
    error = float(determination.error[g, k])
    if np.isnan(error):
        return NOT_KNOWN
    shown = percent(error)
    if determination.rules[k] in determination.steps[g]:
        shown = f"<b>{shown}</b>"
    return f"{shown}<br><small>{interval(determination.error_interval[g, k])}</small>"


def sensor_table(sensor: Sensor) -> str:
    """What decides what is detectable."""
    camera, noise = sensor.camera, sensor.noise
    pairs = zip(sensor.light_directions, sensor.light_intensities, strict=True)
    lights = "<br>".join(light_words(direction, float(intensity)) for direction, intensity in pairs)
    size = f"{camera.width} by {camera.height} px, {number(sensor.mm_per_px, 3)} mm per px"
    electrons = f"full well {number(noise.full_well_e, 0)} electrons, read noise {number(noise.read_noise_e)} electrons"
    of_depth = f"none: a depth camera with {number(sensor.depth_noise or 0.0, 2)} mm of noise"
    rows = [
        ["camera", f"{text(camera.kind)}, {size}"],
        ["working distance", f"{number(sensor.working_distance, 0)} mm"],
        ["lights", of_depth if sensor.is_depth_camera else lights],
        ["slant limit", f"{number(float(np.degrees(sensor.slant_limit)))}°"],
        ["smallest region", f"{number(sensor.smallest_region, 0)} mm²"],
        ["noise", f"{electrons}, {noise.bits} bits"],
    ]
    return table(["", ""], [[f"<b>{name}</b>", value] for name, value in rows], css_class="plain")


def light_words(direction: np.ndarray, intensity: float) -> str:
    """Where a light stands: off the optical axis, and round it (0 degrees right, 90 degrees up in the image)."""
    off_axis = float(np.degrees(np.arccos(np.clip(-direction[2], -1.0, 1.0))))
    words = f"{number(off_axis, 0)}° off the optical axis"
    if off_axis > 0.5:
        azimuth = float(np.degrees(np.arctan2(-direction[1], direction[0]))) % 360.0
        words += f", from {number(azimuth, 0)}° (0° = right, 90° = up)"
    return f"{words}, relative intensity {number(intensity, 2)}"
