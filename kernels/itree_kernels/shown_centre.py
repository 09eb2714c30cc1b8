"""The middle of the surface that poses show in their windows."""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

import warp as wp

from itree_kernels.camera import Camera
from itree_kernels.rays import camera_vector, surface_point
from itree_kernels.windows import Windows


@wp.kernel(enable_backward=False)
def centre_kernel(
    # In:
    t_cam_obj: wp.array(dtype=wp.vec3),
    origin_uv: wp.array(dtype=wp.vec2),
    depth: wp.array3d(dtype=float),
    triangle: wp.array3d(dtype=int),
    camera: wp.vec4,
    orthographic: int,
    stride: float,
    first: int,
    # Out:
    centre: wp.array(dtype=wp.vec3),
):
    h = first + wp.tid()
    total = wp.vec3()
    count = wp.float32(0.0)
    for i in range(depth.shape[1]):
        for j in range(depth.shape[2]):
            if triangle[h, i, j] >= 0:
                u = origin_uv[h][0] + stride * float(j)
                v = origin_uv[h][1] + stride * float(i)
                total += surface_point(u, v, depth[h, i, j], camera, orthographic) - t_cam_obj[h]
                count += 1.0
    centre[h] = t_cam_obj[h] + total / wp.max(count, 1.0)


def centres(count: int, device: str) -> wp.array:
    """Room for the middles of so many windows."""
    return wp.empty(count, dtype=wp.vec3, device=device)


def mean_shown(seen: Windows, camera: Camera, first: int, last: int, centre: wp.array) -> None:
    """Mean of the surface points [mm] in windows first .. last - 1, whose rays are cast; the origin where none is."""
    wp.launch(
        centre_kernel, dim=last - first,
        inputs=[
            seen.t_cam_obj, seen.origin_uv, seen.depth, seen.triangle, camera_vector(camera),
            int(camera.is_orthographic), float(seen.stride), first,
        ],
        outputs=[centre], device=seen.device,
    )  # fmt: skip
