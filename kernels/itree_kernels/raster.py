"""Windows of poses filled triangle by triangle: what rays through their pixels would meet, faster on a CPU.

A ray finds its triangle through the hierarchy, some hundred nanoseconds each; a triangle of a machine part covers many
pixels, which cost a few nanoseconds each once it is projected. A window is one thread's, so that nothing is raced for.
"""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

import warp as wp

from itree_kernels.mesh import RayMesh
from itree_kernels.rays import image_point

TRIANGLES_PER_PIXEL = 4  # of a window: with more of them, rays are faster
SPARE = wp.constant(0.05)  # [window px] beside an edge in a row: roundings
FLAT = wp.constant(1e-6)  # [window px] by which an edge rises: what does less has no side in a row
ON_EDGE = wp.constant(1e-4)  # [window px^2] by which a pixel may lie outside of an edge: leaves no cracks
NO_AREA = wp.constant(1e-9)  # [window px^2]
FAR = wp.constant(1e30)  # [window px]


def fills(mesh: RayMesh, pixels: int) -> bool:
    """Whether windows of so many pixels are filled triangle by triangle: on a CPU, unless the mesh is too fine."""
    return mesh.device == "cpu" and len(mesh.triangles) <= TRIANGLES_PER_PIXEL * pixels


def room_for_vertices(mesh: RayMesh) -> wp.array:
    """Of vec3, for the vertices of one window. On a CPU the threads of one launch run one after the other."""
    return wp.empty(mesh.warp_mesh.points.shape[0], dtype=wp.vec3, device=mesh.device)


@wp.func
def of_rise(edge: wp.vec2) -> float:
    """1 over what an edge rises by; 0 where it has no side in a row."""
    return wp.where(wp.abs(edge[1]) < FLAT, 0.0, 1.0 / edge[1])


@wp.func
def lesser(a: float, b: float) -> float:
    """Of two numbers; `wp.min` takes three times as long, to allow for what is none."""
    return wp.where(a < b, a, b)


@wp.func
def greater(a: float, b: float) -> float:
    """The other one of the two."""
    return wp.where(a > b, a, b)


@wp.func
def bounds_beside(per_rise: float) -> wp.vec2:
    """What is added to the column in which a row meets an edge, for the least and the greatest column inside of it; far
    out where that is on the edge's other side.
    """
    return wp.vec2(wp.where(per_rise < 0.0, -SPARE, -FAR), wp.where(per_rise > 0.0, SPARE, FAR))


@wp.func
def within(near: wp.vec2, corner: wp.vec3, row: float, per_rise: float, beside: wp.vec2) -> wp.vec2:
    """Of the columns near[0] .. near[1] of a row, those on the inner side of an edge, and a little more.

    `row`: twice the area inside of the edge that its corner would have in this row; `beside`: see `bounds_beside`.
    """
    column = corner[0] + (row + ON_EDGE) * per_rise
    return wp.vec2(greater(near[0], column + beside[0]), lesser(near[1], column + beside[1]))


