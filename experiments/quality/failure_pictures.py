"""A crop of the image around one failure: as it is, and with the answered pose beside the true one."""

import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.mesh import RayMesh

from itree_jax.evaluation.judged import JudgedScene
from itree_jax.report.palette import ORANGE
from itree_jax.report.pose_pictures import Outlined, overlay
from itree_jax.report.pose_render import RenderedPose, render_pose
from itree_jax.report.scene_pictures import Picture, scaled
from quality.failures import Failure
from quality.seen_scene import TrueView

AROUND = 14  # [px] of the image around the poses
CROP_WIDTH = 360  # [px] of each of the two pictures, about
MOST_SCALE = 5  # times: a part 20 px wide is not made larger than a poster
BEHIND = 1.5  # [mm] that something must be nearer by to hide a contour: the depth map's noise, and a pose a little off
Box = tuple[int, int, int, int]  # left, top, right, bottom [px]


def failure_picture(
    background: Picture, failure: Failure, judged: JudgedScene, view: TrueView, meshes: dict[int, RayMesh]
) -> Picture:
    """The crop twice, side by side: on the right the answered pose in orange and the true one in dashed white.

    Contours are bold where the pose is seen among the true poses, thin where it would be behind one.
    """
    camera, truth = judged.truth.camera, judged.truth
    answered = true = None
    if failure.answer is not None:
        k = failure.answer
        answered = (meshes[int(judged.answers.obj_id[k])], judged.answers.R[k], judged.answers.t[k])
    if failure.instance is not None:
        j = failure.instance
        true = (meshes[int(truth.obj_id[j])], truth.pose.R[j], truth.pose.t[j])
    shown = [render_pose(*pose, camera) for pose in (answered, true) if pose is not None]
    left, top, right, bottom = box_around([pose for pose in shown if pose is not None], camera)
    scale = min(MOST_SCALE, max(1.0, CROP_WIDTH / (right - left)))
    window = camera.cropped(left, top, right - left, bottom - top)
    plain = scaled(background[top:bottom, left:right], scale)
    answered, true = (None if pose is None else render_pose(*pose, window, scale) for pose in (answered, true))
    lines = [] if answered is None else [Outlined(answered, "answer", ORANGE, BEHIND)]
    contours = overlay(plain, lines, view.depth[top:bottom, left:right], [] if true is None else [true])
    gap = np.full((plain.shape[0], 6, 3), 128, np.uint8)
    return np.concatenate([plain, gap, contours], axis=1)


def box_around(poses: list[RenderedPose], camera: Camera) -> Box:
    """The part of the image that holds the poses; all of it without any."""
    if not poses:
        return 0, 0, camera.width, camera.height
    rows, columns = zip(*(pose.window for pose in poses), strict=True)
    return (
        max(0, min(c.start for c in columns) - AROUND), max(0, min(r.start for r in rows) - AROUND),
        min(camera.width, max(c.stop for c in columns) + AROUND),
        min(camera.height, max(r.stop for r in rows) + AROUND),
    )  # fmt: skip
