"""What is in a tree, as plain data: groups, faces, nodes, leaves, ambiguities, sensor (`itree show --json`)."""

from typing import Any

import numpy as np

from itree_jax.features.characteristics import CHARACTERISTICS
from itree_jax.sensing.sensor_file import fingerprint
from itree_jax.tree.confusion import inseparable
from itree_jax.tree.determine import remaining_freedom
from itree_jax.tree.freedom import freedom_along
from itree_jax.tree.tree import ROOT, InterpretationTree

KINDS = ("whole", "cut")  # regions that errors are measured on


def describe(tree: InterpretationTree) -> dict[str, Any]:
    """Everything a reader may ask of a tree, as JSON data. Lengths in mm, angles in degrees; None where not measured.

    Faces, nodes and views are numbered from 0, faces in falling order of area. The parent of the first node is None.
    """
    part = tree.part
    return _plain({
        "part": {
            "name": part.name, "diameter_mm": part.diameter, "unit": part.unit, "triangles": len(part.triangles),
            "faces": part.face_count, "watertight": part.watertight,
        },
        "obj_id": tree.obj_id,
        "policy": tree.policy,
        "seed": tree.seed,
        "sensor": sensor_summary(tree),
        "symmetries": {
            "discrete": list(tree.symmetries.discrete),
            "continuous": [{"axis": axis, "offset_mm": point} for axis, point in tree.symmetries.continuous],
        },
        "dome": {"frequency": tree.groups.frequency, "views": len(tree.groups.directions)},
        "appearances": {
            "attitudes": len(tree.appearances.view), "regions": len(tree.appearances.attitude), "rolls": tree.rolls,
            "spacing_deg": float(np.degrees(tree.spacing)),
        },
        "identifying_faces": tree.groups.identifying_faces,
        "faces": faces(tree),
        "groups": groups(tree),
        "nodes": nodes(tree),
        "expected_error": expected(tree),
        "leaves": leaves(tree),
        "ambiguities": ambiguities(tree),
    })  # fmt: skip


def sensor_summary(tree: InterpretationTree) -> dict[str, Any]:
    """What the part was compiled for; `fingerprint` is that of the sensor's facts that decide detectability."""
    sensor = tree.sensor
    return {
        "camera": sensor.camera.kind,
        "size_px": [sensor.camera.width, sensor.camera.height],
        "mm_per_px": sensor.mm_per_px,
        "working_distance_mm": sensor.working_distance,
        "lights": sensor.light_directions,
        "depth_noise_mm": sensor.depth_noise,
        "slant_limit_deg": float(np.degrees(sensor.slant_limit)),
        "smallest_region_mm2": sensor.smallest_region,
        "fingerprint": fingerprint(sensor),
    }


def faces(tree: InterpretationTree) -> list[dict[str, Any]]:
    """Component faces; `digit` is the face's place in the shape label, None where it has none."""
    digit = {int(face): k for k, face in enumerate(tree.groups.identifying_faces)}
    return [
        {"id": k, "type": kind, "area_mm2": float(area), "digit": digit.get(k)}
        for k, (kind, area) in enumerate(zip(tree.part.face_types, tree.part.face_areas, strict=True))
    ]


def groups(tree: InterpretationTree) -> list[dict[str, Any]]:
    """Attitude groups; `regions` are those seen at the representative attitude."""
    groups = tree.groups
    return [
        {
            "label": label,
            "view_count": int(groups.view_count[g]),
            "view_indices": groups.views_of(g),
            "representative_view": int(groups.representative_view[g]),
            "representative_roll_deg": float(np.degrees(groups.representative_roll[g])),
            "regions": int(groups.representative_regions[g]),
            "pruned": bool(groups.pruned[g]),
            "pruned_reason": groups.pruned_reason[g],
        }
        for g, label in enumerate(groups.label_strings)
    ]


def nodes(tree: InterpretationTree) -> list[dict[str, Any]]:
    """Branches with their rules; `error_rate` is the one that the policy went by, 0 where there is nothing to decide.

    Branches of one rule that follow each other are joined to one many-way node (sec. 2.1.5): `joined_to` is its top.
    """
    n, rules = tree.nodes, tree.distributions.rules
    return [
        {
            "id": k,
            "parent": None if n.parent[k] == ROOT else int(n.parent[k]),
            "side": None if n.parent[k] == ROOT else _side(bool(n.on_visible_side[k])),
            "branch": n.branch[k],
            "joined_to": int(n.joined[k]),
            "joined_error": dict(zip(KINDS, n.joined_error[int(n.joined[k])], strict=True)),
            "tested_faces": tree.groups.identifying_faces[n.tested[k]],
            "rule": n.rule[k],
            "error_rate": float(n.error[k]),
            "error_interval": n.error_interval[k],
            "error_by_kind": dict(zip(KINDS, n.whole_and_cut[k], strict=True)),
            "rule_errors": {
                rule: dict(zip(KINDS, errors, strict=True))
                for rule, errors in zip(rules, n.rule_errors[k], strict=True)
            },
            "draws": int(n.draws[k]),
            "visible": _labels(tree, n.visible[k]),
            "hidden": _labels(tree, n.hidden[k]),
        }
        for k in range(len(n.branch))
    ]


