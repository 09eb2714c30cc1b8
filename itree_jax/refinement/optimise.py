"""Gauss-Newton on SE(3) for a batch of hypotheses: rays on the kernels, normal equations in one compiled step."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.correspond import Correspondences, correspondences
from itree_kernels.mesh import RayMesh
from jaxtyping import Bool, Float, Int

from itree_jax.refinement.information import SmoothSurface
from itree_jax.refinement.observed import CameraArrays, ObservedMaps, camera_arrays
from itree_jax.refinement.residuals import Deviations, NormalEquations, Predicted, total_equations
from itree_jax.sensing.needle import Array

DAMPING = 1e-6  # of the Hessian's mean diagonal (lengths scaled by the part's size): keeps free directions in place
SMALLEST_BATCH, BATCH = 16, 128
LARGE_WINDOW, LARGE_BATCH = 48, 32  # few hypotheses reach the large windows, and padding costs most there
LARGEST_WINDOW, LEAST_BATCH = 128, 8  # ... and at the image's own resolution there are the answers alone
TRIANGLE_BATCH = 4096  # so that parts of like size share what is compiled


class Hypotheses(NamedTuple):
    """A batch of poses. `R_cam_obj` and `t_cam_obj` [mm] take model points to the camera frame."""

    R_cam_obj: Float[np.ndarray, "hypotheses 3 3"]
    t_cam_obj: Float[np.ndarray, "hypotheses 3"]


@dataclass(frozen=True)
class RefineModel:
    """What refinement needs of one part."""

    mesh: RayMesh
    normal_obj: Float[Array, "triangles 3"]  # zeros pad it to a multiple of TRIANGLE_BATCH
    reach: float  # largest distance of a point from the part's origin [mm]
    diameter: float  # [mm]
    surface: SmoothSurface | None = None  # what the triangles stand for, padded likewise; None: themselves


def padded_normals(normal_obj: Float[np.ndarray, "triangles 3"]) -> Float[Array, "padded 3"]:
    """Triangle normals with zeros up to a multiple of `TRIANGLE_BATCH`."""
    extra = -len(normal_obj) % TRIANGLE_BATCH
    return jnp.asarray(np.concatenate([normal_obj, np.zeros((extra, 3))]), jnp.float32)


def padded_surface(surface: SmoothSurface) -> SmoothSurface:
    """The smooth surface over the same triangles, with zeros likewise."""
    extra = -len(surface.offset) % TRIANGLE_BATCH
    bending, offset, face = (np.concatenate([a, np.zeros((extra, *a.shape[1:]), a.dtype)]) for a in surface)
    return SmoothSurface(jnp.asarray(bending, jnp.float32), jnp.asarray(offset, jnp.float32), jnp.asarray(face))


@dataclass(frozen=True, eq=False)
class OtherView:
    """What another camera saw of the same scene."""

    observed: ObservedMaps  # its needles in its own frame
    camera: Camera
    R_other_cam: Float[np.ndarray, "3 3"]  # X_other = R X_cam + t
    t_other_cam: Float[np.ndarray, "3"]  # [mm]

    def poses(self, R: Float[np.ndarray, "h 3 3"], t: Float[np.ndarray, "h 3"]) -> tuple[np.ndarray, np.ndarray]:
        """Poses in the frame of this camera."""
        R_other, t_other = self.R_other_cam @ R, t @ self.R_other_cam.T + self.t_other_cam
        return R_other.astype(np.float32), t_other.astype(np.float32)


@dataclass(frozen=True)
class Stage:
    """Some steps at one resolution. Gates are in [mm], [rad], [px] at the first and the last step."""

    steps: int
    size: int  # window pixels per side
    depth_gate: tuple[float, float]
    needle_gate: tuple[float, float]
    contour_gate: tuple[float, float]
    contour: bool = True  # False: no contours are looked for, which halves the time of a rough stage


def batch_of(size: int) -> int:
    """Hypotheses that a compiled function takes at once, with windows of `size` pixels per side."""
    return LEAST_BATCH if size >= LARGEST_WINDOW else LARGE_BATCH if size >= LARGE_WINDOW else BATCH


def batch_size(count: int, size: int) -> int:
    """`SMALLEST_BATCH`, or a multiple of the batch: compiled functions see batches of these two sizes only."""
    batch = batch_of(size)
    return SMALLEST_BATCH if count <= SMALLEST_BATCH < batch else -(-count // batch) * batch


def in_batches(function: Callable[..., Any], size: int, *arrays: Any) -> Any:
    """Calls a compiled function on slices of its arguments (trees of arrays with one leading axis, padded to a batch
    size) and joins what it returns, as NumPy arrays. One shape is compiled, and memory stays that of one batch.
    """
    count = len(jax.tree.leaves(arrays)[0])
    step = min(count, batch_of(size))
    parts = []
    for k in range(0, count, step):
        some = jax.tree.map(lambda a, k=k: a[k : k + step], arrays)
        parts.append(jax.tree.map(np.asarray, function(*some)))
    return jax.tree.map(lambda *p: np.concatenate(p), *parts) if len(parts) > 1 else parts[0]


def padded(hypotheses: Hypotheses, size: int) -> Hypotheses:
    """Repeats the last pose up to a batch size."""
    extra = batch_size(len(hypotheses.t_cam_obj), size) - len(hypotheses.t_cam_obj)
    return Hypotheses(*(np.concatenate([a, np.repeat(a[-1:], extra, axis=0)]).astype(np.float32) for a in hypotheses))


def window_stride(camera: Camera, reach: float, depth: float, size: int) -> int:
    """Whole pixels between window pixels, so that the part fits whatever its attitude."""
    return max(1, int(np.ceil(2.1 * reach / camera.mm_per_px(depth) / size)))


def window_origins(
    camera: Camera, t_cam_obj: Float[np.ndarray, "hypotheses 3"], size: int, stride: int
) -> Float[np.ndarray, "hypotheses 2"]:
    """Whole image points of window pixel (0, 0), the part's origin in the middle."""
    return np.round(camera.project(t_cam_obj) - 0.5 * stride * (size - 1))


