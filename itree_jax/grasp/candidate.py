"""One way to hold a part, in the part's own frame."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Candidate:
    """One way to hold a part."""

    T_obj_grasp: Float[np.ndarray, "4 4"]  # gripper frame -> part [mm]
    width: float  # [mm] between the pads; 0 for a cup
    contact: float  # share of the pads or of the cup's rim that touches the part
    faces: tuple[int, ...]  # component faces that are held
    lever: float = 0.0  # [mm] from the part's centre of mass to the grasp


def frame(
    closing: Float[np.ndarray, "3"], approach: Float[np.ndarray, "3"], place: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "4 4"]:
    """The pose of a gripper by its x and z axes (unit, across each other) and its origin [mm]."""
    T = np.eye(4)
    T[:3, :3] = np.stack([closing, np.cross(approach, closing), approach], axis=-1)
    T[:3, 3] = place
    return T
