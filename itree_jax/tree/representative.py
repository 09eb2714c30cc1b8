"""Representative attitudes: one view stands for its whole attitude group (Ikeuchi 1987, sec. 2.1.1, figure 2g)."""

import numpy as np
from itree_cad.part import Part
from itree_kernels.mesh import RayMesh
from jaxtyping import Bool, Float, Int

from itree_jax.sensor import Sensor
from itree_jax.tree.concavity import STEEP
from itree_jax.tree.detectable import cast_views, count_regions, section_direction, smallest_region_px

# Sections within this share of the largest are equal (views that mirror each other): the first view is taken.
EQUAL_SECTION = 1e-3
# Shadows turn with the part, so that turning it to its direction moves the direction a little: settled after this many.
ROLL_STEPS = 3


def largest_sections(
    digit_area: Float[np.ndarray, "views digits"],
    labels: Bool[np.ndarray, "views digits"],
    group_labels: Bool[np.ndarray, "groups digits"],
) -> Int[np.ndarray, "groups"]:
    """The view with exactly the group's label that shows the largest detectable section of its faces; ties: the first.

    `group_labels` are labels of views.
    """
    section = np.where(labels, digit_area, 0.0).sum(axis=1)
    chosen = []
    for label in group_labels:
        views = np.flatnonzero((labels == label).all(axis=1))
        chosen.append(views[section[views] >= section[views].max() * (1.0 - EQUAL_SECTION)][0])
    return np.array(chosen, dtype=np.int32)


def representative_rolls(
    mesh: RayMesh,
    part: Part,
    sensor: Sensor,
    R_cam_obj: Float[np.ndarray, "groups 3 3"],
    group_labels: Bool[np.ndarray, "groups digits"],
    faces: Int[np.ndarray, "digits"],
) -> tuple[Float[np.ndarray, "groups"], Int[np.ndarray, "groups"]]:
    """Roll [rad] that lays the section's maximum inertia direction along the image's x axis, and the regions seen then.

    A section without such a direction (a disc) or without a face (label of zeros) is not turned.
    """
    roll = np.zeros(len(R_cam_obj))
    for step in range(ROLL_STEPS + 1):
        alpha, regions = [], []
        for shapes in cast_views(mesh, part, sensor, roll_rotation(roll) @ R_cam_obj):
            for face, mask in zip(shapes.face, shapes.detectable, strict=True):
                section = mask & np.isin(face, faces[group_labels[len(alpha)]])
                alpha.append(section_direction(section))
                regions.append(count_regions(mask, smallest_region_px(part, sensor)))
        if step < ROLL_STEPS:
            roll = roll - np.array(alpha)
    return np.arctan2(np.sin(roll), np.cos(roll)), np.array(regions, dtype=np.int32)


def prune_reason(label: Bool[np.ndarray, "digits"], blocking: Float[np.ndarray, "digits"], region_count: int) -> str:
    """Why no representative attitude is generated from a group, or "" when one is (sec. 2.1.1)."""
    if not label.any():
        return "no identifying face is detectable"
    if (blocking[label] >= STEEP).all():
        share = 100.0 * float(blocking[label].min())
        return f"only steep concave faces are detectable: they block {share:.0f} % of their own light"
    if region_count == 0:
        return "no region is larger than the smallest one"
    return ""


def roll_rotation(roll: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 3 3"]:
    """Rotations about the line of sight: `roll_rotation(a) @ R_cam_obj` turns the image by a [rad] from x toward y."""
    c, s = np.cos(roll), np.sin(roll)
    o, i = np.zeros_like(c), np.ones_like(c)
    return np.stack([np.stack([c, -s, o], -1), np.stack([s, c, o], -1), np.stack([o, o, i], -1)], axis=-2)
