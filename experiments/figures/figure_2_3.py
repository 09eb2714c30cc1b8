"""Figures 2c to 2g and 3 of Ikeuchi 1987, drawn from the compiler's own tables.

    python experiments/figures/figure_2_3.py --out FOLDER [--model MODEL] [--sensor SENSOR]

Writes figure_2c.png (the dome), 2d (apparent shapes; detectable faces in colour inside bold lines), 2e (identifying
faces), 2f (attitude groups), 2g (representative attitudes) and figure_3.png (branches).
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import tyro
from itree_cad.load import load_part
from itree_cad.part import Part
from itree_kernels.apparent import ApparentShapes, cast_apparent_shapes
from itree_kernels.camera import Camera
from itree_kernels.mesh import RayMesh, ray_mesh
from matplotlib.collections import PolyCollection

from itree_jax.sensing.sensor_file import load_sensor
from itree_jax.sensor import Sensor
from itree_jax.tree.branches import ROOT, Branches, branches
from itree_jax.tree.dome import camera_rotation, dome
from itree_jax.tree.groups import AttitudeGroups, attitude_groups

# The paper's names and order of its groups; groups of another part are named and ordered by their number.
PAPER_NAMES = {
    "11100000": "S1",
    "11000000": "S2",
    "11000010": "S3",
    "11000001": "S4",
    "00001100": "S5",
    "00010000": "group 6",
    "00000000": "group 7",
}
COLOURS = plt.get_cmap("Set2")(np.arange(8))[:, :3]
OTHER_FACE = np.array([0.72, 0.72, 0.78])  # detectable, but no digit of the label
SIDE = 400  # [px] of a view before it is halved, so that its lines are smooth
GREY = "0.45"


@dataclass(frozen=True)
class Config:
    """What to draw."""

    out: Path  # folder for the pictures
    model: str = "bundled:ikeuchi-1987"
    sensor: str = "bundled:ikeuchi-1987"


@dataclass(frozen=True)
class Subject:
    """The part and all that was compiled from it."""

    part: Part
    sensor: Sensor
    mesh: RayMesh
    groups: AttitudeGroups
    tree: Branches
    views: ApparentShapes  # of the dome, large enough to draw

    @property
    def is_papers(self) -> bool:
        return set(self.groups.label_strings) == set(PAPER_NAMES)

    def name(self, group: int) -> str:
        return PAPER_NAMES[self.groups.label_strings[group]] if self.is_papers else f"group {group + 1}"

    def in_order(self) -> list[int]:
        labels = self.groups.label_strings
        return [labels.index(label) for label in (PAPER_NAMES if self.is_papers else labels)]


def main(config: Config) -> list[Path]:
    """Draws all figures; returns the files written."""
    part, sensor = load_part(config.model), load_sensor(config.sensor)
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle)
    groups = attitude_groups(mesh, part, sensor)
    tree = branches(groups.group_labels, groups.identifying_areas, groups.pruned)
    subject = Subject(part, sensor, mesh, groups, tree, cast(mesh, part, sensor, groups.R_cam_obj))
    figures: dict[str, Callable[[Subject], None]] = {
        "2c": dome_figure,
        "2d": apparent_shapes_figure,
        "2e": identifying_faces_figure,
        "2f": attitude_groups_figure,
        "2g": representative_attitudes_figure,
        "3": branches_figure,
    }
    config.out.mkdir(parents=True, exist_ok=True)
    written = []
    for name, draw in figures.items():
        draw(subject)
        written.append(config.out / f"figure_{name}.png")
        plt.savefig(written[-1], dpi=130, bbox_inches="tight", facecolor="white")
        plt.close("all")
    return written


def dome_figure(subject: Subject) -> None:
    axes = plt.figure(figsize=(5, 5)).add_subplot()
    tessellation = dome(subject.groups.frequency)
    towards = np.array([0.42, -0.62, 0.66])
    R = camera_rotation(towards / np.linalg.norm(towards))
    corners = tessellation.triangles @ R.T
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = -normals[:, 2] / np.linalg.norm(normals, axis=1)
    front = facing > 0
    shade = 0.55 + 0.43 * facing[front]
    axes.add_collection(
        PolyCollection(corners[front][:, :, :2], facecolors=np.stack([shade] * 3, axis=1), edgecolors="black", lw=0.8)
    )
    for k in np.flatnonzero(facing > 0.3):
        axes.text(*corners[k].mean(axis=0)[:2], str(k), ha="center", va="center", fontsize=9)
    for pentagon in range(12):
        cells = slice(pentagon * tessellation.frequency**2 * 5, (pentagon + 1) * tessellation.frequency**2 * 5)
        if front[cells].all():
            outline = cv2.convexHull(corners[cells, :, :2].reshape(-1, 2).astype(np.float32))[:, 0]
            axes.fill(*outline.T, fill=False, ec="black", lw=2.2)
    axes.set(xlim=(-1.4, 1.4), ylim=(1.4, -1.4), aspect="equal", title=f"{tessellation.cell_count} viewer directions")
    axes.axis("off")


def apparent_shapes_figure(subject: Subject) -> None:
    groups = subject.groups
    pictures = view_pictures(subject, subject.views)
    rows = -(-len(pictures) // 10)
    _, axes = plt.subplots(rows, 10, figsize=(16, 1.78 * rows))
    for view, axis in enumerate(axes.flat):
        axis.axis("off")
        if view < len(pictures):
            axis.imshow(pictures[view])
            group = int(groups.group_of_view[view])
            axis.set_title(f"{view}: {groups.label_strings[group]}", fontsize=8, pad=2)
    plt.subplots_adjust(wspace=0.02, hspace=0.16)


def identifying_faces_figure(subject: Subject) -> None:
    groups, part = subject.groups, subject.part
    faces = groups.identifying_faces
    _, axes = plt.subplots(-(-len(faces) // 4), 4, figsize=(12, 3.3 * -(-len(faces) // 4)))
    shapes = subject.views
    visible = np.array([[np.count_nonzero(face == f) for f in faces] for face in shapes.face])
    for digit, axis in enumerate(np.ravel(axes)):
        axis.axis("off")
        if digit >= len(faces):
            continue
        shown = obliquely_visible(visible[:, digit])
        axis.imshow(picture(subject, shapes, shown, shapes.face[shown] == faces[digit]))
        kind, area = part.face_types[faces[digit]], groups.identifying_areas[digit]
        axis.set_title(f"face {digit + 1}: {kind}, {area:.0f} mm²", fontsize=11, pad=3)


def obliquely_visible(visible: np.ndarray) -> int:
    """A view that shows most of a face without looking at it head-on, where the part's shape cannot be told."""
    good = np.flatnonzero(visible >= 0.75 * visible.max())
    return int(good[np.argmin(visible[good])])


