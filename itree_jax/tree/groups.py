"""Shape labels and attitude groups: the nonlinear shape changes of a part (Ikeuchi 1987, sec. 2.1.1, figures 2d-2g).

The exhaustive method: the part is seen from every direction of the dome, each view gets a label with one digit per
identifying face (1 if detectable), and views of the same label form an attitude group. Beyond the paper: labels that a
symmetry of the part carries into each other are the same, a part of revolution is seen once per ring of directions, and
labels that exist only at the borders of others join them (see `borders`).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from itree_cad.face_permutations import face_permutations
from itree_cad.part import Part
from itree_cad.symmetry import Symmetries
from itree_kernels.errors import ItreeError
from itree_kernels.mesh import RayMesh
from jaxtyping import Bool, Float, Int

from itree_jax.sensor import Sensor
from itree_jax.tree.borders import labels_of_groups, nearest_label, uncertain_band
from itree_jax.tree.concavity import self_blocking
from itree_jax.tree.detectable import Detectable, Progress, detectable, part_camera
from itree_jax.tree.dome import camera_rotation, dome
from itree_jax.tree.meridian import meridian_views
from itree_jax.tree.representative import largest_sections, prune_reason, representative_rolls, roll_rotation
from itree_jax.tree.same_label import digit_permutations, whole_orbits

LABEL_FACES = 8  # digits of a label unless the part names its faces: what the paper used of its twelve faces
WIDENED = 2  # times as many digits at most, to have all faces that a symmetry carries into each other


@dataclass(frozen=True)
class AttitudeGroups:
    """The views of the dome by shape label; group 0 has the label of the greatest binary number (the paper's group 1).

    The groups partition the views. A pruned group keeps its views, but is no leaf of the interpretation tree. (The
    paper numbers its groups in another order: its groups 1 to 7 are 0, 3, 1, 2, 5, 4, 6 here.) A view's label can
    differ from its group's: by a symmetry of the part, and in digits that it took over at a border, which
    `membership` tells.
    """

    frequency: int  # of the dome
    directions: Float[np.ndarray, "views 3"]  # unit, from the part toward the viewer, part frame
    R_cam_obj: Float[np.ndarray, "views 3 3"]  # image up = +z projected; of a part of revolution, its axis
    face_area: Float[np.ndarray, "views faces"]  # detectable area of each component face in the image plane [mm^2]
    region_count: Int[np.ndarray, "views"]  # detectable regions, of all faces
    identifying_faces: Int[np.ndarray, "digits"]  # component face of each digit, in area order
    identifying_areas: Float[np.ndarray, "digits"]  # their surfaces [mm^2]
    self_blocking: Float[np.ndarray, "digits"]  # share of its own light each blocks: steep concave faces from 0.25 on
    labels: Bool[np.ndarray, "views digits"]  # True where the face is detectable
    group_labels: Bool[np.ndarray, "groups digits"]
    group_of_view: Int[np.ndarray, "views"]
    membership: Float[np.ndarray, "views"]  # 1: the group's label; else the product of area / smallest region, or its
    # inverse, over the digits that differ: 0.8 for one digit whose area is 20 % off
    same_digits: Int[np.ndarray, "symmetries digits"]  # digit into which each symmetry carries a digit; identity first
    smallest_region: float  # of the sensor [mm^2]: a face of a larger detectable area is in the label
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

    @cached_property
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
    symmetry: Symmetries | None = None,
) -> AttitudeGroups:
    """Sees the part from all 60 frequency^2 directions of the dome and groups the views by shape label.

    Args:
        mesh: the part's triangles with its component faces.
        part: its identifying faces make the label; a part that names none gets, in area order, the faces that are
            detectable from anywhere on the dome. A part of revolution has rings for faces (`itree_cad.revolution`).
        sensor: camera, lights, slant limit and smallest region decide what is detectable.
        frequency: of the dome.
        label_faces: most digits of the label for a part that names no faces (default 8); up to twice as many where
            symmetries carry its faces into others.
        progress: called with (views done, views in all).
        symmetry: of the part; None takes it for a part without.

    Raises:
        ItreeError: nothing of the part is detectable from anywhere.
    """
    directions = dome(frequency).directions
    R_cam_obj, seen = seen_from(mesh, part, sensor, directions, symmetry, progress)
    permutations = np.arange(part.face_count)[None] if symmetry is None else face_permutations(part, symmetry)
    most = LABEL_FACES if label_faces is None else label_faces
    faces = identifying_faces(part, sensor, seen, most, permutations)
    same_digits = digit_permutations(permutations, faces)
    digit_area = seen.face_area[:, faces]
    labels = digit_area > sensor.smallest_region
    # a depth camera has no light that a face could throw back on itself
    blocking = np.array([0.0 if sensor.is_depth_camera else self_blocking(part, int(face)) for face in faces])
    blocking = blocking[same_digits].max(axis=0)  # alike faces differ by their pixels only, and are pruned together
    band = uncertain_band(sensor, frequency, part_camera(part, sensor).mm_per_px(1.0))
    group_labels = labels_of_groups(digit_area, same_digits, sensor.smallest_region, blocking, band, frequency**2)
    group_of_view, membership = nearest_label(digit_area, group_labels, same_digits, sensor.smallest_region, blocking)
    view = largest_sections(digit_area, labels, group_labels)
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
        membership=membership,
        same_digits=same_digits,
        smallest_region=sensor.smallest_region,
        pruned=np.array([reason != "" for reason in reasons]),
        pruned_reason=reasons,
        representative_view=view,
        representative_roll=roll,
        representative_regions=regions,
    )


def group_of_label(groups: AttitudeGroups, face_area: Float[np.ndarray, "n faces"]) -> Int[np.ndarray, "n"]:
    """The attitude group of anything that shows these detectable areas: of a view at any roll, or of a noisy draw.

    The group whose label costs least to reach from the label that is seen, up to the part's symmetries; the group of
    that very label if there is one. Of the dome's own views this is `group_of_view`.

    Args:
        face_area: detectable area of each component face in the image plane [mm^2].
    """
    area = face_area[:, groups.identifying_faces]
    return nearest_label(area, groups.group_labels, groups.same_digits, groups.smallest_region, groups.self_blocking)[0]


def seen_from(
    mesh: RayMesh,
    part: Part,
    sensor: Sensor,
    directions: Float[np.ndarray, "views 3"],
    symmetry: Symmetries | None,
    progress: Progress | None,
) -> tuple[Float[np.ndarray, "views 3 3"], Detectable]:
    """`R_cam_obj` of the views and what is detectable from them; of a part of revolution each ring is cast once."""
    if symmetry is None or not symmetry.continuous:
        R_cam_obj = camera_rotation(directions)
        return R_cam_obj, detectable(mesh, part, sensor, R_cam_obj, progress)
    R_cam_obj, R_ring, ring = meridian_views(directions, [axis for axis, _ in symmetry.continuous])
    seen = detectable(mesh, part, sensor, R_ring, progress)
    return R_cam_obj, Detectable(seen.face_area[ring], seen.region_count[ring])


def identifying_faces(
    part: Part, sensor: Sensor, seen: Detectable, label_faces: int, permutations: Int[np.ndarray, "symmetries faces"]
) -> Int[np.ndarray, "digits"]:
    """Component face of each digit of the label, in area order: those the part names, else the detectable ones.

    Both with all faces that symmetries carry them into: a face that the part names always brings the others (nothing
    tells them apart), others do while there are at most twice `label_faces` digits.
    """
    if part.identifying_faces is not None:
        return whole_orbits(np.array(part.identifying_faces), permutations, None)
    anywhere = np.flatnonzero(seen.face_area.max(axis=0) > sensor.smallest_region)
    if len(anywhere) == 0:
        raise ItreeError(
            f"No face of part '{part.name}' (diameter {part.diameter:.1f} mm) is detectable from any of "
            f"{len(seen.face_area)} directions: the largest detectable area is {seen.face_area.max():.1f} mm^2, the "
            f"sensor's smallest region {sensor.smallest_region:.1f} mm^2. Check the part's unit, or lower the smallest "
            "region or raise the slant limit of the sensor."
        )
    # component faces are numbered in area order
    return whole_orbits(anywhere[:label_faces], permutations, WIDENED * label_faces)


def label_string(label: Bool[np.ndarray, "digits"]) -> str:
    return "".join("1" if digit else "0" for digit in label)
