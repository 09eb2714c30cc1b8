"""Where a suction cup can hold a part: planes that its disk fits on, and cylinders flat enough for its lip."""

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

from itree_jax.grasp.candidate import Candidate, frame
from itree_jax.grasp.gripper import Cup
from itree_jax.grasp.surface import HoldableFace, thinned

RIM_SAMPLES = 16
EDGE = 1.0  # [mm] that the rim stays from the face's edge: a pose's error, and a lip that spreads
PLACES = 0.5  # of the diameter: distance between neighbouring grasps


def cup_candidates(faces: Sequence[HoldableFace], cup: Cup) -> Iterator[Candidate]:
    """All places where the whole rim lies on one face; the part itself may still be in the gripper's way."""
    for face in faces:
        if face.kind == "plane":
            yield from on_plane(face, cup)
        elif sagitta(face.radius, cup.diameter) <= cup.lip:
            yield from on_cylinder(face, cup)


def sagitta(radius: float, diameter: float) -> float:
    """How far [mm] a cylinder falls away under the rim of a cup that touches it; infinite for a thinner one."""
    half = 0.5 * diameter
    return radius - float(np.sqrt(radius**2 - half**2)) if radius > half else float("inf")


def on_plane(face: HoldableFace, cup: Cup) -> Iterator[Candidate]:
    across = np.cross(face.normal, np.eye(3)[np.argmin(np.abs(face.normal))])
    across = across / np.linalg.norm(across)
    rim = _rim(cup) @ np.stack([across, np.cross(face.normal, across)])
    for place in thinned(face.points, PLACES * cup.diameter):
        if face.has(place + rim).all():
            yield Candidate(frame(across, -face.normal, place), 0.0, 1.0, (face.face,))


def on_cylinder(face: HoldableFace, cup: Cup) -> Iterator[Candidate]:
    """The rim is laid on the surface: its part across the axis as an angle."""
    for place in thinned(face.points, PLACES * cup.diameter):
        offset = place - face.centre
        s = float(offset @ face.axis)
        radial = offset - s * face.axis
        radial = radial / np.linalg.norm(radial)
        beside = np.cross(face.axis, radial)
        along, across = _rim(cup).T
        turn = np.arcsin(np.clip(across / face.radius, -1.0, 1.0))
        rim = (s + along)[:, None] * face.axis + face.radius * (
            np.cos(turn)[:, None] * radial + np.sin(turn)[:, None] * beside
        )
        if face.has(face.centre + rim).all():
            on_surface = face.centre + s * face.axis + face.radius * radial
            yield Candidate(frame(face.axis, -radial, on_surface), 0.0, 1.0, (face.face,))


def _rim(cup: Cup) -> Float[np.ndarray, "samples 2"]:
    """Points on the rim, on a circle half as wide, and the middle [mm]."""
    angle = np.arange(RIM_SAMPLES) * 2 * np.pi / RIM_SAMPLES
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    radius = 0.5 * cup.diameter + EDGE
    return np.concatenate([radius * circle, 0.5 * radius * circle, np.zeros((1, 2))])
