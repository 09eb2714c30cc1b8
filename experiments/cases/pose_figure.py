"""Figures 6d, 7e, 8g without the world model: the obtained pose on the image, and its error."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from cases.highest_region import HIGHEST
from cases.recognised import Recognised
from itree_jax.detections import Detection
from itree_jax.evaluation.pose_errors import Pose, pose_errors
from itree_jax.report.markup import count_of, figure, image, number, table
from itree_jax.report.palette import ORANGE
from itree_jax.report.pose_pictures import Outlined, overlay
from itree_jax.report.pose_render import render_pose
from itree_jax.report.scene_figures import SLACK, in_front, overlay_figure
from itree_jax.report.scene_pictures import scaled
from itree_jax.report.truth_view import finite_set
from itree_jax.sensing.scene_writer import TrueObject
from itree_jax.tree.tree import InterpretationTree

FIGURE = {1: "6d", 2: "7e", 3: "8g"}
SHOWN_WIDTH = 1280  # [px]
RIGHT = 0.05  # of the diameter (MSSD), as `itree evaluate` has it


@dataclass(frozen=True)
class PoseError:
    mssd: float  # [mm]
    rotation: float  # [rad]
    translation: float  # [mm]


def pose_error(tree: InterpretationTree, answer: Detection, truth: TrueObject) -> PoseError:
    vertices = np.asarray(tree.part.vertices, float)
    errors = pose_errors(
        Pose(answer.R_cam_obj[None], answer.t_cam_obj[None]),
        Pose(np.asarray(truth.R_cam_obj, float)[None], np.asarray(truth.t_cam_obj, float)[None]),
        vertices[ConvexHull(vertices).vertices], finite_set(tree.symmetries),
    )  # fmt: skip
    return PoseError(*(float(e[0]) for e in errors))


def pose_figures(r: Recognised) -> str:
    return answer_figure(r) + overlay_figure(r.view)


def answer_figure(r: Recognised) -> str:
    """The pose that explains the highest region, beside the true one."""
    title = f"{FIGURE[r.case.number]} · Obtained attitude and position"
    if r.answer is None:
        return figure('<p class="empty">No pose explains the highest region.</p>', title)
    view, truth = r.view, r.measured.case_scene.target
    shown = view.poses[int(view.region_pose[HIGHEST])]
    camera, mesh = r.measured.scene.sensor.camera, view.meshes[r.tree.obj_id]
    scale = SHOWN_WIDTH / camera.width
    pose = render_pose(mesh, r.answer.R_cam_obj, r.answer.t_cam_obj, camera, scale)
    true = render_pose(mesh, truth.R_cam_obj, truth.t_cam_obj, camera, scale)
    assert pose is not None
    lines = [Outlined(pose, str(r.answer.offer_rank), ORANGE, SLACK * shown.allowed.depth)]
    picture = overlay(scaled(view.background, scale), lines, in_front(view), [true] if true is not None else [])
    caption = "The answer for the highest region (orange) and the true pose (dashed white)."
    return figure(image(picture, "obtained pose on the image"), title, caption)


def error_table(r: Recognised) -> str:
    """Pose and its error against the truth."""
    if r.answer is None:
        return ""
    a, error = r.answer, pose_error(r.tree, r.answer, r.measured.case_scene.target)
    std = a.rotation_std if a.rotation_std is not None else np.full(3, np.nan)
    std_t = a.translation_std if a.translation_std is not None else np.full(3, np.nan)
    true_found = sum(k >= 0 for k in r.view.comparison.found) if r.view.comparison else 0
    rows = [
        ["rotation error", f"{number(np.degrees(error.rotation), 3)}°",
         f"claimed ± {number(np.degrees(np.linalg.norm(std)), 3)}°"],
        ["position error", f"{number(error.translation, 3)} mm", f"claimed ± {number(np.linalg.norm(std_t), 3)} mm"],
        ["largest displacement of a surface point (MSSD)", f"{number(error.mssd, 3)} mm",
         f"right under {number(RIGHT * r.tree.part.diameter, 1)} mm"],
        ["score", number(a.score, 2), f"order for picking: {a.offer_rank}"],
        ["whole scene", count_of(len(r.detections), "pose"), f"{true_found} of {len(r.view.truth)} true poses found"],
    ]  # fmt: skip
    return table(["highest region", "", ""], rows, numeric=(1,))
