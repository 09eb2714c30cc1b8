"""One Gauss-Newton step of a batch of poses on SE(3), from the sums of `pose_equations`."""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

import warp as wp

from itree_kernels.pose_equations import MovedPoses, RowSums
from itree_kernels.rays import camera_vector, image_point
from itree_kernels.scene_maps import SeenBy
from itree_kernels.windows import WindowArrays, Windows

DAMPING = wp.constant(wp.float64(1e-6))  # of the Hessian's mean diagonal (lengths scaled by the part's size): keeps
# free directions in place
LARGEST_TURN = wp.constant(0.35)  # [rad] a step of more has left the region where correspondences mean anything
LARGEST_SHIFT = wp.constant(0.33)  # of the part's reach, likewise

mat66d = wp.types.matrix(shape=(6, 6), dtype=wp.float64)
vec6d = wp.types.vector(length=6, dtype=wp.float64)


@wp.struct
class Spreads:
    """Standard deviations of one observation, and what neighbours share: a mean over N pixels whose errors share a bias
    b doesn't get better than b, so that a pixel's weight is 1 / (s^2 + N b^2).
    """

    depth: float  # [mm]
    depth_bias: float
    needle: float  # [rad]
    needle_bias: float
    contour: float  # [px]
    contour_bias: float


@wp.func
def weight_of(count: float, deviation: float, bias: float) -> float:
    return 1.0 / (deviation * deviation + count * bias * bias)


@wp.func
def so3_exp(omega: wp.vec3) -> wp.mat33:
    """Rodrigues' formula, smooth at 0."""
    squared = wp.dot(omega, omega)
    a = 1.0 - squared / 6.0
    b = 0.5 - squared / 24.0
    if squared >= 1e-8:
        angle = wp.sqrt(squared)
        a = wp.sin(angle) / angle
        b = (1.0 - wp.cos(angle)) / squared
    K = wp.skew(omega)
    return wp.identity(n=3, dtype=float) + a * K + b * (K * K)


@wp.func
def solved(H: mat66d, g: vec6d) -> vec6d:
    """x of H x = g by Cholesky; 0 where H is not positive definite."""
    L = mat66d()
    for i in range(6):
        for j in range(6):
            if j <= i:
                rest = H[i, j]
                for k in range(6):
                    if k < j:
                        rest -= L[i, k] * L[j, k]
                if i == j:
                    if not rest > wp.float64(0.0):
                        return vec6d()
                    L[i, i] = wp.sqrt(rest)
                else:
                    L[i, j] = rest / L[j, j]
    y = vec6d()
    for i in range(6):
        rest = g[i]
        for k in range(6):
            if k < i:
                rest -= L[i, k] * y[k]
        y[i] = rest / L[i, i]
    x = vec6d()
    for m in range(6):
        i = 5 - m
        rest = y[i]
        for k in range(6):
            if k > i:
                rest -= L[k, i] * x[k]
        x[i] = rest / L[i, i]
    return x


@wp.func
def in_frame(J_turn: wp.mat33) -> mat66d:
    """Takes twists of the first camera to another's: about the part's origin, they only turn."""
    B = mat66d()
    for a in range(3):
        for b in range(3):
            B[a, b] = wp.float64(J_turn[a, b])
            B[a + 3, b + 3] = wp.float64(J_turn[a, b])
    return B


@wp.func
def pixel_pitch(X: wp.vec3, camera: wp.vec4, orthographic: int) -> float:
    """What a pixel spans at a point's depth [mm]."""
    return wp.where(orthographic == 1, 1.0, wp.max(X[2], 1.0)) / wp.sqrt(camera[0] * camera[1])


@wp.func
def added(H: mat66d, g: vec6d, hessian: wp.spatial_matrix, gradient: wp.spatial_vector):
    """The sums with those of a row."""
    for a in range(6):
        g[a] += wp.float64(gradient[a])
        for b in range(6):
            H[a, b] += wp.float64(hessian[a, b])
    return H, g