def so3_exp(omega: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """Rodrigues' formula, smooth at 0."""
    squared = jnp.sum(omega**2)
    small = squared < 1e-8
    angle = jnp.sqrt(jnp.where(small, 1.0, squared))
    a = jnp.where(small, 1.0 - squared / 6.0, jnp.sin(angle) / angle)
    b = jnp.where(small, 0.5 - squared / 24.0, (1.0 - jnp.cos(angle)) / (angle * angle))
    x, y, z = omega
    zero = jnp.zeros_like(x)
    K = jnp.stack([jnp.stack([zero, -z, y]), jnp.stack([z, zero, -x]), jnp.stack([-y, x, zero])])
    return jnp.eye(3, dtype=omega.dtype) + a * K + b * (K @ K)


def move(
    R_cam_obj: Float[Array, "3 3"], t_cam_obj: Float[Array, "3"], twist: Float[Array, "6"]
) -> tuple[Float[Array, "3 3"], Float[Array, "3"]]:
    """Applies a twist (omega, v) in the camera frame about the part's origin."""
    return so3_exp(twist[:3]) @ R_cam_obj, t_cam_obj + twist[3:]


def newton_twist(equations: NormalEquations, reach: Float[Array, ""]) -> Float[Array, "6"]:
    """Solves for the twist in units in which a turn and a shift move the part's rim alike."""
    scale = jnp.concatenate([jnp.full(3, 1.0 / reach), jnp.ones(3)])
    H = equations.hessian * scale[:, None] * scale[None, :]
    g = equations.gradient * scale
    damping = DAMPING * jnp.trace(H) / 6.0 + 1e-12
    twist = -scale * jnp.linalg.solve(H + damping * jnp.eye(6), g)
    # a step of more than 20 degrees or a third of the part has left the region where correspondences mean anything
    turn = jnp.linalg.norm(twist[:3])
    shift = jnp.linalg.norm(twist[3:])
    shrink = jnp.minimum(1.0, jnp.minimum(0.35 / (turn + 1e-9), 0.33 * reach / (shift + 1e-9)))
    return jnp.where(jnp.isfinite(twist).all(), shrink * twist, 0.0)


@partial(jax.jit, static_argnames=("size",))
def gauss_newton_step(
    R_cam_obj: Float[Array, "hypotheses 3 3"],
    t_cam_obj: Float[Array, "hypotheses 3"],
    predicted: Predicted,
    observed: ObservedMaps,
    normal_obj: Float[Array, "triangles 3"],
    reach: Float[Array, ""],
    camera: CameraArrays,
    deviations: Deviations,
    stride: Int[Array, ""],
    size: int,
    elsewhere: NormalEquations | None = None,
    surface: SmoothSurface | None = None,
    last: Bool[Array, ""] | bool = True,
) -> tuple[Float[Array, "hypotheses 3 3"], Float[Array, "hypotheses 3"], NormalEquations]:
    """One step of every hypothesis, with the normal equations it was taken from; `elsewhere`: of other cameras."""

    def one(R, t, seen, more):
        equations = total_equations(
            R, t, seen, observed, normal_obj, camera, deviations, size, stride, surface, last
        )
        if more is not None:
            equations = NormalEquations(*(a + b for a, b in zip(equations, more, strict=True)))
        R, t = move(R, t, newton_twist(equations, reach))
        return R, t, equations

    return jax.vmap(one)(R_cam_obj, t_cam_obj, predicted, elsewhere)


@partial(jax.jit, static_argnames=("size",))
def equations_elsewhere(
    R_cam_obj: Float[Array, "hypotheses 3 3"],
    t_cam_obj: Float[Array, "hypotheses 3"],
    predicted: Predicted,
    R_other_cam: Float[Array, "3 3"],
    observed: ObservedMaps,
    normal_obj: Float[Array, "triangles 3"],
    camera: CameraArrays,
    deviations: Deviations,
    stride: Int[Array, ""],
    size: int,
    surface: SmoothSurface | None = None,
    last: Bool[Array, ""] | bool = True,
) -> NormalEquations:
    """Normal equations of another camera, for twists in the frame of the first one. Poses are in the other's frame.

    A twist is about the part's origin, so that from frame to frame it only turns.
    """
    turn = jnp.zeros((6, 6)).at[:3, :3].set(R_other_cam).at[3:, 3:].set(R_other_cam)

    def one(R, t, seen):
        there = total_equations(
            R, t, seen, observed, normal_obj, camera, deviations, size, stride, surface, last
        )
        squares = (turn.T @ a @ turn for a in (there.hessian, there.information, there.spread))
        hessian, information, spread = squares
        return NormalEquations(hessian, turn.T @ there.gradient, there.cost, information, spread)

    return jax.vmap(one)(R_cam_obj, t_cam_obj, predicted)


def as_predicted(found: Correspondences, origin_uv: Float[np.ndarray, "hypotheses 2"]) -> Predicted:
    return Predicted(origin_uv.astype(np.float32), found.depth, found.triangle, found.contour_uv, found.contour_depth)


def ramp(ends: tuple[float, float], step: int, steps: int) -> float:
    """Falls geometrically from the first to the last value."""
    return float(ends[0] * (ends[1] / ends[0]) ** (step / max(1, steps - 1)))


def refine(
    hypotheses: Hypotheses,
    model: RefineModel,
    observed: ObservedMaps,
    camera: Camera,
    deviations: Deviations,
    stages: Sequence[Stage],
    jump: float,
    others: Sequence[OtherView] = (),
    crease: float | None = None,
) -> tuple[Hypotheses, NormalEquations]:
    """Refines every hypothesis against needle map, outline and depth, in all cameras jointly.

    Returns the poses and the last normal equations (for the covariance see `uncertainty.py`). `jump` [mm] is the least
    depth step of an occluding contour; `crease` [rad]: creases are contours too, as in `correspondences`.
    """
    if not any(stage.steps for stage in stages):
        raise ValueError("refine needs at least one step")
    count = len(hypotheses.t_cam_obj)
    R, t = (np.asarray(a) for a in padded(hypotheses, max(stage.size for stage in stages)))
    cam = camera_arrays(camera)
    reach = jnp.float32(model.reach)
    distance = float(np.median(t[:, 2]))
    equations = None
    for stage in stages:
        stride = window_stride(camera, model.reach, distance, stage.size)
        for step in range(stage.steps):
            origin = window_origins(camera, t, stage.size, stride)
            edges = jump if stage.contour else None
            found = correspondences(
                model.mesh, R, t, camera, origin, stage.size, stride, model.reach, edges, crease
            )
            now = deviations._replace(
                depth_gate=jnp.float32(ramp(stage.depth_gate, step, stage.steps)),
                needle_gate=jnp.float32(ramp(stage.needle_gate, step, stage.steps)),
                contour_gate=jnp.float32(ramp(stage.contour_gate, step, stage.steps)),
            )
            last = jnp.asarray(step == stage.steps - 1)
            more = [
                _elsewhere(view, R, t, model, now, stage, stride, edges, crease, last) for view in others
            ]
            elsewhere = jax.tree.map(lambda *parts: sum(parts), *more) if more else None
            step_of = partial(
                gauss_newton_step, observed=observed, normal_obj=model.normal_obj, reach=reach, camera=cam,
                deviations=now, stride=jnp.int32(stride), size=stage.size, last=last,
                surface=model.surface if stage.contour else None,
            )

            def one_step(R, t, seen, more, step_of=step_of):
                return step_of(R, t, seen, elsewhere=more)

            R, t, equations = in_batches(one_step, stage.size, R, t, as_predicted(found, origin), elsewhere)
    assert equations is not None
    return Hypotheses(R[:count], t[:count]), NormalEquations(*(np.asarray(e)[:count] for e in equations))


def _elsewhere(
    view: OtherView, R: np.ndarray, t: np.ndarray, model: RefineModel, deviations: Deviations, stage: Stage,
    stride: int, edges: float | None, crease: float | None, last: Bool[Array, ""],
) -> NormalEquations:
    R_other, t_other = view.poses(R, t)
    origin = window_origins(view.camera, t_other, stage.size, stride)
    found = correspondences(
        model.mesh, R_other, t_other, view.camera, origin, stage.size, stride, model.reach, edges, crease
    )
    equations_of = partial(
        equations_elsewhere, R_other_cam=jnp.asarray(view.R_other_cam, jnp.float32), observed=view.observed,
        normal_obj=model.normal_obj, camera=camera_arrays(view.camera), deviations=deviations,
        stride=jnp.int32(stride), size=stage.size, surface=model.surface if stage.contour else None, last=last,
    )
    return in_batches(equations_of, stage.size, R_other, t_other, as_predicted(found, origin))
