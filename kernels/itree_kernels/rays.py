"""The ray of a pixel, shared by the kernels. Its direction has z = 1 in the camera frame, so its parameter is depth."""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

import warp as wp

from itree_kernels.camera import Camera


def camera_vector(camera: Camera) -> wp.vec4:
    """(fx, fy, cx, cy), as the kernels take it."""
    return wp.vec4(camera.fx, camera.fy, camera.cx, camera.cy)


@wp.func
def ray_origin(u: float, v: float, camera: wp.vec4, orthographic: int) -> wp.vec3:
    if orthographic == 1:
        return wp.vec3((u - camera[2]) / camera[0], (v - camera[3]) / camera[1], 0.0)
    return wp.vec3(0.0, 0.0, 0.0)


@wp.func
def ray_direction(u: float, v: float, camera: wp.vec4, orthographic: int) -> wp.vec3:
    if orthographic == 1:
        return wp.vec3(0.0, 0.0, 1.0)
    return wp.vec3((u - camera[2]) / camera[0], (v - camera[3]) / camera[1], 1.0)


@wp.func
def depth_before_sphere(
    origin: wp.vec3, direction: wp.vec3, centre: wp.vec3, radius: float, orthographic: int
) -> float:
    """Depth at which a ray reaches the front of a bounding sphere: starting there keeps float32 distances small.

    An orthographic camera may stand anywhere along z; a pinhole sees nothing behind itself.
    """
    length = wp.length(direction)
    start = (wp.dot(centre - origin, direction) / length - 1.01 * radius) / length
    if orthographic == 1:
        return start
    return wp.max(start, 0.0)


@wp.func
def image_point(X: wp.vec3, camera: wp.vec4, orthographic: int) -> wp.vec2:
    """(u, v) [px] of a point [mm] in the camera frame."""
    scale = wp.where(orthographic == 1, 1.0, X[2])
    return wp.vec2(camera[0] * X[0] / scale + camera[2], camera[1] * X[1] / scale + camera[3])


@wp.func
def surface_point(u: float, v: float, z: float, camera: wp.vec4, orthographic: int) -> wp.vec3:
    """The point [mm] at depth z [mm] on a pixel's ray."""
    return ray_origin(u, v, camera, orthographic) + z * ray_direction(u, v, camera, orthographic)
