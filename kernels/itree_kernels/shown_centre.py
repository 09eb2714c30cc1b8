"""The middle of the surface that poses show in their windows."""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

import warp as wp

from itree_kernels.camera import Camera
from itree_kernels.rays import camera_vector, surface_point
from itree_kernels.windows import WindowArrays, Windows


@wp.kernel(enable_backward=False)
def centre_kernel(
    # In:
    seen: WindowArrays,
    camera: wp.vec4,
    orthographic: int,
    first: int,
    # Out:
    centre: wp.array(dtype=wp.vec3),
):
    h = first + wp.tid()
    t = seen.t_cam_obj[h]
    total = wp.vec3()
    count = wp.float32(0.0)
    for i in range(seen.depth.shape[1]):
        depth_row = seen.depth[h, i]
        triangle_row = seen.triangle[h, i]
        v = seen.origin_uv[h][1] + seen.stride * float(i)
        for j in range(seen.depth.shape[2]):
            if triangle_row[j] >= 0:
                u = seen.origin_uv[h][0] + seen.stride * float(j)
                total += surface_point(u, v, depth_row[j], camera, orthographic) - t
                count += 1.0
    centre[h] = t + total / wp.max(count, 1.0)


def centres(count: int, device: str) -> wp.array:
    """Room for the middles of so many windows."""
    return wp.empty(count, dtype=wp.vec3, device=device)


def mean_shown(seen: Windows, camera: Camera, first: int, last: int, centre: wp.array) -> None:
    """Mean of the surface points [mm] in windows first .. last - 1, whose rays are cast; the origin where none is."""
    wp.launch(
        centre_kernel, dim=last - first,
        inputs=[
            seen.arrays, camera_vector(camera), int(camera.is_orthographic), first,
        ],
        outputs=[centre], device=seen.device,
    )  # fmt: skip
