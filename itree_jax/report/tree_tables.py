"""The tables of a tree's page: faces, groups, branches, determination rules, sensor."""

import numpy as np

from itree_jax.report.markup import EN_DASH, NOT_KNOWN, count_of, number, percent, table, text
from itree_jax.report.palette import css, cycle
from itree_jax.report.rule_titles import rule_title
from itree_jax.sensor import Sensor
from itree_jax.tree.classification_rules import RULE_NAMES
from itree_jax.tree.tree import PRUNED, InterpretationTree

LEFT_OPEN = {0: "open: all go on", 1: "unique"}


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


def group_caption(tree: InterpretationTree, g: int) -> str:
    """Views, regions and determination steps of a group, as HTML."""
    groups = tree.groups
    views = count_of(int(groups.view_count[g]), "view")
    regions = count_of(int(groups.representative_regions[g]), "region")
    return f"{views}, {regions}<br>{determination_words(tree, g)}"


def determination_words(tree: InterpretationTree, g: int) -> str:
    """How the attitude is found, as HTML."""
    if tree.groups.pruned[g]:
        return f"pruned: {text(tree.groups.pruned_reason[g])}"
    left = int(tree.determination.rotations_left[g])
    steps = " → ".join(text(rule) for rule in tree.determination.steps[g])
    result = {0: "rotation open", 1: "unique"}.get(left, f"{left} rotations left")
    return f"{steps} → {result}" if steps else result


def group_table(tree: InterpretationTree) -> str:
    """One row for each attitude group."""
    groups = tree.groups
    rows = [
        [
            f"<code>{text(groups.label_strings[g])}</code>", str(int(groups.view_count[g])),
            str(int(groups.representative_view[g])), number(float(np.degrees(groups.representative_roll[g])), 0),
            str(int(groups.representative_regions[g])), determination_words(tree, g),
        ]
        for g in range(groups.group_count)
    ]  # fmt: skip
    head = ["label", "views", "representative view", "rotation [°]", "regions", "attitude determination"]
    return table(head, rows, numeric=(1, 2, 3, 4))


def branch_table(tree: InterpretationTree) -> str:
    """Measured error of every rule at every branch, the chosen one in bold."""
    nodes = tree.nodes
    rows = []
    for k, branch in enumerate(nodes.branch):
        cells = [
            f"<b>{percent(float(e))}</b>" if name == nodes.rule[k] else percent(float(e))
            for name, e in zip(RULE_NAMES, nodes.rule_errors[k], strict=True)
        ]
        faces = ", ".join(str(d + 1) for d in np.flatnonzero(nodes.tested[k]))
        pruned = nodes.rule[k] == PRUNED
        rows.append([
            text(branch), f"any of {faces}" if "," in faces else faces, side_cell(tree, nodes.visible[k]),
            side_cell(tree, nodes.hidden[k]), text(nodes.rule[k]), *cells,
            NOT_KNOWN if pruned else interval(nodes.error_interval[k]), str(int(nodes.draws[k])),
        ])  # fmt: skip
    rules = [f"{name}<br><small>{text(rule_title(name))}</small>" for name in RULE_NAMES]
    head = ["branch", "faces asked", "detectable", "not detectable", "rule", *rules, "95 % interval", "draws"]
    first = 5
    return table(head, rows, numeric=range(first, first + len(rules) + 2))


def side_cell(tree: InterpretationTree, members: np.ndarray) -> str:
    labels = [text(tree.groups.label_strings[g]) for g in np.flatnonzero(members)]
    if len(labels) > 4:
        return f'<span title="{", ".join(labels)}">{len(labels)} groups</span>'
    return "<br>".join(f"<code>{label}</code>" for label in labels)


def interval(low_high: np.ndarray) -> str:
    low, high = (100.0 * float(v) for v in low_high)
    return f"{number(low)}{EN_DASH}{number(high)} %"


def determination_table(tree: InterpretationTree) -> str:
    """Measured error of every determination rule for every group."""
    determination, groups = tree.determination, tree.groups
    rows = []
    for g in np.flatnonzero(~groups.pruned):
        cells = [rule_cell(tree, int(g), k) for k in range(len(determination.rules))]
        left = int(determination.rotations_left[g])
        rows.append([
            f"<code>{text(groups.label_strings[g])}</code>", *cells, LEFT_OPEN.get(left, f"{left} left"),
            str(int(determination.draws[g])),
        ])  # fmt: skip
    rules = [f"{text(name)}<br><small>{text(rule_title(name))}</small>" for name in determination.rules]
    head = ["group", *rules, "rotations", "draws"]
    return table(head, rows, numeric=(*range(1, 1 + len(rules)), len(head) - 1))


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
    rows = [
        ["camera", f"{text(camera.kind)}, {size}"],
        ["working distance", f"{number(sensor.working_distance, 0)} mm"],
        ["lights", lights],
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