def expected(tree: InterpretationTree) -> dict[str, Any]:
    """Expected error of the whole tree: the share of regions that end in another leaf than their own."""
    confusion, labels = tree.confusion, tree.groups.label_strings
    return {
        **dict(zip(KINDS, confusion.expected_error, strict=True)),
        "groups": {
            labels[g]: dict(zip(KINDS, confusion.group_error[g], strict=True))
            for g in np.flatnonzero(~tree.groups.pruned)
        },
    }


def leaves(tree: InterpretationTree) -> list[dict[str, Any]]:
    """Groups with the node they hang on, their work models and what determines the attitude there; pruned groups are no
    leaves."""
    d = tree.determination
    found = []
    for g in np.flatnonzero(~tree.groups.pruned):
        rates, intervals = (dict(zip(d.rules, values[g], strict=True)) for values in (d.error, d.error_interval))
        node = leaf_node(tree, int(g))
        freedom = freedom_along(d.steps[g])
        steps = [
            {
                "rule": r, "error_rate": rates[r], "error_interval": intervals[r], "freedom_before": str(before),
                "freedom_after": str(after),
            }
            for r, before, after in zip(d.steps[g], freedom[:-1], freedom[1:], strict=True)
        ]  # fmt: skip
        found.append({
            "group": tree.groups.label_strings[g],
            "node": node,
            "side": None if node is None else _side(bool(tree.nodes.visible[node, g])),
            "steps": steps,
            "rule_errors": rates,
            "draws": int(d.draws[g]),
            "rotations_left": int(d.rotations_left[g]),
            "remaining_freedom": remaining_freedom(int(d.rotations_left[g])),
            "work_models": work_models(tree, int(g)),
        })  # fmt: skip
    return found


def work_models(tree: InterpretationTree, group: int) -> dict[str, Any]:
    """The work models of a representative attitude; positions in the face frame of its target region [mm]."""
    model = tree.leaf_models[group]
    I_max, I_min, alpha, uniqueness = model.inertia
    return {
        "area_mm2": model.area,
        "inertia": {
            "I_max_mm4": I_max, "I_min_mm4": I_min, "alpha_deg": float(np.degrees(alpha)), "uniqueness": uniqueness,
        },
        "outline_mm": model.outline,
        "egi_mass_centre": model.mass_centre,
        "mean_normal": model.mean_normal,
        "surface_characteristics": dict(zip(CHARACTERISTICS, model.shares, strict=True)),
        "characteristic_areas": [
            {"characteristic": CHARACTERISTICS[c], "vertices_mm": vertices, "surface_mm2": surface}
            for c, vertices, surface in zip(model.area_characteristic, model.areas, model.area_surface, strict=True)
        ],
        "edges": [
            {"start_mm": edge[:2], "end_mm": edge[2:], "strength": strength}
            for edge, strength in zip(model.edges, model.edge_strength, strict=True)
        ],
        "brothers": [
            {
                "vector_mm": brother[:3], "distance_mm": float(np.linalg.norm(brother[:3])),
                "size_mm": float(np.exp(brother[3])), "cos_between_normals": brother[4],
            }
            for brother in model.brothers if brother[5] > 0
        ],
    }  # fmt: skip


def leaf_node(tree: InterpretationTree, group: int) -> int | None:
    """The last node on the way from the root to a group; None when there is nothing to divide."""
    through = np.flatnonzero(tree.nodes.visible[:, group] | tree.nodes.hidden[:, group])
    return int(through[-1]) if len(through) else None  # nodes come in the order of their levels


def ambiguities(tree: InterpretationTree) -> list[dict[str, Any]]:
    """What the tree cannot tell: pairs of groups that every rule confuses in over a quarter of the draws, and rotations
    that stay open.

    Each has the views concerned, so that they can be looked at; at run time all of them go on as alternatives.
    """
    d, views, labels = tree.determination, tree.groups.representative_view, tree.groups.label_strings
    kept = np.flatnonzero(~tree.groups.pruned)
    found: list[dict[str, Any]] = []
    pairs = [(int(g), h) for g in kept for h in inseparable(tree, int(g)) if g < h]
    for g, h in pairs:
        found.append({
            "kind": "groups", "groups": [labels[g], labels[h]], "views": [int(views[g]), int(views[h])],
            "rule": tree.confusion.pair_rule[g][h], "error_rate": float(tree.confusion.pair_error[g, h]),
        })  # fmt: skip
    for g in kept[d.rotations_left[kept] != 1]:
        found.append({
            "kind": "rotation", "group": labels[g], "rotations_left": int(d.rotations_left[g]),
            "remaining_freedom": remaining_freedom(int(d.rotations_left[g])), "view": int(views[g]),
        })  # fmt: skip
    return found


def _labels(tree: InterpretationTree, members: np.ndarray) -> list[str]:
    return [tree.groups.label_strings[g] for g in np.flatnonzero(members)]


def _side(visible: bool) -> str:
    return "visible" if visible else "hidden"


def _plain(value: Any) -> Any:
    """Arrays become lists, numbers that are not finite None."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value
