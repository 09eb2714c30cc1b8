"""The tables of a scene's page: poses with their uncertainty, and regions without an answer."""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from itree_jax.detections import Detection, count_of_poses
from itree_jax.report.decision_view import decision_path_view
from itree_jax.report.markup import NOT_KNOWN, count_of, image, number, percent, table, text
from itree_jax.report.palette import css
from itree_jax.report.pose_pictures import pose_picture
from itree_jax.report.scene_view import PoseView, SceneView
from itree_jax.report.svg_tree import svg_tree
from itree_jax.report.tree_path import group_reached
from itree_jax.report.truth_view import RIGHT
from itree_jax.tree.drawing import leaf_names

Vector = np.ndarray


def pose_table(view: SceneView) -> str:
    """One row for each pose, in the order for picking."""
    if not view.poses:
        return '<p class="empty">No part was recognised. The regions below say why.</p>'
    head = [
        "offer", "part", "score", "position x, y, z [mm]", "rotation vector [°]", "height [mm]", "agree [px]",
        "contradict [px]", "hidden [px]",
    ]  # fmt: skip
    rows = [pose_row(p) for p in view.poses]
    if view.comparison is not None:
        head.append("to the truth [mm]")
        rows = [[*row, truth_cell(view, k)] for k, row in enumerate(rows)]
    return table(head, rows, numeric=range(2, 10), css_class="poses")


def pose_row(p: PoseView) -> list[str]:
    d = p.detection
    rank = f'<a href="#pose-{d.offer_rank}"><i class="key" style="background:{css(p.colour)}"></i>{d.offer_rank}</a>'
    std = None if d.rotation_std is None else np.degrees(d.rotation_std)
    return [
        rank, f"{text(p.tree.part.name)}<br><small>obj {d.obj_id}</small>", number(d.score, 3) + ambiguous_mark(d),
        triple(d.t_cam_obj, 1) + deviation(d.translation_std),
        triple(np.degrees(Rotation.from_matrix(d.R_cam_obj).as_rotvec()), 1) + deviation(std) + not_measured(d),
        number(d.height, 1), str(d.agreeing), str(d.contradicting), str(d.hidden),
    ]  # fmt: skip


def ambiguous_mark(d: Detection) -> str:
    """A second line where the scene doesn't tell the pose from another one."""
    if not d.ambiguous:
        return ""
    return f'<br><span class="chip warn">ambiguous: {count_of(count_of_poses(d.alternatives), "pose")}</span>'


def not_measured(d: Detection) -> str:
    """Further lines with the directions that nothing in the image measures."""
    return "".join(f"<br><small>not measured: {text(u.words)}</small>" for u in d.unobservable)


def truth_cell(view: SceneView, k: int) -> str:
    assert view.comparison is not None
    mark = '<span class="chip warn">✗ wrong</span>'
    if view.comparison.found[k] >= 0:
        mark = '<span class="chip taken">✓ right</span>'
    elif view.comparison.other_right[k]:
        mark = '<span class="chip">≈ its other pose is right</span>'
    return f"{number(float(view.comparison.error[k]), 1)}<br>{mark}"


def pose_table_notes(view: SceneView) -> str:
    notes = (
        "Poses are model → camera (x right, y down, z forward). The rotation vector is the axis of rotation times the "
        "angle. ± is one standard deviation along and about the camera's axes; ∞ where nothing measured binds it. Not "
        "measured: known to no better than 5 % of the diameter at the part's rim. "
        "Pixel counts are of the sample that verification looked at; the residual picture shows all pixels."
    )
    if view.comparison is not None:
        notes += (
            " To the truth: largest displacement of a surface point (MSSD), least over the symmetries; right within "
            f"{percent(RIGHT, 0)} of the diameter."
        )
    return f'<p class="muted">{notes}</p>'


def deviation(values: Vector | None) -> str:
    """A second line with one standard deviation of each number above it."""
    return f"<br><small>± {NOT_KNOWN if values is None else triple(values, 2)}</small>"