def attitude_groups_figure(subject: Subject) -> None:
    groups = subject.groups
    pictures = view_pictures(subject, subject.views)
    columns = int(groups.view_count.max())
    _, axes = plt.subplots(groups.group_count, columns, figsize=(1.45 * columns + 3, 1.5 * groups.group_count))
    for group, row in zip(subject.in_order(), np.atleast_2d(axes), strict=True):
        views = groups.views_of(group)
        for k, axis in enumerate(row):
            axis.axis("off")
            if k < len(views):
                axis.imshow(pictures[views[k]])
                if views[k] == groups.representative_view[group] and not groups.pruned[group]:
                    axis.set_title("largest section", fontsize=8, pad=1)
        digits = " ".join(f"({d + 1})" for d in np.flatnonzero(groups.group_labels[group])) or "nil"
        lines = [f"{subject.name(group)}   {groups.label_strings[group]}", f"{digits}   {len(views)} views"]
        if groups.pruned[group]:
            lines += ["pruned: " + groups.pruned_reason[group].split(":")[0]]
        row[0].text(-0.15, 0.5, "\n".join(wrapped(lines)), transform=row[0].transAxes, ha="right", va="center")
    plt.subplots_adjust(wspace=0.02, hspace=0.12)


def wrapped(lines: list[str], width: int = 30) -> list[str]:
    out = []
    for line in lines:
        while len(line) > width and " " in line[:width]:
            cut = line[:width].rindex(" ")
            out.append(line[:cut])
            line = line[cut + 1 :]
        out.append(line)
    return out


