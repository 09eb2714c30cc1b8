"""Whether a gripper and its approach path are free of everything in the world model (Ikeuchi 1987, figure 6e)."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from trimesh.collision import CollisionManager

from itree_jax.grasp.body import gripper_body
from itree_jax.grasp.gripper import Gripper
from itree_jax.world.meshes import WorldMesh

OPEN_SPACE = 1000.0  # [mm] of clearance where there is nothing else in the world


class Verdict(NamedTuple):
    """What one grasp meets."""

    hit: str  # what the gripper collides with, "" when it is free; of several, the one that comes first in the world
    clearance: float  # [mm] from the gripper to the nearest other thing; 0 when it collides
    near: str = ""  # the nearest other thing


class Obstacles:
    """Everything a gripper must not touch, with the part that it is to take left out on demand.

    Prisms, walls and floor are convex and solid; parts are surfaces, which a gripper that comes from outside cannot
    pass without touching them.
    """

    def __init__(self, meshes: list[WorldMesh]):
        self.meshes = {one.name: one.mesh for one in meshes}
        self.rank = {name: k for k, name in enumerate(self.meshes)}
        self.manager: Any = CollisionManager()  # its stubs know neither what it returns nor that it depends
        for name, mesh in self.meshes.items():
            self.manager.add_object(name, mesh)
        self.absent: str | None = None

    def without(self, target: str | None) -> Any:
        """The obstacles when `target` is to be taken; only one can be away at a time."""
        if self.absent is not None and self.absent != target:
            self.manager.add_object(self.absent, self.meshes[self.absent])
            self.absent = None
        if target is not None and self.absent is None:
            self.manager.remove_object(target)
            self.absent = target
        return self.manager

    def verdict(
        self, gripper: Gripper, width: float, T_cam_grasp: Float[np.ndarray, "4 4"], target: str | None = None
    ) -> Verdict:
        """Whether the gripper reaches a grasp `width` [mm] wide, coming straight along its z axis, jaw open, and can
        close there. Its whole sweep counts at once, which is exact for convex pieces on a straight path.
        """
        there = self.without(target)
        body = gripper_body(gripper, width).at(T_cam_grasp)
        if len(self.meshes) == (target is not None):
            return Verdict("", OPEN_SPACE)
        collides, pairs = there.in_collision_other(body, return_names=True)
        if collides:
            return Verdict(min((pair[0] for pair in pairs), key=self.rank.__getitem__), 0.0)
        distance, (near, _) = there.min_distance_other(body, return_names=True)
        if distance < gripper.clearance:
            return Verdict(near, 0.0)
        return Verdict("", float(distance), near)
