"""Where a surface ends in the image on the way from one window pixel to the next: a walk over its triangles.

Between two pixels that see different surfaces runs the rim of the nearer one. From the nearer pixel the way leads
across the edges of triangles until one faces away: that edge is the rim, to rounding. Rays would find it by halving the
way, half a microsecond each.
"""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

import warp as wp

from itree_kernels.rays import image_point

ENDS = wp.constant(1)
GOES_ON = wp.constant(0)
UNKNOWN = wp.constant(-1)
MOST_TRIANGLES = wp.constant(64)  # on the way: beyond them, rays are asked


@wp.func
def cross2(a: wp.vec2, b: wp.vec2) -> float:
    return a[0] * b[1] - a[1] * b[0]


@wp.func
def rim_between(
    vertices: wp.array(dtype=wp.vec3), corners: wp.array(dtype=int), across_edge: wp.array(dtype=int),
    normal_obj: wp.array(dtype=wp.vec3), R: wp.mat33, t: wp.vec3, camera: wp.vec4, orthographic: int, start: int,
    ua: wp.vec2, ub: wp.vec2,
):
    """(`ENDS`, `GOES_ON` to ub, or `UNKNOWN`; image point [px]; z [mm]) for the surface of triangle `start` at ua.

    Of a closed mesh: `across_edge[3 f + k]` is the triangle beyond the edge from corner k of triangle f.
    """
    way = ub - ua
    axis_obj = wp.transpose(R) * wp.vec3(0.0, 0.0, 1.0)
    camera_obj = -(wp.transpose(R) * t)
    # the edge from P to Q, by which the way leaves a triangle; images p and q, seen from ua
    p_corner = corners[3 * start]
    q_corner = corners[3 * start + 1]
    c_corner = corners[3 * start + 2]
    P = R * vertices[p_corner] + t
    Q = R * vertices[q_corner] + t
    C = R * vertices[c_corner] + t
    p = image_point(P, camera, orthographic) - ua
    q = image_point(Q, camera, orthographic) - ua
    c = image_point(C, camera, orthographic) - ua
    turned = wp.sign(cross2(q - p, c - p))
    edge = wp.int32(-1)
    leaves = wp.float32(2.0)
    for k in range(3):
        e = wp.where(k == 0, p, wp.where(k == 1, q, c))
        along = wp.where(k == 0, q, wp.where(k == 1, c, p)) - e
        outward = turned * cross2(way, along)
        if outward > 0.0:
            s = turned * cross2(e, along) / outward
            if s < leaves:
                leaves = s
                edge = k
    if edge < 0:
        return UNKNOWN, ua, 0.0
    if edge == 1:
        first = P
        P = Q
        Q = C
        C = first
    elif edge == 2:
        first = P
        P = C
        C = Q
        Q = first
    p_corner = corners[3 * start + edge]
    q_corner = corners[3 * start + (edge + 1) % 3]
    p = image_point(P, camera, orthographic) - ua
    q = image_point(Q, camera, orthographic) - ua
    per_length = 1.0 / wp.length_sq(way)
    face = start
    for _ in range(MOST_TRIANGLES):
        if leaves >= 1.0:
            return GOES_ON, ub, 0.0
        face = across_edge[3 * face + edge]
        facing = wp.dot(
            normal_obj[face], wp.where(orthographic == 1, axis_obj, vertices[p_corner] - camera_obj)
        )
        if facing == 0.0:
            return UNKNOWN, ua, 0.0
        if facing > 0.0:
            at = wp.clamp(leaves, 0.0, 1.0) * way
            share = wp.clamp(wp.dot(at - p, q - p) / wp.max(wp.length_sq(q - p), 1.0e-12), 0.0, 1.0)
            # what is linear in the image: inverse depth under a pinhole, depth under an orthographic camera
            z = (1.0 - share) * P[2] + share * Q[2]
            if orthographic == 0:
                z = P[2] * Q[2] / (share * P[2] + (1.0 - share) * Q[2])
            return ENDS, ua + at, z
        # of the triangle beyond, Q -> P -> C, the way leaves by the edge whose ends lie on either side of it
        third = wp.int32(2)
        for k in range(2):
            if corners[3 * face + k] != p_corner and corners[3 * face + k] != q_corner:
                third = k
        c_corner = corners[3 * face + third]
        C = R * vertices[c_corner] + t
        c = image_point(C, camera, orthographic) - ua
        if (cross2(way, c) > 0.0) == (cross2(way, p) > 0.0):
            edge = third  # C -> Q
            P = C
            p = c
            p_corner = c_corner
        else:
            edge = (third + 2) % 3  # P -> C
            Q = C
            q = c
            q_corner = c_corner
        side_p = cross2(way, p)
        apart = side_p - cross2(way, q)
        if apart == 0.0:
            return UNKNOWN, ua, 0.0
        leaves = wp.dot(p + (side_p / apart) * (q - p), way) * per_length
    return UNKNOWN, ua, 0.0
