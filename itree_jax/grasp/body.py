"""The space that a gripper takes: convex pieces, and the space they sweep on a straight approach."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import trimesh
from jaxtyping import Float
from trimesh.collision import CollisionManager

from itree_jax.grasp.gripper import Gripper, Jaw
from itree_jax.world.dodecagon import around

TOUCH = 0.5  # [mm]: what is nearer than this to a pad or to the cup's rim touches it; smaller than any finger opens
CIRCLE = np.array([[np.cos(a), np.sin(a)] for a in np.linspace(0, 2 * np.pi, 48, endpoint=False)])


class Piece(NamedTuple):
    """One convex piece of a gripper, in its frame."""

    name: str  # "finger +x", "palm", ...
    X_grip: Float[np.ndarray, "corners 3"]  # [mm]
    arrives: bool  # it comes along the approach; False: it moves at the grasp only, when the jaw closes


def pieces(gripper: Gripper, width: float) -> tuple[Piece, ...]:
    """The gripper at its grasp on a part `width` [mm] between the pads (0 for a cup), the jaw still open.

    "closing" pieces are the space that the fingers pass when they close, up to `TOUCH` before the part.
    """
    tool, (palm_x, palm_y, palm_z) = gripper.tool, np.asarray(gripper.palm)
    if isinstance(tool, Jaw):
        tip, root = 0.5 * tool.pad_length, 0.5 * tool.pad_length - tool.finger_length
        y = 0.5 * tool.finger_width
        inner = 0.5 * width + tool.open_by
        outer = inner + tool.finger_thickness
        found = [Piece("finger +x", _box((inner, -y, root), (outer, y, tip)), True),
                 Piece("finger -x", _box((-outer, -y, root), (-inner, y, tip)), True),
                 Piece("closing +x", _box((0.5 * width + TOUCH, -y, root), (outer, y, tip)), False),
                 Piece("closing -x", _box((-outer, -y, root), (-0.5 * width - TOUCH, y, tip)), False)]  # fmt: skip
    else:
        neck, root = -tool.length, -tool.length - tool.stem_length
        found = [Piece("cup", _rod(tool.diameter, neck, -TOUCH), True),
                 Piece("stem", _rod(tool.stem_diameter, root, neck), True)]  # fmt: skip
    palm = _box((-palm_x / 2, -palm_y / 2, root - palm_z), (palm_x / 2, palm_y / 2, root))
    return (*found, Piece("palm", palm, True))


def swept(piece: Piece, distance: float) -> Float[np.ndarray, "corners 3"]:
    """Points whose hull is what a piece sweeps on the last `distance` [mm] of the approach: exact for convex pieces."""
    if not piece.arrives:
        return piece.X_grip
    return np.concatenate([piece.X_grip, piece.X_grip - np.array([0.0, 0.0, distance])])


class GripperBody:
    """What a gripper sweeps, ready to be asked whether it collides."""

    def __init__(self, gripper: Gripper, width: float):
        self.manager = CollisionManager()
        self.meshes = {p.name: trimesh.convex.convex_hull(swept(p, gripper.distance)) for p in pieces(gripper, width)}
        for name, mesh in self.meshes.items():
            self.manager.add_object(name, mesh)

    def at(self, T: Float[np.ndarray, "4 4"]) -> CollisionManager:
        """The body at a grasp pose."""
        for name in self.meshes:
            self.manager.set_transform(name, T)
        return self.manager


@lru_cache(maxsize=256)
def gripper_body(gripper: Gripper, width: float) -> GripperBody:
    """The body for a width [mm]; grasps of one width share it."""
    return GripperBody(gripper, width)


def _box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Float[np.ndarray, "8 3"]:
    bounds = np.array([low, high], float)
    corner = np.array(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij")).reshape(3, -1).T
    return np.take_along_axis(bounds, corner, axis=0)


def _rod(diameter: float, z0: float, z1: float) -> Float[np.ndarray, "24 3"]:
    """A dodecagon around a circle, from z0 to z1."""
    outline = around(0.5 * diameter * CIRCLE, 0.0)
    return np.concatenate([np.column_stack([outline, np.full(len(outline), z)]) for z in (z0, z1)])
