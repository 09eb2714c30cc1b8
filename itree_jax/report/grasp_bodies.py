"""The gripper at the best grasp, as outlines: what it holds stays to be seen."""

import numpy as np
import trimesh

from itree_jax.grasp import Grasps
from itree_jax.grasp.body import pieces
from itree_jax.report.body import Body
from itree_jax.report.markup import number
from itree_jax.report.palette import BLACK


def grasp_bodies(grasps: Grasps) -> list[Body]:
    """The pieces of the gripper as it arrives at the best grasp; those of all parts would hide the scene."""
    best = grasps.best
    if best is None:
        return []
    note = f"score {number(best.score, 2)} · {number(best.clearance)} mm free · {best.reason}"
    return [
        Body(
            "grasp", f"grasp of pose {best.detection}, {piece.name}", note, trimesh.convex.convex_hull(piece.X_grip),
            np.asarray(best.T_cam_grasp), BLACK, 0.0, "best grasp" if piece.name == "palm" else "",
        )
        for piece in pieces(grasps.gripper, best.width)
        if piece.arrives  # the others are the space that closing takes
    ]