def representative_attitudes_figure(subject: Subject) -> None:
    groups = subject.groups
    kept = [group for group in subject.in_order() if not groups.pruned[group]]
    R = groups.representative_rotations()[kept]
    pictures = view_pictures(subject, cast(subject.mesh, subject.part, subject.sensor, R))
    _, axes = plt.subplots(1, len(kept), figsize=(3.3 * len(kept), 3.9))
    for group, axis, image in zip(kept, np.atleast_1d(axes), pictures, strict=True):
        axis.imshow(image)
        axis.axis("off")
        count = int(groups.representative_regions[group])
        title = f"{subject.name(group)}   {groups.label_strings[group]}"
        axis.set_title(f"{title}\n{count} region{'s' if count > 1 else ''}", fontsize=12)
    axis = np.atleast_1d(axes)[0]
    axis.annotate("", (0.3, 0.04), (0.04, 0.04), xycoords="axes fraction", arrowprops={"arrowstyle": "->"})
    axis.text(0.33, 0.04, "x: maximum inertia direction", transform=axis.transAxes, va="center", fontsize=9)


def branches_figure(subject: Subject) -> None:
    """Root at the left; the side where a face is detectable goes up. Pruned branches and groups are grey and dashed."""
    groups, tree = subject.groups, subject.tree
    order = leaf_order(tree, groups.group_count)
    height = {group: float(len(order) - k) for k, group in enumerate(order)}
    depth = np.zeros(tree.branch_count)
    for k in range(1, tree.branch_count):
        depth[k] = depth[tree.parent[k]] + 1
    right = depth.max(initial=-1) + 1
    axes = plt.figure(figsize=(2.6 * right + 4, 0.95 * len(order) + 0.6)).add_subplot()
    for k in range(tree.branch_count):
        x, y = depth[k], branch_height(tree, k, height)
        for visible, side in ((True, tree.visible[k]), (False, tree.hidden[k])):
            child = child_of(tree, k, visible)
            end_x = right if child is None else depth[child]
            end_y = mean_height(side, height) if child is None else branch_height(tree, child, height)
            colour, dashes = (GREY, "--") if groups.pruned[side].all() else ("black", "-")
            turn = x + 0.3
            axes.plot([turn, turn, end_x], [y, end_y, end_y], zorder=1, color=colour, ls=dashes)
            axes.text(turn + 0.06, end_y + 0.06, answer(tree.tested[k], visible), fontsize=9, color=colour)
        axes.plot([x, x + 0.3], [y, y], color="black", zorder=1)
        colour, dashes, note = (GREY, "--", "\npruned") if tree.pruned[k] else ("black", "-", "")
        box = {"boxstyle": "round,pad=0.35", "fc": "white", "ec": colour, "ls": dashes}
        axes.text(x, y, tree.names[k] + note, ha="center", va="center", bbox=box, color=colour, zorder=2)
    for group, y in height.items():
        colour = GREY if groups.pruned[group] else "black"
        axes.text(right + 0.08, y, f"{subject.name(group)}   {groups.label_strings[group]}", va="center", color=colour)
    axes.set(xlim=(-0.3, right + 1.2), ylim=(0.4, len(order) + 0.6))
    axes.axis("off")


def child_of(tree: Branches, parent: int, visible: bool) -> int | None:
    below = np.flatnonzero((tree.parent == parent) & (tree.on_visible_side == visible))
    return int(below[0]) if len(below) else None


