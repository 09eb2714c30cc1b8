"""A crop of the image around one failure: as it is, with the answered pose, and with the true one."""

from collections.abc import Mapping

import cv2
import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.mesh import RayMesh
from jaxtyping import Float

from itree_jax.evaluation.judged import JudgedScene
from itree_jax.report.palette import BLACK, ORANGE, TRUTH
from itree_jax.report.pose_pictures import Outlined, dashes, draw_creases, draw_silhouette, silhouettes
from itree_jax.report.pose_render import RenderedPose, render_pose
from itree_jax.report.scene_pictures import Picture, scaled
from quality.failures import Failure
from quality.true_view import BEHIND, TrueView

AROUND = 14  # [px] of the image around the poses
CROP_WIDTH = 320  # [px] of each panel, about
GAP = 6  # [px] between them
MOST_SCALE = 5  # times: a part 20 px wide is not made larger than a poster
Box = tuple[int, int, int, int]  # left, top, right, bottom [px]


def failure_picture(
    background: Picture, failure: Failure, judged: JudgedScene, view: TrueView, meshes: Mapping[int, RayMesh]
) -> Picture:
    """The crop side by side: as it is, with the answered pose in orange, with the true one in dashed white.

    A pose that there is none of has no panel. Contours are bold where the pose is in front of the true poses, thin
    where it would be behind one.
    """
    camera, answers, truth = judged.truth.camera, judged.answers, judged.truth
    poses = []
    if failure.answer is not None:
        k = failure.answer
        poses.append((meshes[int(answers.obj_id[k])], answers.R[k], answers.t[k], False))
    if failure.instance is not None:
        j = failure.instance
        poses.append((meshes[int(truth.obj_id[j])], truth.pose.R[j], truth.pose.t[j], True))
    shown = [render_pose(*pose, camera) for *pose, _ in poses]
    left, top, right, bottom = box_around([pose for pose in shown if pose is not None], camera)
    scale = min(MOST_SCALE, max(1.0, CROP_WIDTH / (right - left)))
    window = camera.cropped(left, top, right - left, bottom - top)
    plain = scaled(background[top:bottom, left:right], scale)
    nearest = cv2.resize(
        view.depth[top:bottom, left:right].astype(np.float32), plain.shape[1::-1], interpolation=cv2.INTER_NEAREST
    )
    panels = [plain]
    for *pose, true in poses:
        rendered = render_pose(*pose, window, scale)
        panels += [np.full((plain.shape[0], GAP, 3), 128, np.uint8), with_contour(plain, rendered, nearest, true)]
    return np.concatenate(panels, axis=1)


def with_contour(
    plain: Picture, pose: RenderedPose | None, nearest: Float[np.ndarray, "h w"], true: bool
) -> Picture:
    """A copy with the creases and the silhouette of a pose: dashed white of a true one, else orange."""
    picture = plain.copy()
    if pose is None:
        return picture
    if not true:
        draw_creases(picture, pose, ORANGE, nearest, BEHIND)
        draw_silhouette(picture, Outlined(pose, "", ORANGE, BEHIND), nearest, 2)
        return picture
    draw_creases(picture, pose, TRUTH, nearest, BEHIND)
    lines = silhouettes(pose)
    cv2.polylines(picture, lines, True, BLACK, 3, cv2.LINE_AA)
    cv2.polylines(picture, [piece for line in lines for piece in dashes(line)], False, TRUTH, 2, cv2.LINE_AA)
    return picture


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
