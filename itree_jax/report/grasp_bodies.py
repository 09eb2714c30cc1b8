"""The gripper at the best grasp of each part, as outlines: what it holds stays to be seen."""

import numpy as np
import trimesh

from itree_jax.grasp import Grasp, Grasps
from itree_jax.grasp.body import pieces
from itree_jax.report.body import Body
from itree_jax.report.markup import number
from itree_jax.report.palette import BLACK


def grasp_bodies(grasps: Grasps) -> list[Body]:
    """The pieces of the gripper at the best grasp of every part that has one; the very best is named."""
    best: dict[int, Grasp] = {}
    for grasp in grasps.grasps:
        best.setdefault(grasp.detection, grasp)
    bodies = []
    for rank, (part, grasp) in enumerate(best.items()):
        note = f"score {number(grasp.score, 2)} · {number(grasp.clearance)} mm free · {grasp.reason}"
        for piece in pieces(grasps.gripper, grasp.width):
            if piece.arrives:  # the others are the space that closing takes
                mesh = trimesh.convex.convex_hull(piece.X_grip)
                label = "best grasp" if rank == 0 and piece.name == "palm" else ""
                name = f"grasp of pose {part}, {piece.name}"
                bodies.append(Body("grasp", name, note, mesh, np.asarray(grasp.T_cam_grasp), BLACK, 0.0, label))
    return bodies