def branch_height(tree: Branches, k: int, height: dict[int, float]) -> float:
    return 0.5 * (mean_height(tree.visible[k], height) + mean_height(tree.hidden[k], height))


def answer(tested: np.ndarray, visible: bool) -> str:
    """What is detectable on one side of a branch, such as "any of 1, 2"."""
    faces = [str(digit + 1) for digit in np.flatnonzero(tested)]
    if len(faces) == 1:
        return f"face {faces[0]}" if visible else f"no face {faces[0]}"
    return ("any of " if visible else "none of ") + ", ".join(faces)


def leaf_order(tree: Branches, group_count: int) -> list[int]:
    """Groups from top to bottom, so that the branches' lines do not cross."""

    def side(members: np.ndarray, parent: int, visible: bool) -> list[int]:
        below = child_of(tree, parent, visible)
        if below is None:
            return np.flatnonzero(members).tolist()
        return side(tree.visible[below], below, True) + side(tree.hidden[below], below, False)

    return side(np.ones(group_count, dtype=bool), ROOT, False)


def mean_height(members: np.ndarray, height: dict[int, float]) -> float:
    return float(np.mean([height[int(group)] for group in np.flatnonzero(members)]))


def view_pictures(subject: Subject, shapes: ApparentShapes) -> list[np.ndarray]:
    """RGB pictures of views, detectable faces in colour inside bold lines, the rest in grey inside thin ones."""
    return [picture(subject, shapes, k, shapes.detectable[k]) for k in range(len(shapes.face))]


def cast(mesh: RayMesh, part: Part, sensor: Sensor, R_cam_obj: np.ndarray) -> ApparentShapes:
    middle = 0.5 * (part.vertices.min(axis=0) + part.vertices.max(axis=0))
    scale = 0.96 * SIDE / (2.0 * float(np.linalg.norm(part.vertices - middle, axis=1).max()))
    camera = Camera("orthographic", scale, scale, (SIDE - 1) / 2, (SIDE - 1) / 2, SIDE, SIDE)
    t = -R_cam_obj @ middle + np.array([0, 0, 2.0 * part.diameter])
    return cast_apparent_shapes(mesh, R_cam_obj, t, camera, sensor.light_directions, sensor.slant_limit)


def picture(subject: Subject, shapes: ApparentShapes, k: int, emphasised: np.ndarray) -> np.ndarray:
    face, towards = shapes.face[k], np.maximum(-shapes.normal[k, ..., 2], 0)
    image = np.ones((*face.shape, 3))
    hit = face >= 0
    image[hit] = (0.80 + 0.17 * towards[hit])[:, None]
    colour_of_face = np.tile(OTHER_FACE, (subject.part.face_count, 1))
    for digit, f in enumerate(subject.groups.identifying_faces):
        colour_of_face[f] = COLOURS[digit % len(COLOURS)]
    image[emphasised] = colour_of_face[face[emphasised]] * (0.72 + 0.28 * towards[emphasised])[:, None]
    thin = border(face.astype(int), 1)
    bold = border(np.where(emphasised, face.astype(int), -2), 4)
    image[thin] = 0.5
    image[bold & (cv2.dilate(emphasised.astype(np.uint8), np.ones((5, 5))) > 0)] = 0.05
    return cv2.resize(image, (SIDE // 2, SIDE // 2), interpolation=cv2.INTER_AREA)


def border(ids: np.ndarray, width: int) -> np.ndarray:
    """True within `width` px of a change of id."""
    change = np.zeros(ids.shape, dtype=np.uint8)
    change[:, 1:] |= ids[:, 1:] != ids[:, :-1]
    change[1:, :] |= ids[1:, :] != ids[:-1, :]
    return cv2.dilate(change, np.ones((width, width))) > 0


if __name__ == "__main__":
    main(tyro.cli(Config))
