"""What the 3-D views show of a world model: bodies with a colour, a name and a reason, in the camera frame."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import trimesh
from jaxtyping import Float

from itree_jax.report.palette import Rgb

Kind = Literal["part", "prism", "bin", "grasp", "camera"]
KIND_NAMES: dict[str, str] = {
    "part": "recognised parts", "prism": "unexplained regions (prisms)", "bin": "bin and floor", "grasp": "grasps",
    "camera": "axes of the camera",
}  # fmt: skip


@dataclass(frozen=True)
class Body:
    """One thing to be drawn. Bodies that share a mesh object are drawn from one copy of it."""

    kind: Kind
    name: str
    note: str  # what is said of it where it is pointed at
    mesh: trimesh.Trimesh  # [mm], in its own frame
    T_cam_body: Float[np.ndarray, "4 4"]  # translation in [mm]
    colour: Rgb
    opacity: float = 1.0  # 0: edges alone
    label: str = ""  # drawn at its middle
    link: str = ""  # into the page
    score: float | None = None  # of a recognised part

    @property
    def corners_cam(self) -> Float[np.ndarray, "8 3"]:
        """Corners [mm] of its box, camera frame."""
        corners = trimesh.bounds.corners(self.mesh.bounds)
        return corners @ self.T_cam_body[:3, :3].T + self.T_cam_body[:3, 3]


NEARER = 1.3  # than where the ball around all bodies fills the view: bins are flat, and corners of the ball empty


@dataclass(frozen=True)
class Stage:
    """Where bodies are looked at from, camera frame: so far away that the ball fills the view, and `NEARER`."""

    centre: Float[np.ndarray, "3"]  # [mm]
    radius: float  # [mm] of a ball around all that is to be seen
    up: Float[np.ndarray, "3"]  # unit: away from the floor
    toward: Float[np.ndarray, "3"]  # unit: from the centre to the viewer


def stage_of(bodies: list[Body], R_w2c: Float[np.ndarray, "3 3"] | None, tilt: float) -> Stage:
    """Looks at all bodies from the image's lower side, `tilt` [rad] above the floor.

    Up is the world's z where the scene tells it, else toward the camera.
    """
    corners = np.concatenate([b.corners_cam for b in bodies]) if bodies else np.zeros((1, 3))
    centre = (corners.min(axis=0) + corners.max(axis=0)) / 2
    radius = max(float(np.linalg.norm(corners - centre, axis=1).max()), 1.0)
    up = np.array([0.0, 0.0, -1.0]) if R_w2c is None else np.asarray(R_w2c, float)[:, 2]
    # a camera that looks level has its lower side straight down: then from where the camera is
    aside = next(a - (a @ up) * up for a in np.array([[0.0, 1, 0], [0, 0, -1]]) if abs(a @ up) < np.sqrt(0.5))
    toward = np.cos(tilt) * aside / np.linalg.norm(aside) + np.sin(tilt) * up
    return Stage(centre, radius, up, toward)
