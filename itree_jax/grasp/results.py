"""Grasps on disk: JSON, as `grasps.schema.json` says."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from itree_jax.detections import Detections
from itree_jax.grasp.plan import Grasp, Grasps
from itree_jax.results import write_json_document

GRASPS_VERSION = 1  # raised when a reader of the old one would misread the new one
SCHEMA_PATH = Path(__file__).with_name("grasps.schema.json")


def write_grasps(scenes: Iterable[tuple[Detections, Grasps]], path: str | Path) -> None:
    """Writes the grasps of every scene, best first, and the reasons where there is none. Lengths in mm.

    Raises ItreeError when the file cannot be written.
    """
    write_json_document(grasps_document([grasps_to_json(answers, grasps) for answers, grasps in scenes]), path)


def grasps_document(images: list[dict[str, Any]]) -> dict[str, Any]:
    """What `write_grasps` writes, of what `grasps_to_json` made of each image."""
    return {"version": GRASPS_VERSION, "units": {"length": "mm"}, "images": images}


def grasps_to_json(answers: Detections, grasps: Grasps) -> dict[str, Any]:
    """The grasps of one image. A part is told by its place in the order for picking, `offer_rank` of the results."""
    offered = answers.by_offer
    return {
        "scene_id": answers.scene_id, "im_id": answers.im_id, "gripper": grasps.gripper.name,
        "reason": grasps.reason,
        "grasps": [_grasp_to_json(grasp, offered[grasp.detection].obj_id) for grasp in grasps.grasps],
        "parts_without": [{"offer_rank": index, "obj_id": offered[index].obj_id, "reason": why}
                          for index, why in sorted(grasps.reasons.items())],
    }  # fmt: skip


def _grasp_to_json(grasp: Grasp, obj_id: int) -> dict[str, Any]:
    robot = None if grasp.T_robot_grasp is None else np.ravel(grasp.T_robot_grasp)
    return {
        "offer_rank": grasp.detection, "obj_id": obj_id, "score": grasp.score,
        "T_cam_grasp": np.ravel(grasp.T_cam_grasp), "T_robot_grasp": robot, "width_mm": grasp.width,
        "clearance_mm": grasp.clearance, "faces": list(grasp.candidate.faces), "reason": grasp.reason,
    }  # fmt: skip

