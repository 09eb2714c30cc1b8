"""All steps of a pose under one camera or two by one thread: what a CPU does in one launch, a GPU in five a step and
camera.

A launch costs some ten microseconds of Python, under its lock; a step of a few small windows costs less.
"""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

from collections.abc import Sequence
from typing import Any

import warp as wp

from itree_kernels.pose_equations import Gates, MovedPoses, RowSums, sum_row
from itree_kernels.pose_step import Spreads, follow_pose, move_pose
from itree_kernels.raster import room_for_vertices
from itree_kernels.scene_maps import SceneMaps, SeenBy
from itree_kernels.windows import Casting, Rays, WindowArrays, Windows, cast_window

MOST_CAMERAS = 2


@wp.struct
class View:
    """A camera: how rays are cast for it, what it saw, and the windows and poses in its frame."""

    rays: Casting
    maps: SceneMaps
    seen: WindowArrays
    R_camera_first: wp.mat33
    t_camera_first: wp.vec3
    R_view_obj: wp.array(dtype=wp.mat33)
    t_view_obj: wp.array(dtype=wp.vec3)


@wp.func
def sum_view(
    view: View, number: int, gates: Gates, reach: float, farthest: float, h: int, R_cam_obj: wp.array(dtype=wp.mat33),
    t_cam_obj: wp.array(dtype=wp.vec3), projected: wp.array(dtype=wp.vec3), sums: RowSums,
):
    """The sums of a pose's window as a camera sees it, rays cast again where it has moved `farthest` [px]."""
    follow_pose(
        R_cam_obj[h], t_cam_obj[h], view.R_camera_first, view.t_camera_first, view.rays.camera, view.rays.orthographic,
        reach, farthest, h, view.R_view_obj, view.t_view_obj, view.seen,
    )
    if view.seen.stale[h] == 1:
        cast_window(view.rays, view.seen, projected, h)
    for i in range(view.seen.depth.shape[1]):
        sum_row(
            view.R_view_obj[h], view.t_view_obj[h], view.seen, view.rays.normals_obj, view.maps, view.rays.camera,
            view.rays.orthographic, gates, number, h, i, sums,
        )


@wp.kernel(enable_backward=False)
def descent_kernel(
    # In:
    first_view: View,
    second_view: View,
    views: int,
    gates: wp.array(dtype=Gates),
    rest: wp.array(dtype=float),
    spreads: Spreads,
    R_camera_first: wp.array(dtype=wp.mat33),
    reach: float,
    farthest: float,
    first: int,
    # In and out:
    R_cam_obj: wp.array(dtype=wp.mat33),
    t_cam_obj: wp.array(dtype=wp.vec3),
    moving: wp.array(dtype=int),
    # Between:
    projected: wp.array(dtype=wp.vec3),
    sums: RowSums,
):
    h = first + wp.tid()
    for k in range(gates.shape[0]):
        if moving[h] == 1:
            far = wp.where(k == 0, -1.0, farthest)
            sum_view(first_view, 0, gates[k], reach, far, h, R_cam_obj, t_cam_obj, projected, sums)
            if views > 1:
                sum_view(second_view, 1, gates[k], reach, far, h, R_cam_obj, t_cam_obj, projected, sums)
            move_pose(
                sums, spreads, R_camera_first, first_view.rays.camera, first_view.rays.orthographic, reach, rest[k], h,
                R_cam_obj, t_cam_obj, moving,
            )


def in_one_launch(by: Sequence[SeenBy], device: str) -> bool:
    """Whether `descend` may be asked: on a CPU, for one camera or two; the first is that whose frame poses are in."""
    return device == "cpu" and len(by) <= MOST_CAMERAS


def gates_on_device(gates: Sequence[Any], rest: Sequence[float], device: str) -> tuple[wp.array, wp.array]:
    """Those of every step, and how little [px] a pose's rim moves by that has come to rest."""
    return wp.array(list(gates), dtype=Gates, device=device), wp.array(list(rest), dtype=float, device=device)


def view_of(by: SeenBy, cast: Any, seen: Windows, there: MovedPoses) -> Any:
    """A camera as `descend` takes it. `cast`: what rays are for these windows (`Rays.into`); `there`: room for the
    poses in its frame, the poses themselves for the first camera.
    """
    view = View()
    view.rays, view.maps, view.seen = cast, by.maps, seen.arrays
    view.R_camera_first, view.t_camera_first = wp.mat33(by.R_camera_first), wp.vec3(by.t_camera_first)
    view.R_view_obj, view.t_view_obj = there.R_cam_obj, there.t_cam_obj
    return view


def descend(
    pose: MovedPoses, views: Sequence[Any], rays: Rays, gates: wp.array, rest: wp.array, spreads: Any,
    R_camera_first: wp.array, farthest: float, first: int, last: int, sums: Any,
) -> None:
    """Moves poses first .. last - 1 by a step for each of the `gates`, as `follow`, `Rays.cast`, `sum_rows` and `step`
    do it one after the other. `views`: see `view_of`; `farthest` [px].
    """
    wp.launch(
        descent_kernel, dim=last - first,
        inputs=[
            views[0], views[-1], len(views), gates, rest, spreads, R_camera_first, rays.reach, farthest, first,
        ],
        outputs=[pose.R_cam_obj, pose.t_cam_obj, pose.moving, room_for_vertices(rays.mesh), sums],
        device=pose.moving.device,
    )  # fmt: skip
