"""Shape labels and attitude groups: the nonlinear shape changes of a part (Ikeuchi 1987, sec. 2.1.1, figures 2d-2g).

The exhaustive method: the part is seen from every direction of the dome, each view gets a label with one digit per
identifying face (1 if detectable), and views of the same label form an attitude group.
"""

from dataclasses import dataclass

import numpy as np
from itree_cad.part import Part
from itree_kernels.errors import ItreeError
from itree_kernels.mesh import RayMesh
from jaxtyping import Bool, Float, Int

from itree_jax.sensor import Sensor
from itree_jax.tree.concavity import STEEP, self_blocking
from itree_jax.tree.detectable import (
    Detectable,
    Progress,
    cast_views,
    count_regions,
    detectable,
    section_direction,
    smallest_region_px,
)
from itree_jax.tree.dome import camera_rotation, dome

LABEL_FACES = 8  # digits of a label unless the part names its faces: what the paper used of its twelve faces
# Sections within this share of the largest are equal (views that mirror each other): the first view is taken.
EQUAL_SECTION = 1e-3
# Shadows turn with the part, so that turning it to its direction moves the direction a little: settled after this many.
ROLL_STEPS = 3


@dataclass(frozen=True)
class AttitudeGroups:
    """The views of the dome by shape label; group 0 has the label of the greatest binary number (the paper's group 1).

    The groups partition the views. A pruned group keeps its views, but is no leaf of the interpretation tree. (The
    paper numbers its groups in another order: its groups 1 to 7 are 0, 3, 1, 2, 5, 4, 6 here.)
    """

    frequency: int  # of the dome
    directions: Float[np.ndarray, "views 3"]  # unit, from the part toward the viewer, part frame
    R_cam_obj: Float[np.ndarray, "views 3 3"]  # image up = the part's +z projected
    face_area: Float[np.ndarray, "views faces"]  # detectable area of each component face in the image plane [mm^2]
    region_count: Int[np.ndarray, "views"]  # detectable regions, of all faces
    identifying_faces: Int[np.ndarray, "digits"]  # component face of each digit, in area order
    identifying_areas: Float[np.ndarray, "digits"]  # their surfaces [mm^2]
    self_blocking: Float[np.ndarray, "digits"]  # share of its own light each blocks: steep concave faces from 0.25 on
    labels: Bool[np.ndarray, "views digits"]  # True where the face is detectable
    group_labels: Bool[np.ndarray, "groups digits"]
    group_of_view: Int[np.ndarray, "views"]
    pruned: Bool[np.ndarray, "groups"]  # True: no representative attitude is generated
    pruned_reason: tuple[str, ...]  # "" for a group that is kept
    representative_view: Int[np.ndarray, "groups"]  # view of the largest section; of a pruned group as well
    representative_roll: Float[np.ndarray, "groups"]  # [rad] about the line of sight, see `representative_rotations`
    representative_regions: Int[np.ndarray, "groups"]  # detectable regions at the representative attitude

    @property
    def group_count(self) -> int:
        return len(self.group_labels)

    @property
    def view_count(self) -> Int[np.ndarray, "groups"]:
        return np.bincount(self.group_of_view, minlength=self.group_count)

    @property
    def label_strings(self) -> tuple[str, ...]:
        """One per group, such as "11100000"."""
        return tuple(label_string(label) for label in self.group_labels)

    def views_of(self, group: int) -> Int[np.ndarray, "members"]:
        return np.flatnonzero(self.group_of_view == group)

    def representative_rotations(self) -> Float[np.ndarray, "groups 3 3"]:
        """`R_cam_obj` of the representative attitudes: their views, rolled."""
        return roll_rotation(self.representative_roll) @ self.R_cam_obj[self.representative_view]


