"""Where a surface ends in the image on the way from one window pixel to the next: a walk over its triangles.

Between two pixels that see different surfaces runs the rim of the nearer one. From the nearer pixel the way leads
across the edges of triangles until one faces away: that edge is the rim, to rounding. Rays would find it by halving the
way, less exactly.

The depth that goes with it is that a little inside: at the rim itself a curved surface falls away by its own size
within a pixel, and no camera sees that.
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
INSIDE = wp.constant(0.125)  # of the way, from the rim back to where its depth is taken
MOST_TRIANGLES = wp.constant(64)  # on the way: beyond them, rays are asked


@wp.func
def cross2(a: wp.vec2, b: wp.vec2) -> float:
    return a[0] * b[1] - a[1] * b[0]


@wp.func
def depth_on_edge(at: wp.vec2, p: wp.vec2, q: wp.vec2, z_p: float, z_q: float, orthographic: int) -> float:
    """z [mm] where the way crosses the edge from p to q."""
    share = wp.clamp(wp.dot(at - p, q - p) / wp.max(wp.length_sq(q - p), 1.0e-12), 0.0, 1.0)
    # what is linear in the image: inverse depth under a pinhole, depth under an orthographic camera
    if orthographic == 1:
        return (1.0 - share) * z_p + share * z_q
    return z_p * z_q / (share * z_p + (1.0 - share) * z_q)


@wp.func
def rim_between(
    vertices: wp.array(dtype=wp.vec3), corners: wp.array(dtype=int), across_edge: wp.array(dtype=int),
    normal_obj: wp.array(dtype=wp.vec3), R: wp.mat33, t: wp.vec3, camera: wp.vec4, orthographic: int, start: int,
    ua: wp.vec2, za: float, ub: wp.vec2,
):
    """(`ENDS`, `GOES_ON` to ub, or `UNKNOWN`; image point [px]; z [mm] just inside) for the surface of triangle
    `start`, which lies at depth za [mm] at ua.

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
    # two crossings, the first at least `INSIDE` before the last one, the second the next after it
    s_before = wp.float32(0.0)
    z_before = za
    s_after = wp.float32(0.0)
    z_after = za
    for _ in range(MOST_TRIANGLES):
        if leaves >= 1.0:
            return GOES_ON, ub, 0.0
        face = across_edge[3 * face + edge]
        facing = wp.dot(
            normal_obj[face], wp.where(orthographic == 1, axis_obj, vertices[p_corner] - camera_obj)
        )
        if facing == 0.0:
            return UNKNOWN, ua, 0.0
        s = wp.clamp(leaves, 0.0, 1.0)
        z = depth_on_edge(s * way, p, q, P[2], Q[2], orthographic)
        if s - s_after >= INSIDE:
            s_before = s_after
            z_before = z_after
            s_after = s
            z_after = z
        if facing > 0.0:
            wanted = wp.max(s - INSIDE, 0.0)
            part = wp.clamp((wanted - s_before) / wp.max(s_after - s_before, 1.0e-6), 0.0, 1.0)
            return ENDS, ua + s * way, z_before + part * (z_after - z_before)
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
