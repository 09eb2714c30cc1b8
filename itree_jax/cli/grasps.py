"""Grasps for `itree recognize`: what lies where, and how it can be taken."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from itree_kernels.errors import ItreeError

if TYPE_CHECKING:
    from itree_jax.detections import Detections
    from itree_jax.grasp import Grasps, GraspTable, Gripper
    from itree_jax.prepared import Prepared
    from itree_jax.sensing.scene_folder import Scene


@dataclass
class GraspPlanner:
    """A gripper, where the camera stands to the robot, and the candidates of the parts met so far."""

    gripper: "Gripper"
    T_robot_cam: np.ndarray | None
    tables: "dict[int, GraspTable]" = field(default_factory=dict)

    def plan(self, scene: "Scene", found: "Detections", fitting: "list[Prepared]") -> "Grasps":
        """The grasps of a scene."""
        from itree_jax.grasp import find_grasps, grasp_tables
        from itree_jax.world import load_bin, world_model

        trees = [one.tree for one in fitting]
        self.tables |= grasp_tables([tree for tree in trees if tree.obj_id not in self.tables], self.gripper)
        world = world_model(found, trees, scene.sensor, scene.depth, scene.R_w2c, load_bin(scene))
        tables = {tree.obj_id: self.tables[tree.obj_id] for tree in trees}
        axes = {tree.obj_id: tree.symmetries.continuous for tree in trees}
        return find_grasps(world, tables, self.T_robot_cam, axes)


def check_grasp_options(gripper: str | None, hand_eye: Path | None, grasps: Path | None) -> None:
    """Raises ItreeError when only one of --gripper and --grasps is given."""
    if (gripper is None) != (grasps is None):
        raise ItreeError("--gripper and --grasps belong together: a gripper (bundled:jaw, or a TOML file) and the JSON "
                         "file to write its grasps to")  # fmt: skip
    if hand_eye is not None and grasps is None:
        raise ItreeError("--hand-eye needs --gripper and --grasps: it turns grasps into the robot's frame")


def grasp_planner(gripper: str, hand_eye: Path | None) -> GraspPlanner:
    """Raises ItreeError about the gripper's file or the hand-eye transform's."""
    from itree_jax.grasp import load_gripper
    from itree_jax.sensing.capture import read_pose

    T_robot_cam = None
    if hand_eye is not None:
        pose = read_pose(hand_eye)
        T_robot_cam = np.eye(4)
        T_robot_cam[:3, :3], T_robot_cam[:3, 3] = pose.R, pose.t
    return GraspPlanner(load_gripper(gripper), T_robot_cam)