@wp.func
def move_pose(
    sums: RowSums, spreads: Spreads, R_view_first: wp.array(dtype=wp.mat33), camera: wp.vec4, orthographic: int,
    reach: float, rest: float, h: int, R_cam_obj: wp.array(dtype=wp.mat33), t_cam_obj: wp.array(dtype=wp.vec3),
    moving: wp.array(dtype=int),
):
    """A pose whose rim goes by less than `rest` [px] has come to rest."""
    H = mat66d()
    g = vec6d()
    for view in range(sums.depth_count.shape[0]):
        depth_count = wp.float32(0.0)
        needle_count = wp.float32(0.0)
        contour_count = wp.float32(0.0)
        for i in range(sums.depth_count.shape[2]):
            depth_count += sums.depth_count[view, h, i]
            needle_count += sums.needle_count[view, h, i]
            contour_count += sums.contour_count[view, h, i]
        of_depth = weight_of(depth_count, spreads.depth, spreads.depth_bias)
        of_needles = weight_of(needle_count, spreads.needle, spreads.needle_bias)
        of_contour = weight_of(contour_count, spreads.contour, spreads.contour_bias)
        H_there = mat66d()
        g_there = vec6d()
        for i in range(sums.depth_count.shape[2]):
            if sums.depth_count[view, h, i] > 0.0:
                H_there, g_there = added(
                    H_there, g_there, of_depth * sums.depth_hessian[view, h, i],
                    of_depth * sums.depth_gradient[view, h, i],
                )
            if sums.contour_count[view, h, i] > 0.0:
                H_there, g_there = added(
                    H_there, g_there, of_contour * sums.contour_hessian[view, h, i],
                    of_contour * sums.contour_gradient[view, h, i],
                )
            if sums.needle_count[view, h, i] > 0.0:
                # the Jacobian of a needle n is the cross-product matrix of n, so that J^T J = I - n n^T
                outer = of_needles * sums.needle_outer[view, h, i]
                turned = of_needles * sums.needle_gradient[view, h, i]
                straight = of_needles * sums.needle_count[view, h, i]
                for a in range(3):
                    g_there[a] += wp.float64(turned[a])
                    H_there[a, a] += wp.float64(straight)
                    for b in range(3):
                        H_there[a, b] -= wp.float64(outer[a, b])
        if view == 0:
            H += H_there
            g += g_there
        else:
            B = in_frame(R_view_first[view])
            H += wp.transpose(B) * H_there * B
            g += wp.transpose(B) * g_there

    # solved in units in which a turn and a shift move the part's rim alike
    trace = wp.float64(0.0)
    per_reach = wp.float64(1.0 / reach)
    for a in range(6):
        for b in range(6):
            if a < 3:
                H[a, b] = H[a, b] * per_reach
            if b < 3:
                H[a, b] = H[a, b] * per_reach
        if a < 3:
            g[a] = g[a] * per_reach
        trace += H[a, a]
    damping = DAMPING * trace / wp.float64(6.0) + wp.float64(1e-12)
    for a in range(6):
        H[a, a] = H[a, a] + damping
    x = solved(H, g)
    omega = -wp.vec3(float(x[0] * per_reach), float(x[1] * per_reach), float(x[2] * per_reach))
    shift = -wp.vec3(float(x[3]), float(x[4]), float(x[5]))
    shrink = wp.min(LARGEST_TURN / (wp.length(omega) + 1e-9), LARGEST_SHIFT * reach / (wp.length(shift) + 1e-9))
    shrink = wp.min(shrink, 1.0)
    if wp.isfinite(wp.length(omega)) and wp.isfinite(wp.length(shift)):
        R_cam_obj[h] = so3_exp(shrink * omega) * R_cam_obj[h]
        t_cam_obj[h] = t_cam_obj[h] + shrink * shift
        moved = wp.length(shift) + reach * wp.length(omega)
        if moved < rest * pixel_pitch(t_cam_obj[h], camera, orthographic):
            moving[h] = 0