def attitude_groups(
    mesh: RayMesh,
    part: Part,
    sensor: Sensor,
    frequency: int = 1,
    label_faces: int | None = None,
    progress: Progress | None = None,
) -> AttitudeGroups:
    """Sees the part from all 60 frequency^2 directions of the dome and groups the views by shape label.

    Args:
        mesh: the part's triangles with its component faces.
        part: its identifying faces make the label; a part that names none gets, in area order, the faces that are
            detectable from anywhere on the dome.
        sensor: camera, lights, slant limit and smallest region decide what is detectable.
        frequency: of the dome.
        label_faces: most digits of the label for a part that names no faces (default 8).
        progress: called with (views done, views in all).

    Raises:
        ItreeError: nothing of the part is detectable from anywhere.
    """
    directions = dome(frequency).directions
    R_cam_obj = camera_rotation(directions)
    seen = detectable(mesh, part, sensor, R_cam_obj, progress)
    faces = identifying_faces(part, sensor, seen, LABEL_FACES if label_faces is None else label_faces)
    labels = seen.face_area[:, faces] > sensor.smallest_region
    group_labels, group_of_view = group_by_label(labels)
    blocking = np.array([self_blocking(part, int(face)) for face in faces])
    view = largest_sections(seen.face_area[:, faces], labels, group_of_view, len(group_labels))
    roll, regions = representative_rolls(mesh, part, sensor, R_cam_obj[view], group_labels, faces)
    reasons = tuple(
        prune_reason(label, blocking, int(count)) for label, count in zip(group_labels, regions, strict=True)
    )
    return AttitudeGroups(
        frequency=frequency,
        directions=directions,
        R_cam_obj=R_cam_obj,
        face_area=seen.face_area,
        region_count=seen.region_count,
        identifying_faces=faces,
        identifying_areas=np.asarray(part.face_areas)[faces],
        self_blocking=blocking,
        labels=labels,
        group_labels=group_labels,
        group_of_view=group_of_view,
        pruned=np.array([reason != "" for reason in reasons]),
        pruned_reason=reasons,
        representative_view=view,
        representative_roll=roll,
        representative_regions=regions,
    )


def identifying_faces(part: Part, sensor: Sensor, seen: Detectable, label_faces: int) -> Int[np.ndarray, "digits"]:
    """Component face of each digit of the label, in area order: those the part names, else the detectable ones."""
    if part.identifying_faces is not None:
        return np.array(sorted(part.identifying_faces), dtype=np.int32)
    anywhere = np.flatnonzero(seen.face_area.max(axis=0) > sensor.smallest_region)
    if len(anywhere) == 0:
        raise ItreeError(
            f"No face of part '{part.name}' (diameter {part.diameter:.1f} mm) is detectable from any of "
            f"{len(seen.face_area)} directions: the largest detectable area is {seen.face_area.max():.1f} mm^2, the "
            f"sensor's smallest region {sensor.smallest_region:.1f} mm^2. Check the part's unit, or lower the smallest "
            "region or raise the slant limit of the sensor."
        )
    return anywhere[:label_faces].astype(np.int32)  # component faces are numbered in area order


def group_by_label(
    labels: Bool[np.ndarray, "views digits"],
) -> tuple[Bool[np.ndarray, "groups digits"], Int[np.ndarray, "views"]]:
    """Distinct labels as falling binary numbers, and the one each view has."""
    rising, index = np.unique(labels, axis=0, return_inverse=True)
    return rising[::-1], (len(rising) - 1 - index.reshape(-1)).astype(np.int32)


def largest_sections(
    digit_area: Float[np.ndarray, "views digits"],
    labels: Bool[np.ndarray, "views digits"],
    group_of_view: Int[np.ndarray, "views"],
    group_count: int,
) -> Int[np.ndarray, "groups"]:
    """The view of each group that shows the largest detectable section of the faces of its label; ties: the first."""
    section = np.where(labels, digit_area, 0.0).sum(axis=1)
    chosen = []
    for group in range(group_count):
        views = np.flatnonzero(group_of_view == group)
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


def label_string(label: Bool[np.ndarray, "digits"]) -> str:
    return "".join("1" if digit else "0" for digit in label)