@wp.func
def fill_window(
    vertices: wp.array(dtype=wp.vec3), corners: wp.array(dtype=int), normal_obj: wp.array(dtype=wp.vec3), closed: int,
    R: wp.mat33, t: wp.vec3, origin: wp.vec2, camera: wp.vec4, orthographic: int, stride: float,
    projected: wp.array(dtype=wp.vec3), depth: wp.array2d(dtype=float), triangle: wp.array2d(dtype=int),
):
    """z [mm] and triangle of each pixel of a window, 0 and -1 where it shows nothing. `projected`: room for vertices.

    Loops by `while` and rows of their own: `range` and three indices cost more than what is done with a pixel.
    """
    height = depth.shape[0]
    width = depth.shape[1]
    per_stride = 1.0 / stride
    axis_obj = wp.transpose(R) * wp.vec3(0.0, 0.0, 1.0)
    camera_obj = -(wp.transpose(R) * t)
    for i in range(height):
        depth_row = depth[i]
        triangle_row = triangle[i]
        j = wp.int32(0)
        while j < width:
            depth_row[j] = 0.0
            triangle_row[j] = -1
            j += 1
    for n in range(vertices.shape[0]):
        X = R * vertices[n] + t
        at = (image_point(X, camera, orthographic) - origin) * per_stride
        # what is linear in the image: inverse depth under a pinhole, depth under an orthographic camera
        projected[n] = wp.vec3(at[0], at[1], wp.where(orthographic == 1, X[2], 1.0 / X[2]))
    for face in range(normal_obj.shape[0]):
        corner = corners[3 * face]
        visible = wp.bool(True)
        if closed == 1:  # what faces away lies behind what faces the camera
            away = wp.where(orthographic == 1, axis_obj, vertices[corner] - camera_obj)
            visible = wp.dot(normal_obj[face], away) < 0.0
        if visible:
            a = projected[corner]
            b = projected[corners[3 * face + 1]]
            c = projected[corners[3 * face + 2]]
            if orthographic == 1 or (a[2] > 0.0 and b[2] > 0.0 and c[2] > 0.0):
                left = wp.max(int(wp.ceil(lesser(lesser(a[0], b[0]), c[0]) - ON_EDGE)), 0)
                right = wp.min(int(wp.floor(greater(greater(a[0], b[0]), c[0]) + ON_EDGE)), width - 1)
                top = wp.max(int(wp.ceil(lesser(lesser(a[1], b[1]), c[1]) - ON_EDGE)), 0)
                bottom = wp.min(int(wp.floor(greater(greater(a[1], b[1]), c[1]) + ON_EDGE)), height - 1)
                ab = wp.vec2(b[0] - a[0], b[1] - a[1])
                bc = wp.vec2(c[0] - b[0], c[1] - b[1])
                ca = wp.vec2(a[0] - c[0], a[1] - c[1])
                area = ca[0] * ab[1] - ca[1] * ab[0]
                if left <= right and top <= bottom and wp.abs(area) > NO_AREA:
                    turned = wp.sign(area)
                    ab = turned * ab
                    bc = turned * bc
                    ca = turned * ca
                    per_ab = of_rise(ab)
                    per_bc = of_rise(bc)
                    per_ca = of_rise(ca)
                    beside_ab = bounds_beside(per_ab)
                    beside_bc = bounds_beside(per_bc)
                    beside_ca = bounds_beside(per_ca)
                    i = int(top)
                    while i <= bottom:
                        depth_row = depth[i]
                        triangle_row = triangle[i]
                        # of the row, what lies inside of all three edges: a sliver's box is mostly empty
                        y = float(i)
                        row_ab = ab[0] * (y - a[1])
                        row_bc = bc[0] * (y - b[1])
                        row_ca = ca[0] * (y - c[1])
                        near = wp.vec2(float(left), float(right))
                        near = within(near, a, row_ab, per_ab, beside_ab)
                        near = within(near, b, row_bc, per_bc, beside_bc)
                        near = within(near, c, row_ca, per_ca, beside_ca)
                        end = int(wp.floor(near[1]))
                        j = int(wp.ceil(near[0]))
                        while j <= end:
                            x = float(j)
                            of_a = row_bc - bc[1] * (x - b[0])
                            of_b = row_ca - ca[1] * (x - c[0])
                            of_c = row_ab - ab[1] * (x - a[0])
                            if of_a >= -ON_EDGE and of_b >= -ON_EDGE and of_c >= -ON_EDGE:
                                # beside an edge by a rounding: the edge's depth, not one beyond it
                                of_a = wp.max(of_a, 0.0)
                                of_b = wp.max(of_b, 0.0)
                                of_c = wp.max(of_c, 0.0)
                                whole = of_a + of_b + of_c
                                part = of_a * a[2] + of_b * b[2] + of_c * c[2]
                                z = wp.where(orthographic == 1, part, whole) / wp.where(orthographic == 1, whole, part)
                                if triangle_row[j] < 0 or z < depth_row[j]:
                                    depth_row[j] = z
                                    triangle_row[j] = face
                            j += 1
                        i += 1


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
    # Between:
    projected: wp.array(dtype=wp.vec3),
    # Out:
    depth_out: wp.array3d(dtype=float),
    triangle_out: wp.array3d(dtype=int),
):
    h = first + wp.tid()
    fill_window(
        vertices, corners, normal_obj, closed, R_cam_obj[h], t_cam_obj[h], origin_uv[h], camera, orthographic, stride,
        projected, depth_out[h], triangle_out[h],
    )
