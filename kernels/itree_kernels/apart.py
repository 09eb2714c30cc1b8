"""Of lists of poses, those that carry a part away from where every earlier one that is kept does."""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

import numpy as np
import warp as wp
from jaxtyping import Bool, Float, Int

from itree_kernels.threads import launch_in_chunks
from itree_kernels.warp_start import load_kernel, warp_device

POSE_WORK = 4  # rays that a pose takes as long as
ONE = wp.constant(wp.float64(1.0))
HALF = wp.constant(wp.float64(0.5))


@wp.struct
class Alike:
    """When two poses are one: symmetries of the part and how near they carry it."""

    R_turn: wp.array(dtype=wp.mat33d)
    t_turn: wp.array(dtype=wp.vec3d)  # [mm]
    round: wp.bool  # of revolution: the ends of its axis alone tell
    end_0: wp.vec3d  # [mm], model frame
    end_1: wp.vec3d
    radius: wp.float64  # [mm] of the rim
    nearly: wp.float64  # [mm]


@wp.func
def are_alike(alike: Alike, R_a: wp.mat33d, t_a: wp.vec3d, R_b: wp.mat33d, t_b: wp.vec3d) -> bool:
    """Whether a pose carries the part to within `nearly` of where another does, by any of its symmetries."""
    for k in range(alike.R_turn.shape[0]):
        t_c = R_b * alike.t_turn[k] + t_b
        if alike.round:
            R_c = R_b * alike.R_turn[k]
            apart_0 = wp.length(R_a * alike.end_0 + t_a - (R_c * alike.end_0 + t_c))
            apart_1 = wp.length(R_a * alike.end_1 + t_a - (R_c * alike.end_1 + t_c))
            if wp.max(apart_0, apart_1) < alike.nearly:
                return True
        else:
            shift = wp.length_sq(t_a - t_c)
            if shift < alike.nearly * alike.nearly:
                trace = wp.trace(wp.transpose(R_a) * (R_b * alike.R_turn[k]))
                turn = wp.acos(wp.clamp(HALF * (trace - ONE), -ONE, ONE))
                if wp.sqrt(shift) + turn * alike.radius < alike.nearly:
                    return True
    return False


@wp.kernel(enable_backward=False)
def apart_kernel(
    # In:
    R: wp.array(dtype=wp.mat33d),
    t: wp.array(dtype=wp.vec3d),
    bounds: wp.array(dtype=int),
    alike: Alike,
    most: int,
    first: int,
    # Between:
    kept: wp.array(dtype=int),
    # Out:
    keeps: wp.array(dtype=wp.bool),
):
    k = first + wp.tid()
    begin = bounds[k]
    end = bounds[k + 1]
    count = wp.int32(0)
    n = wp.int32(begin)
    while n < end and count < most:
        R_n = R[n]
        t_n = t[n]
        repeats = wp.bool(False)
        m = wp.int32(0)
        while m < count and not repeats:
            other = kept[begin + m]
            repeats = are_alike(alike, R_n, t_n, R[other], t[other])
            m += 1
        if not repeats:
            kept[begin + count] = n
            keeps[n] = True
            count += 1
        n += 1


def kept_apart(
    R_cam_obj: Float[np.ndarray, "poses 3 3"], t_cam_obj: Float[np.ndarray, "poses 3"],
    bounds: Int[np.ndarray, "lists_and_one"], turns: Float[np.ndarray, "turns 4 4"],
    axis_ends: Float[np.ndarray, "2 3"] | None, diameter: float, nearly: float, most: int,
) -> Bool[np.ndarray, "poses"]:
    """The first `most` poses of each list that don't carry the part to within `nearly` [mm] of where an earlier one
    that is kept does: shift plus turn times half the diameter, the least over the `turns` that leave the part as it is;
    of a part of revolution, whose `axis_ends` are told [mm], how far these are carried apart.

    List k is poses bounds[k] .. bounds[k + 1] - 1. Runs on the host.
    """
    device, lists = warp_device("cpu"), len(bounds) - 1

    def on_device(array: np.ndarray, kind: type, scalar: type = np.float64) -> wp.array:
        return wp.array(np.ascontiguousarray(array, scalar), dtype=kind, device=device, copy=False)

    alike = Alike()
    alike.R_turn, alike.t_turn = on_device(turns[:, :3, :3], wp.mat33d), on_device(turns[:, :3, 3], wp.vec3d)
    alike.round, alike.radius, alike.nearly = axis_ends is not None, diameter / 2.0, nearly
    alike.end_0, alike.end_1 = (wp.vec3d(*end) for end in (np.zeros((2, 3)) if axis_ends is None else axis_ends))
    keeps = np.zeros(len(t_cam_obj), bool)
    arrays = [on_device(R_cam_obj, wp.mat33d), on_device(t_cam_obj, wp.vec3d), on_device(bounds, int, np.int32)]
    between, out = wp.empty(len(keeps), dtype=int, device=device), on_device(keeps, wp.bool, bool)

    def keep_some(first: int, last: int) -> None:
        wp.launch(
            apart_kernel, dim=last - first, inputs=[*arrays, alike, most, first], outputs=[between, out], device=device
        )

    load_kernel(apart_kernel, device)
    launch_in_chunks(keep_some, lists, rays_each=POSE_WORK * len(keeps) // max(lists, 1), device=device)
    return keeps
