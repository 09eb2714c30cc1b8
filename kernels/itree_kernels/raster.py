"""Windows of poses filled triangle by triangle: what rays through their pixels would meet, faster on a CPU.

A ray finds its triangle through the hierarchy, some hundred nanoseconds each; a triangle of a machine part covers many
pixels, which cost a few nanoseconds each once it is projected. A window is one thread's, so that nothing is raced for.
"""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

import warp as wp

from itree_kernels.rays import image_point

TRIANGLES_PER_PIXEL = 4  # of a window: with more of them, rays are faster
SPARE = wp.constant(0.05)  # [window px] beside an edge in a row: roundings
FLAT = wp.constant(1e-6)  # [window px] by which an edge rises: what does less has no side in a row
ON_EDGE = wp.constant(1e-4)  # [window px^2] by which a pixel may lie outside of an edge: leaves no cracks


@wp.func
def across(a: wp.vec2, b: wp.vec2, p: wp.vec2) -> float:
    """Twice the area of the triangle a, b, p: positive on one side of the edge, negative on the other."""
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])


@wp.func
def within(near: wp.vec2, turned: float, a: wp.vec2, b: wp.vec2, y: float) -> wp.vec2:
    """Of the columns near[0] .. near[1] of row y, those on the inner side of an edge, and a little more."""
    slope = -turned * (b[1] - a[1])
    rest = turned * ((b[0] - a[0]) * (y - a[1]) + (b[1] - a[1]) * a[0]) + ON_EDGE
    if wp.abs(slope) < FLAT:
        return near
    column = -rest / slope
    if slope > 0.0:
        return wp.vec2(wp.max(near[0], column - SPARE), near[1])
    return wp.vec2(near[0], wp.min(near[1], column + SPARE))


@wp.kernel(enable_backward=False)
def raster_kernel(
    # In:
    vertices: wp.array(dtype=wp.vec3),
    corners: wp.array(dtype=int),
    normal_obj: wp.array(dtype=wp.vec3),
    closed: int,
    R_cam_obj: wp.array(dtype=wp.mat33),
    t_cam_obj: wp.array(dtype=wp.vec3),
    origin_uv: wp.array(dtype=wp.vec2),
    camera: wp.vec4,
    orthographic: int,
    stride: float,
    first: int,
    stale: wp.array(dtype=int),
    # Out:
    depth_out: wp.array3d(dtype=float),
    triangle_out: wp.array3d(dtype=int),
):
    h = first + wp.tid()
    if stale[h] == 0:
        return
    size = depth_out.shape[1]
    R = R_cam_obj[h]
    t = t_cam_obj[h]
    origin = origin_uv[h]
    per_stride = 1.0 / stride
    axis_obj = wp.transpose(R) * wp.vec3(0.0, 0.0, 1.0)
    camera_obj = -(wp.transpose(R) * t)
    for i in range(size):
        for j in range(size):
            depth_out[h, i, j] = 0.0
            triangle_out[h, i, j] = -1
    for face in range(normal_obj.shape[0]):
        corner = vertices[corners[3 * face]]
        visible = wp.bool(True)
        if closed == 1:  # what faces away lies behind what faces the camera
            visible = wp.dot(normal_obj[face], wp.where(orthographic == 1, axis_obj, corner - camera_obj)) < 0.0
        if visible:
            A = R * corner + t
            B = R * vertices[corners[3 * face + 1]] + t
            C = R * vertices[corners[3 * face + 2]] + t
            if orthographic == 1 or (A[2] > 0.0 and B[2] > 0.0 and C[2] > 0.0):
                a = (image_point(A, camera, orthographic) - origin) * per_stride
                b = (image_point(B, camera, orthographic) - origin) * per_stride
                c = (image_point(C, camera, orthographic) - origin) * per_stride
                left = wp.max(int(wp.ceil(wp.min(wp.min(a[0], b[0]), c[0]) - ON_EDGE)), 0)
                right = wp.min(int(wp.floor(wp.max(wp.max(a[0], b[0]), c[0]) + ON_EDGE)), size - 1)
                top = wp.max(int(wp.ceil(wp.min(wp.min(a[1], b[1]), c[1]) - ON_EDGE)), 0)
                bottom = wp.min(int(wp.floor(wp.max(wp.max(a[1], b[1]), c[1]) + ON_EDGE)), size - 1)
                area = across(a, b, c)
                if left <= right and top <= bottom and wp.abs(area) > 1.0e-9:
                    # what is linear in the image: inverse depth under a pinhole, depth under an orthographic camera
                    qa = wp.where(orthographic == 1, A[2], 1.0 / A[2])
                    qb = wp.where(orthographic == 1, B[2], 1.0 / B[2])
                    qc = wp.where(orthographic == 1, C[2], 1.0 / C[2])
                    turned = wp.sign(area)
                    per_area = 1.0 / wp.abs(area)
                    for i in range(top, bottom + 1):
                        # of the row, what lies inside of all three edges: a sliver's box is mostly empty
                        y = float(i)
                        near = wp.vec2(float(left), float(right))
                        near = within(near, turned, b, c, y)
                        near = within(near, turned, c, a, y)
                        near = within(near, turned, a, b, y)
                        for j in range(int(wp.ceil(near[0])), int(wp.floor(near[1])) + 1):
                            p = wp.vec2(float(j), y)
                            of_a = turned * across(b, c, p)
                            of_b = turned * across(c, a, p)
                            of_c = turned * across(a, b, p)
                            if of_a >= -ON_EDGE and of_b >= -ON_EDGE and of_c >= -ON_EDGE:
                                q = (of_a * qa + of_b * qb + of_c * qc) * per_area
                                z = wp.where(orthographic == 1, q, 1.0 / q)
                                if triangle_out[h, i, j] < 0 or z < depth_out[h, i, j]:
                                    depth_out[h, i, j] = z
                                    triangle_out[h, i, j] = face