@wp.func
def follow_pose(
    R_cam_obj: wp.mat33, t_cam_obj: wp.vec3, R_view_first: wp.mat33, t_view_first: wp.vec3, camera: wp.vec4,
    orthographic: int, reach: float, farthest: float, h: int, R_view_obj: wp.array(dtype=wp.mat33),
    t_view_obj: wp.array(dtype=wp.vec3), seen: WindowArrays,
):
    """A pose in a camera's frame; where its rim has moved by more than `farthest` [px] since rays were cast, the window
    follows and is stale.
    """
    R = R_view_first * R_cam_obj
    t = R_view_first * t_cam_obj + t_view_first
    R_view_obj[h] = R
    t_view_obj[h] = t
    chord = wp.trace(wp.identity(n=3, dtype=float) - R * wp.transpose(seen.R_cam_obj[h]))  # 2 - 2 cos of the turn
    moved = wp.length(t - seen.t_cam_obj[h]) + reach * wp.sqrt(wp.max(chord, 0.0))
    if farthest < 0.0 or moved > farthest * pixel_pitch(t, camera, orthographic):
        seen.stale[h] = 1
        seen.R_cam_obj[h] = R
        seen.t_cam_obj[h] = t
        middle = image_point(t, camera, orthographic)
        half = 0.5 * seen.stride * float(seen.depth.shape[1] - 1)
        seen.origin_uv[h] = wp.vec2(wp.rint(middle[0] - half), wp.rint(middle[1] - half))
    else:
        seen.stale[h] = 0


@wp.kernel(enable_backward=False)
def step_kernel(
    # In:
    sums: RowSums,
    spreads: Spreads,
    R_view_first: wp.array(dtype=wp.mat33),
    camera: wp.vec4,
    orthographic: int,
    reach: float,
    rest: float,
    first: int,
    # In, out:
    R_cam_obj: wp.array(dtype=wp.mat33),
    t_cam_obj: wp.array(dtype=wp.vec3),
    moving: wp.array(dtype=int),
):
    """Moves the poses that move."""
    h = first + wp.tid()
    if moving[h] == 1:
        move_pose(
            sums, spreads, R_view_first, camera, orthographic, reach, rest, h, R_cam_obj, t_cam_obj, moving,
        )


@wp.kernel(enable_backward=False)
def follow_kernel(
    # In:
    R_cam_obj: wp.array(dtype=wp.mat33),
    t_cam_obj: wp.array(dtype=wp.vec3),
    R_view_first: wp.mat33,
    t_view_first: wp.vec3,
    camera: wp.vec4,
    orthographic: int,
    reach: float,
    farthest: float,
    first: int,
    # Out:
    R_view_obj: wp.array(dtype=wp.mat33),
    t_view_obj: wp.array(dtype=wp.vec3),
    seen: WindowArrays,
):
    h = first + wp.tid()
    follow_pose(
        R_cam_obj[h], t_cam_obj[h], R_view_first, t_view_first, camera, orthographic, reach, farthest, h, R_view_obj,
        t_view_obj, seen,
    )


def spreads_of(
    depth: float, depth_bias: float, needle: float, needle_bias: float, contour: float, contour_bias: float
):
    """See `Spreads`."""
    spreads = Spreads()
    spreads.depth, spreads.depth_bias = depth, depth_bias
    spreads.needle, spreads.needle_bias = needle, needle_bias
    spreads.contour, spreads.contour_bias = contour, contour_bias
    return spreads


def step(
    pose: MovedPoses, sums, spreads, R_view_first: wp.array, by: SeenBy, reach: float, rest: float, first: int,
    last: int,
) -> None:
    """Moves poses first .. last - 1, which are told in the frame of the first camera, `by`. One whose rim moves by less
    than `rest` [px] is left alone from then on.
    """
    wp.launch(
        step_kernel, dim=last - first,
        inputs=[
            sums, spreads, R_view_first, camera_vector(by.camera), int(by.camera.is_orthographic), reach, rest, first,
        ],
        outputs=[pose.R_cam_obj, pose.t_cam_obj, pose.moving], device=R_view_first.device,
    )  # fmt: skip


def follow(
    pose: MovedPoses, there: MovedPoses, by: SeenBy, seen: Windows, reach: float, farthest: float | None, first: int,
    last: int,
) -> None:
    """Tells poses first .. last - 1 in the frame of a camera, and puts windows anew over those whose rim has moved by
    more than `farthest` window pixels since rays were cast; None: over all.
    """
    wp.launch(
        follow_kernel, dim=last - first,
        inputs=[
            pose.R_cam_obj, pose.t_cam_obj, wp.mat33(by.R_camera_first), wp.vec3(by.t_camera_first),
            camera_vector(by.camera), int(by.camera.is_orthographic), reach,
            -1.0 if farthest is None else farthest * seen.stride, first,
        ],
        outputs=[there.R_cam_obj, there.t_cam_obj, seen.arrays], device=seen.device,
    )  # fmt: skip
