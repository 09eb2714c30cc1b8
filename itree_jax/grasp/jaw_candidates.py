"""Where a parallel jaw can hold a part: opposed plane faces and cylinders within its opening."""

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from itree_jax.grasp.candidate import Candidate, frame
from itree_jax.grasp.gripper import Jaw
from itree_jax.grasp.surface import HoldableFace, faces_of_kind, thinned

OPPOSED = np.cos(np.radians(1.0))  # normals of two faces that a jaw holds; its pads give by a degree
TURNS = 12  # directions of approach about the closing direction, 30 degrees apart
CYLINDER_TURNS = 12  # closing directions across a cylinder's axis within half a turn, 15 degrees apart
PAD_SAMPLES = 5  # along each side of a pad
LEAST_CONTACT = 0.5  # of a pad: a part held by less turns in the jaw


def jaw_candidates(faces: Sequence[HoldableFace], jaw: Jaw) -> Iterator[Candidate]:
    """All places and directions; the part itself may still be in the gripper's way."""
    for a, b in combinations(faces_of_kind(faces, "plane"), 2):
        yield from on_planes(a, b, jaw)
    for face in faces_of_kind(faces, "cylinder"):
        yield from on_cylinder(face, jaw)


def on_planes(a: HoldableFace, b: HoldableFace, jaw: Jaw) -> Iterator[Candidate]:
    """Grasps of two faces that face away from each other, where one lies across from the other."""
    width = float(a.normal @ (a.centre - b.centre))
    if -float(a.normal @ b.normal) < OPPOSED or not _within(width, jaw):
        return
    opposed = a.points[b.has(a.points - width * a.normal)]
    places = thinned(opposed, 0.5 * max(jaw.finger_width, jaw.pad_length)) - 0.5 * width * a.normal
    y, z = np.meshgrid(*(np.linspace(-0.5, 0.5, PAD_SAMPLES) * side for side in (jaw.finger_width, jaw.pad_length)))
    pad = np.stack([np.zeros(y.size), y.ravel(), z.ravel()], axis=-1)
    first = np.cross(a.normal, np.eye(3)[np.argmin(np.abs(a.normal))])
    first = first / np.linalg.norm(first)
    for angle in np.arange(TURNS) * 2 * np.pi / TURNS:
        approach = np.cos(angle) * first + np.sin(angle) * np.cross(a.normal, first)
        for place in places:
            T_obj_grasp = frame(a.normal, approach, place)
            X = pad @ T_obj_grasp[:3, :3].T + place
            touching = a.has(X + 0.5 * width * a.normal) & b.has(X - 0.5 * width * a.normal)
            if touching.mean() >= LEAST_CONTACT:
                yield Candidate(T_obj_grasp, width, float(touching.mean()), (a.face, b.face))


def on_cylinder(face: HoldableFace, jaw: Jaw) -> Iterator[Candidate]:
    """Grasps across a cylinder, coming from its side or along its axis. A pad touches it in a line."""
    width = 2.0 * face.radius
    if not _within(width, jaw):
        return
    along = (face.points - face.centre) @ face.axis
    step = 0.5 * max(jaw.finger_width, jaw.pad_length)
    positions = np.linspace(along.min(), along.max(), int(np.ceil(np.ptp(along) / step)) + 1)
    e1 = np.cross(face.axis, np.eye(3)[np.argmin(np.abs(face.axis))])
    e1 = e1 / np.linalg.norm(e1)
    e2 = np.cross(face.axis, e1)
    for angle in np.arange(CYLINDER_TURNS) * np.pi / CYLINDER_TURNS:
        closing = np.cos(angle) * e1 + np.sin(angle) * e2
        aside = np.cross(face.axis, closing)
        for approach, side in ((aside, jaw.finger_width), (-aside, jaw.finger_width),
                               (face.axis, jaw.pad_length), (-face.axis, jaw.pad_length)):  # fmt: skip
            line = np.linspace(-0.5, 0.5, 2 * PAD_SAMPLES)[:, None] * side * face.axis
            for s in positions:
                place = face.centre + s * face.axis
                ends = [face.has(place + line + sign * face.radius * closing) for sign in (1, -1)]
                touching = float((ends[0] & ends[1]).mean())
                if touching >= LEAST_CONTACT:
                    yield Candidate(frame(closing, approach, place), width, touching, (face.face,))


def _within(width: float, jaw: Jaw) -> bool:
    """Whether the jaw can open wider than the part, and close on it."""
    return max(jaw.opening_min, 0.0) < width <= jaw.opening_max - 2 * jaw.open_by


def opening_in_words(jaw: Jaw) -> str:
    return f"{jaw.opening_min:g} to {jaw.opening_max - 2 * jaw.open_by:g} mm"


