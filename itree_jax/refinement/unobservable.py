"""Directions of a pose that nothing in the image measures, in words that a person understands."""

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

from itree_jax.detections import Unobservable
from itree_jax.refinement.uncertainty import FREE, LOST, Axis, RimMotions, RimUncertainty, turn_about

SAME = np.cos(np.radians(20.0)) ** 2  # share of a named motion that must be unobservable for its name to be used
AXIS_NAMES = "xyz"
Named = tuple[str, Float[np.ndarray, "6"]]  # words, unit motion of the rim


def unobservable(
    uncertain: RimUncertainty, rim: RimMotions, axes: Sequence[Axis], R_cam_obj: Float[np.ndarray, "3 3"],
    t_cam_obj: Float[np.ndarray, "3"],
) -> tuple[Unobservable, ...]:
    """What the image leaves open: motions of the part whose deviation exceeds 5 % of the diameter at the rim.

    Those that have a name come first (turns about an axis of revolution, the distance, slides and turns along the
    part's own axes); what is left of the space they span is said in numbers.
    """
    found = []
    for words, motion in named_directions(
        uncertain.vectors[:, uncertain.lost], list(named_motions(rim, axes, R_cam_obj, t_cam_obj))
    ):
        deviation = float(np.sqrt(motion @ uncertain.covariance @ motion))
        words = words or in_numbers(motion, rim, R_cam_obj)
        deviation = np.inf if deviation > 0.5 * FREE * rim.diameter else deviation
        found.append(Unobservable(unit_twist(rim.to_twist @ motion), words, deviation))
    return tuple(found)


def named_directions(Q: Float[np.ndarray, "6 k"], names: Sequence[Named]) -> Iterator[Named]:
    """An orthonormal basis of the columns of Q: along named motions where they lie in it; the rest without words."""
    for words, motion in names:
        inside = Q @ (Q.T @ motion)
        share = float(inside @ inside)
        if Q.shape[1] and share > SAME:
            inside /= np.sqrt(share)
            yield words, inside
            left = Q - np.outer(inside, inside @ Q)
            U, s, _ = np.linalg.svd(left, full_matrices=False)
            Q = U[:, s > 0.5]
    for k in range(Q.shape[1]):
        yield "", Q[:, k]


def named_motions(
    rim: RimMotions, axes: Sequence[Axis], R_cam_obj: Float[np.ndarray, "3 3"], t_cam_obj: Float[np.ndarray, "3"]
) -> Iterator[Named]:
    """Motions that people have words for, as unit motions of the rim."""
    twists: list[Named] = [
        ("turn about its axis of revolution", turn_about(R_cam_obj @ axis, R_cam_obj @ point)) for axis, point in axes
    ]
    sight = t_cam_obj + rim.middle_cam
    twists.append(("distance from the camera", np.concatenate([np.zeros(3), sight])))
    for k, name in enumerate(AXIS_NAMES):
        twists.append((f"slide along its own {name} axis", np.concatenate([np.zeros(3), R_cam_obj[:, k]])))
    for k, name in enumerate(AXIS_NAMES):
        twists.append((f"turn about its own {name} axis", turn_about(R_cam_obj[:, k], rim.middle_cam)))
    for words, twist in twists:
        motion = rim.from_twist @ twist
        yield words, motion / np.linalg.norm(motion)


def in_numbers(motion: Float[np.ndarray, "6"], rim: RimMotions, R_cam_obj: Float[np.ndarray, "3 3"]) -> str:
    """A motion as a slide, a turn or a screw, in the part's own axes."""
    turn, shift = R_cam_obj.T @ motion[:3] * 2.0 / rim.diameter, R_cam_obj.T @ motion[3:]
    rate = float(np.linalg.norm(turn))
    if rate * rim.diameter / 2.0 < 0.3 * np.linalg.norm(shift):
        return f"slide along ({direction_text(shift)}) of its own axes"
    axis = turn / rate
    along = float(axis @ shift)
    aside = np.cross(axis, shift) / rate  # from the part's middle to the line that it turns about
    words = f"turn about ({direction_text(axis)}) of its own axes"
    if np.linalg.norm(aside) > LOST * rim.diameter:
        words += f", {np.linalg.norm(aside):.1f} mm beside its middle"
    return words if abs(along) < 0.3 * np.linalg.norm(motion) else f"{words}, while sliding along it"


def direction_text(v: Float[np.ndarray, "3"]) -> str:
    v = v / np.linalg.norm(v)
    v = v * (1.0 if v[np.argmax(np.abs(v))] > 0 else -1.0)
    return ", ".join(f"{x + 0.0:.2f}" for x in np.where(np.abs(v) < 0.005, 0.0, v))


def unit_twist(twist: Float[np.ndarray, "6"]) -> Float[np.ndarray, "6"]:
    """Of a turn by 1 rad, or where it hardly turns a shift by 1 mm."""
    rate, shift = np.linalg.norm(twist[:3]), np.linalg.norm(twist[3:])
    return twist / (rate if rate > 1e-6 * shift else shift)
