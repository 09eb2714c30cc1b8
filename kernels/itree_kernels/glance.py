"""How well rough poses agree with a scene at a glance: by points of a view near by, without casting a ray.

What a part shows hardly changes over the step of a dome of views. Of many attitudes most can be left out so: a pose
costs a hundred points that are projected, where a window costs as many rays and more.
"""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

import numpy as np
import warp as wp
from jaxtyping import Float, Int

from itree_kernels.agreement import Limits, pixel_verdict, pixels5
from itree_kernels.rays import camera_vector, image_point
from itree_kernels.scene_maps import SceneMaps, SeenBy, on_device
from itree_kernels.threads import launch_in_chunks
from itree_kernels.warp_start import load_kernel


@wp.kernel(enable_backward=False)
def glance_kernel(
    # In:
    R_cam_obj: wp.array(dtype=wp.mat33),
    t_cam_obj: wp.array(dtype=wp.vec3),
    view: wp.array(dtype=int),
    X_obj: wp.array2d(dtype=wp.vec3),
    normal_obj: wp.array2d(dtype=wp.vec3),
    maps: SceneMaps,
    camera: wp.vec4,
    orthographic: int,
    limits: Limits,
    first: int,
    # Out:
    counts: wp.array(dtype=pixels5),
):
    h = first + wp.tid()
    R = R_cam_obj[h]
    t = t_cam_obj[h]
    v = view[h]
    # how far the surface lies behind the points, where it may be theirs
    deeper = wp.float32(0.0)
    count = wp.float32(0.0)
    for s in range(X_obj.shape[1]):
        X = R * X_obj[v, s] + t
        uv = image_point(X, camera, orthographic)
        row = int(wp.rint(uv[1]))
        column = int(wp.rint(uv[0]))
        if row >= 0 and row < maps.depth.shape[0] and column >= 0 and column < maps.depth.shape[1]:
            z = maps.depth[row, column]
            if z > 0.0 and wp.abs(z - X[2]) < limits.depth:
                deeper += z - X[2]
                count += 1.0
    deeper = deeper / wp.max(count, 1.0)
    total = pixels5()
    for s in range(X_obj.shape[1]):
        X = R * X_obj[v, s] + t
        uv = image_point(X, camera, orthographic)
        total += pixel_verdict(
            maps, int(wp.rint(uv[1])), int(wp.rint(uv[0])), X[2] + deeper, R * normal_obj[v, s], limits
        )
    counts[h] = total


def glance(
    R_cam_obj: Float[np.ndarray, "h 3 3"], t_cam_obj: Float[np.ndarray, "h 3"], view: Int[np.ndarray, "h"],
    X_obj: Float[np.ndarray, "views points 3"], normal_obj: Float[np.ndarray, "views points 3"], by: SeenBy, limits,
    device: str,
) -> Float[np.ndarray, "h 5"]:
    """Of every pose: how many of its view's points [mm] agree, how closely in sum, how many by their needles, how many
    contradict, and how many are hidden; see `agreement.pixel_verdict`. Each pose is first moved along the line of sight
    to where the surface is.
    """
    floats = [np.ascontiguousarray(a, np.float32) for a in (R_cam_obj, t_cam_obj, X_obj, normal_obj)]  # kept alive here
    kinds = (wp.mat33, wp.vec3, wp.vec3, wp.vec3)
    R, t, points, normals = (on_device(a, kind, device) for a, kind in zip(floats, kinds, strict=True))
    views = np.ascontiguousarray(view, np.int32)
    which, counts = on_device(views, wp.int32, device), wp.empty(len(view), dtype=pixels5, device=device)
    load_kernel(glance_kernel, device)

    def look(first: int, last: int) -> None:
        wp.launch(
            glance_kernel, dim=last - first,
            inputs=[
                R, t, which, points, normals, by.maps, camera_vector(by.camera), int(by.camera.is_orthographic),
                limits, first,
            ],
            outputs=[counts], device=device,
        )  # fmt: skip

    launch_in_chunks(look, len(view), points.shape[1], device)
    return counts.numpy()
