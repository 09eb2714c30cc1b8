"""Where a surface ends or turns in the image on the way from one window pixel to the next: a walk over its triangles.

Between two pixels that see different surfaces runs the rim of the nearer one. From the nearer pixel the way leads
across the edges of triangles until one faces away: that edge is the rim, to rounding. Between two pixels of one surface
that turns, it is the edge where the normal changes sides. Rays would find either by halving the way, less exactly.

The depth that goes with a rim is that a little inside: at the rim itself a curved surface falls away by its own size
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
BENDS = wp.constant(2)
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


@wp.struct
class Way:
    """Where the way through the images of triangles leaves one of them; image points seen from the way's start."""

    face: int
    edge: int  # by which it leaves; -1: by none
    leaves: float  # after this share of the way
    P: wp.vec3  # the edge's ends, camera frame [mm]
    Q: wp.vec3
    p: wp.vec2  # their images
    q: wp.vec2
    p_corner: int
    q_corner: int


@wp.func
def way_out_of(
    vertices: wp.array(dtype=wp.vec3), corners: wp.array(dtype=int), R: wp.mat33, t: wp.vec3, camera: wp.vec4,
    orthographic: int, face: int, from_uv: wp.vec2, way: wp.vec2,
) -> Way:
    """Of the triangle in whose image the way starts."""
    on = Way()
    on.face = face
    p_corner = corners[3 * face]
    q_corner = corners[3 * face + 1]
    c_corner = corners[3 * face + 2]
    P = R * vertices[p_corner] + t
    Q = R * vertices[q_corner] + t
    C = R * vertices[c_corner] + t
    p = image_point(P, camera, orthographic) - from_uv
    q = image_point(Q, camera, orthographic) - from_uv
    c = image_point(C, camera, orthographic) - from_uv
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
    on.edge = edge
    on.leaves = leaves
    on.P = P
    on.Q = Q
    if edge == 1:
        on.P = Q
        on.Q = C
    elif edge == 2:
        on.P = C
        on.Q = P
    if edge >= 0:
        on.p_corner = corners[3 * face + edge]
        on.q_corner = corners[3 * face + (edge + 1) % 3]
    on.p = image_point(on.P, camera, orthographic) - from_uv
    on.q = image_point(on.Q, camera, orthographic) - from_uv
    return on


@wp.func
def way_across(
    on: Way, face: int, vertices: wp.array(dtype=wp.vec3), corners: wp.array(dtype=int), R: wp.mat33, t: wp.vec3,
    camera: wp.vec4, orthographic: int, from_uv: wp.vec2, way: wp.vec2,
) -> Way:
    """Of the triangle beyond the edge, Q -> P -> C: the way leaves it by the edge whose ends lie on either side of it.
    """
    third = wp.int32(2)
    for k in range(2):
        if corners[3 * face + k] != on.p_corner and corners[3 * face + k] != on.q_corner:
            third = k
    c_corner = corners[3 * face + third]
    C = R * vertices[c_corner] + t
    c = image_point(C, camera, orthographic) - from_uv
    on.face = face
    if (cross2(way, c) > 0.0) == (cross2(way, on.p) > 0.0):
        on.edge = third  # C -> Q
        on.P = C
        on.p = c
        on.p_corner = c_corner
    else:
        on.edge = (third + 2) % 3  # P -> C
        on.Q = C
        on.q = c
        on.q_corner = c_corner
    side_p = cross2(way, on.p)
    apart = side_p - cross2(way, on.q)
    if apart == 0.0:
        on.edge = -1
    else:
        on.leaves = wp.dot(on.p + (side_p / apart) * (on.q - on.p), way) / wp.length_sq(way)
    return on