def triple(values: Vector, digits: int) -> str:
    return '<span class="xyz">' + "".join(f"<span>{number(float(v), digits)}</span>" for v in values) + "</span>"


def pose_details(view: SceneView) -> str:
    """For each pose a fold with its picture, its decision path, and the tree with the path in bold."""
    return "\n".join(pose_fold(view, p, opened=k == 0) for k, p in enumerate(view.poses))


def pose_fold(view: SceneView, p: PoseView, opened: bool) -> str:
    d = p.detection
    group = group_reached(p.tree, d.decision_path)
    label = ""
    if group is not None:
        name, digits = leaf_names(p.tree).get(group, ""), p.tree.groups.label_strings[group]
        label = f" · group {name} <code>{text(digits)}</code>"
    summary = (
        f'<i class="key" style="background:{css(p.colour)}"></i><b>Pose {d.offer_rank}</b> · '
        f"{text(p.tree.part.name)} · score {number(d.score, 3)}{label} · {count_of(len(d.decision_path), 'step')}"
    )
    picture = '<p class="empty">This pose lies outside of the image.</p>'
    if p.rendered is not None and p.codes is not None:
        crop = pose_picture(view.background, p.rendered, p.codes, p.colour)
        picture = image(crop, f"pose {d.offer_rank}: contour, and residuals", css_class="crop")
    return (
        f'<details id="pose-{d.offer_rank}"{" open" if opened else ""}><summary>{summary}</summary>{picture}'
        f"{equivalents(p)}{decision_path_view(p.tree, d.decision_path)}"
        f'<div class="scroll">{svg_tree(p.tree, group)}</div></details>'
    )


def equivalents(p: PoseView) -> str:
    """What else the pose might be: by the part's symmetries, and by what the scene doesn't tell."""
    d, said = p.detection, []
    if d.equivalents:
        looks = count_of(len(d.equivalents), "other pose looks", "other poses look")
        said.append(f"{looks} the same, by the part's symmetries.")
    if d.alternatives:
        own = percent(1.0 - sum(a.share for a in d.alternatives), 0)
        others = ", ".join(percent(a.share, 0) for a in d.alternatives)
        verdict = "Ambiguous: the scene does not tell" if d.ambiguous else "Not quite ruled out:"
        poses = count_of(len(d.alternatives), "other pose", "other poses")
        said.append(f"{verdict} {poses} of this place (belief {own} for this one, {others} for the others).")
    return f'<p class="muted">{" ".join(said)}</p>' if said else ""


def lost_table(view: SceneView) -> str:
    """Regions that gave no pose of their own, with the reason; those that no pose explains come first."""
    lost = sorted(view.detections.not_recognised, key=lambda e: (explainer(view, e) is not None, int(e["region"])))
    if not lost:
        return '<p class="muted">Every region gave a pose.</p>'
    areas = np.bincount(view.labels[view.labels >= 0], minlength=len(view.region_pose))
    rows = []
    for entry in lost:
        region = int(entry["region"])
        area = str(areas[region]) if 0 <= region < len(areas) else NOT_KNOWN
        height = entry.get("height_mm")
        place = np.argwhere(view.labels == region)[:, ::-1]
        uv = f"{place[:, 0].mean():.0f}, {place[:, 1].mean():.0f}" if len(place) else NOT_KNOWN
        rank = explainer(view, entry)
        by = '<span class="chip warn">no pose</span>' if rank is None else f'<a href="#pose-{rank}">pose {rank}</a>'
        reason = text(entry.get("reason", ""))
        rows.append([str(region), by, reason, uv, number(None if height is None else float(height)), area])
    head = ["region", "explained by", "why its own poses were not accepted", "at u, v [px]", "height [mm]", "area [px]"]
    return table(head, rows, numeric=(0, 3, 4, 5))


def explainer(view: SceneView, entry: dict[str, Any]) -> int | None:
    """Offer rank of the pose that explains a region; None if none does."""
    region = int(entry["region"])
    if not 0 <= region < len(view.region_pose) or view.region_pose[region] < 0:
        return None
    return view.poses[view.region_pose[region]].detection.offer_rank
