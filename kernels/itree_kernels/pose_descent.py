"""All steps of a pose under one camera by one thread: what a CPU does in one launch, a GPU in five a step.

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


@wp.kernel(enable_backward=False)
def descent_kernel(
    # In:
    rays: Casting,
    maps: SceneMaps,
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
    seen: WindowArrays,
    projected: wp.array(dtype=wp.vec3),
    sums: RowSums,
):
    h = first + wp.tid()
    for k in range(gates.shape[0]):
        if moving[h] == 1:
            follow_pose(
                R_cam_obj[h], t_cam_obj[h], R_camera_first[0], wp.vec3(), rays.camera, rays.orthographic, reach,
                wp.where(k == 0, -1.0, farthest), h, R_cam_obj, t_cam_obj, seen,
            )
            if seen.stale[h] == 1:
                cast_window(rays, seen, projected, h)
            for i in range(seen.depth.shape[1]):
                sum_row(
                    R_cam_obj[h], t_cam_obj[h], seen, rays.normals_obj, maps, rays.camera, rays.orthographic, gates[k],
                    0, h, i, sums,
                )
            move_pose(
                sums, spreads, R_camera_first, rays.camera, rays.orthographic, reach, rest[k], h, R_cam_obj, t_cam_obj,
                moving,
            )


def in_one_launch(by: Sequence[SeenBy], device: str) -> bool:
    """Whether `descend` may be asked: on a CPU, for the single camera in whose frame the poses are."""
    return device == "cpu" and len(by) == 1


def gates_on_device(gates: Sequence[Any], rest: Sequence[float], device: str) -> tuple[wp.array, wp.array]:
    """Those of every step, and how little [px] a pose's rim moves by that has come to rest."""
    return wp.array(list(gates), dtype=Gates, device=device), wp.array(list(rest), dtype=float, device=device)


def descend(
    pose: MovedPoses, seen: Windows, rays: Rays, cast: Any, by: SeenBy, gates: wp.array, rest: wp.array, spreads: Any,
    R_camera_first: wp.array, farthest: float, first: int, last: int, sums: Any,
) -> None:
    """Moves poses first .. last - 1 by a step for each of the `gates`, as `follow`, `Rays.cast`, `sum_rows` and `step`
    do it one after the other. `cast`: what `rays` are for these windows (`Rays.into`); `farthest` [window px].
    """
    wp.launch(
        descent_kernel, dim=last - first,
        inputs=[
            cast, by.maps, gates, rest, spreads, R_camera_first, rays.reach, farthest * seen.stride, first,
        ],
        outputs=[pose.R_cam_obj, pose.t_cam_obj, pose.moving, seen.arrays, room_for_vertices(rays.mesh), sums],
        device=seen.device,
    )  # fmt: skip