@wp.func
def faces_away(
    on: Way, face: int, vertices: wp.array(dtype=wp.vec3), normal_obj: wp.array(dtype=wp.vec3), camera_obj: wp.vec3,
    axis_obj: wp.vec3, orthographic: int,
) -> float:
    """Positive for a triangle beyond the edge that faces away, 0 on edge."""
    return wp.dot(normal_obj[face], wp.where(orthographic == 1, axis_obj, vertices[on.p_corner] - camera_obj))


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
    on = way_out_of(vertices, corners, R, t, camera, orthographic, start, ua, way)
    # two crossings, the first at least `INSIDE` before the last one, the second the next after it
    s_before = wp.float32(0.0)
    z_before = za
    s_after = wp.float32(0.0)
    z_after = za
    for _ in range(MOST_TRIANGLES):
        if on.edge < 0:
            return UNKNOWN, ua, 0.0
        if on.leaves >= 1.0:
            return GOES_ON, ub, 0.0
        face = across_edge[3 * on.face + on.edge]
        facing = faces_away(on, face, vertices, normal_obj, camera_obj, axis_obj, orthographic)
        if facing == 0.0:
            return UNKNOWN, ua, 0.0
        s = wp.clamp(on.leaves, 0.0, 1.0)
        z = depth_on_edge(s * way, on.p, on.q, on.P[2], on.Q[2], orthographic)
        if s - s_after >= INSIDE:
            s_before = s_after
            z_before = z_after
            s_after = s
            z_after = z
        if facing > 0.0:
            wanted = wp.max(s - INSIDE, 0.0)
            part = wp.clamp((wanted - s_before) / wp.max(s_after - s_before, 1.0e-6), 0.0, 1.0)
            return ENDS, ua + s * way, z_before + part * (z_after - z_before)
        on = way_across(on, face, vertices, corners, R, t, camera, orthographic, ua, way)
    return UNKNOWN, ua, 0.0


@wp.func
def bend_between(
    vertices: wp.array(dtype=wp.vec3), corners: wp.array(dtype=int), across_edge: wp.array(dtype=int),
    normal_obj: wp.array(dtype=wp.vec3), R: wp.mat33, t: wp.vec3, camera: wp.vec4, orthographic: int, a: int, b: int,
    ua: wp.vec2, ub: wp.vec2, beside: float,
):
    """(`BENDS` or `UNKNOWN`; image point [px]; z [mm]; triangles this side and that) of the edge at which the surface
    from triangle a at ua to b at ub comes to face more as b does than as a does.

    The triangles are those that lie as much as this share of the way `beside` the edge: a rounding narrower than that
    is an edge. Of a closed mesh, see `rim_between`.
    """
    way = ub - ua
    axis_obj = wp.transpose(R) * wp.vec3(0.0, 0.0, 1.0)
    camera_obj = -(wp.transpose(R) * t)
    on = way_out_of(vertices, corners, R, t, camera, orthographic, a, ua, way)
    turn = normal_obj[b] - normal_obj[a]
    level = 0.5 * (wp.dot(turn, normal_obj[a]) + wp.dot(turn, normal_obj[b]))
    entered = wp.float32(-1.0)  # the way's last triangle; the first one reaches before its start
    # two triangles that it left before, at least `beside` one after the other
    this_side = wp.int32(a)
    latest = wp.int32(a)
    latest_entered = wp.float32(-1.0)
    latest_left = wp.float32(0.0)
    bent = wp.bool(False)
    uv = ua
    z = wp.float32(0.0)
    s_bend = wp.float32(0.0)
    for _ in range(MOST_TRIANGLES):
        if bent and on.leaves >= wp.min(s_bend + beside, 1.0):
            return BENDS, uv, z, this_side, on.face
        if on.edge < 0 or on.leaves >= 1.0:
            return UNKNOWN, ua, 0.0, a, b
        face = across_edge[3 * on.face + on.edge]
        if faces_away(on, face, vertices, normal_obj, camera_obj, axis_obj, orthographic) >= 0.0:
            return UNKNOWN, ua, 0.0, a, b
        if not bent:
            s = wp.clamp(on.leaves, 0.0, 1.0)
            if wp.dot(turn, normal_obj[face]) > level:
                bent = wp.bool(True)
                s_bend = s
                uv = ua + s * way
                z = depth_on_edge(s * way, on.p, on.q, on.P[2], on.Q[2], orthographic)
                if s - entered >= beside:
                    this_side = on.face
                elif s - latest_left >= beside or s - latest_entered >= beside:
                    this_side = latest
            elif s - latest_left >= beside:
                this_side = latest
                latest = on.face
                latest_entered = entered
                latest_left = s
            entered = s
        on = way_across(on, face, vertices, corners, R, t, camera, orthographic, ua, way)
    return UNKNOWN, ua, 0.0, a, b
