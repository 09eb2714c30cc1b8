"""Gauss-Newton on SE(3) for a batch of hypotheses, on the kernels: rays, normal equations, steps.

Rays are cast where a pose starts and wherever its rim has moved by a window pixel since; between, the surface points
that they met are projected into the image. All hypotheses go through all steps without the host looking at them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from itree_kernels.camera import Camera
from itree_kernels.mesh import RayMesh
from itree_kernels.pose_descent import descend, descent_kernel, gates_on_device, in_one_launch, view_of
from itree_kernels.pose_equations import MovedPoses, equations_kernel, gates_of, row_sums, sum_rows
from itree_kernels.pose_step import follow, spreads_of, step, step_kernel
from itree_kernels.scene_maps import SeenBy
from itree_kernels.threads import launch_in_chunks
from itree_kernels.warp_start import load_kernel
from itree_kernels.windows import Rays, Windows, windows
from jaxtyping import Float

from itree_jax.kept_functions import on_device
from itree_jax.refinement.information import SmoothSurface
from itree_jax.refinement.observed import ObservedMaps, seen_by
from itree_jax.refinement.residuals import Deviations
from itree_jax.sensing.needle import Array

TRIANGLE_BATCH = 4096  # so that parts of like size share what is compiled
REST = 0.01  # [px] that a pose's rim moves in a step: what is left of the way is no longer than twice that (tested)
CHUNKS = 2  # of the windows for each thread: with more, launching takes longer than waiting for the last one
SLIDES = 0.5  # [px] of its rim: a pose that a step moves so far is drawn along a face by its end, with no end in sight
FARTHEST = 1.0  # [window px] that a pose's rim may move before rays are cast again


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
    rough: bool = False  # coarse triangles, and contours halfway between window pixels: for rough poses


def padded_normals(normal_obj: Float[np.ndarray, "triangles 3"]) -> Float[Array, "padded 3"]:
    """Triangle normals with zeros up to a multiple of `TRIANGLE_BATCH`."""
    extra = -len(normal_obj) % TRIANGLE_BATCH
    return on_device(np.concatenate([normal_obj, np.zeros((extra, 3))]), np.float32)


def padded_surface(surface: SmoothSurface) -> SmoothSurface:
    """The smooth surface over the same triangles, with zeros likewise."""
    extra = -len(surface.offset) % TRIANGLE_BATCH
    bending, offset, face = (np.concatenate([a, np.zeros((extra, *a.shape[1:]), a.dtype)]) for a in surface)
    return SmoothSurface(on_device(bending, np.float32), on_device(offset, np.float32), on_device(face))


@dataclass(frozen=True, eq=False)
class OtherView:
    """What another camera saw of the same scene."""

    observed: ObservedMaps  # its needles in its own frame
    camera: Camera
    R_other_cam: Float[np.ndarray, "3 3"]  # X_other = R X_cam + t
    t_other_cam: Float[np.ndarray, "3"]  # [mm]

    @cached_property
    def seen_by(self) -> SeenBy:
        """As the kernels read it."""
        return seen_by(self.observed, self.camera, self.R_other_cam, self.t_other_cam)

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
    more: int = 0  # steps at the last gates, for poses that slide: which the step before moved by more than `SLIDES`


def window_stride(camera: Camera, reach: float, depth: float, size: int) -> int:
    """Whole pixels between window pixels, so that the part fits whatever its attitude."""
    return max(1, int(np.ceil(2.1 * reach / camera.mm_per_px(depth) / size)))


def window_origins(
    camera: Camera, t_cam_obj: Float[np.ndarray, "hypotheses 3"], size: int, stride: int
) -> Float[np.ndarray, "hypotheses 2"]:
    """Whole image points of window pixel (0, 0), the part's origin in the middle."""
    return np.round(camera.project(t_cam_obj) - 0.5 * stride * (size - 1))


def ramp(ends: tuple[float, float], step: int, steps: int) -> float:
    """Falls geometrically from the first to the last value."""
    return float(ends[0] * (ends[1] / ends[0]) ** (step / max(1, steps - 1)))


def refine(
    hypotheses: Hypotheses,
    model: RefineModel,
    observed: ObservedMaps | SeenBy,
    camera: Camera,
    deviations: Deviations,
    stages: Sequence[Stage],
    jump: float,
    others: Sequence[OtherView] = (),
    crease: float | None = None,
) -> Hypotheses:
    """Refines every hypothesis against needle map, outline and depth, in all cameras jointly.

    `jump` [mm] is the least depth step of an occluding contour; `crease` [rad]: creases are contours too, as in
    `correspondences`. Each hypothesis is refined alone: it comes out the same in whatever company.
    """
    if not any(stage.steps for stage in stages):
        raise ValueError("refine needs at least one step")
    views = [seen_by(observed, camera), *(other.seen_by for other in others)]
    R, t = (np.asarray(a, np.float32) for a in hypotheses)
    distance = float(np.median(t[:, 2]))
    for stage in (stage for stage in stages if stage.steps):
        stride = window_stride(camera, model.reach, distance, stage.size)
        R, t = _refine_stage(R, t, model, views, deviations, stage, stride, jump, crease)
    return Hypotheses(R, t)


def _refine_stage(
    R: Float[np.ndarray, "h 3 3"], t: Float[np.ndarray, "h 3"], model: RefineModel, views: Sequence[SeenBy],
    deviations: Deviations, stage: Stage, stride: int, jump: float, crease: float | None,
) -> tuple[Float[np.ndarray, "h 3 3"], Float[np.ndarray, "h 3"]]:
    mesh, device, count = model.mesh, model.mesh.device, len(t)
    pose = poses_on_device(R, t, device)
    there = [pose, *(replace(poses_on_device(R, t, device), moving=pose.moving) for _ in views[1:])]
    seen = [windows(R, t, np.zeros((count, 2)), stage.size, stride, device, stage.contour) for _ in views]
    rays = [Rays(mesh, by.camera, model.reach, jump if stage.contour else None, crease, model.rough) for by in views]
    sums = row_sums(len(views), count, stage.size, device)
    turns = wp.array(np.stack([by.R_camera_first for by in views]).astype(np.float32), dtype=wp.mat33, device=device)
    spreads = spreads_of(*(float(v) for v in (
        deviations.depth, deviations.depth_bias, deviations.needle, deviations.needle_bias, deviations.contour,
        deviations.contour_bias,
    )))  # fmt: skip

    gates, rest = gates_of_steps(stage, float(deviations.grazing))
    casts = [some.into(there) for some, there in zip(rays, seen, strict=True)]
    work = stage.steps * stage.size**2
    rays[0].load()

    if in_one_launch(views, device):
        kernel: Any = descent_kernel
        load_kernel(kernel, device)
        steps, farthest = gates_on_device(gates, rest, device), FARTHEST * stride
        cameras = [view_of(*one) for one in zip(views, casts, seen, there, strict=True)]

        def descend_some(first: int, last: int) -> None:
            descend(pose, cameras, rays[0], *steps, spreads, turns, farthest, first, last, sums)

        launch_in_chunks(descend_some, count, work, device, CHUNKS)
        return pose.R_cam_obj.numpy(), pose.t_cam_obj.numpy()

    def refine_some(first: int, last: int) -> None:
        for k in range(steps_of(stage)):
            for view, by in enumerate(views):
                follow(pose, there[view], by, seen[view], model.reach, FARTHEST if k else None, first, last)
                if any_stale(seen[view], first, last):
                    rays[view].cast(seen[view], first, last, casts[view])
                sum_rows(seen[view], there[view], by, mesh.normals_obj, gates[k], view, first, last, sums)
            step(pose, sums, spreads, turns, views[0], model.reach, rest[k], first, last)
            if not any_moving(pose, first, last):
                break

    kernels: tuple[Any, ...] = (equations_kernel, step_kernel)
    for kernel in kernels:
        load_kernel(kernel, device)
    launch_in_chunks(refine_some, count, work, device, CHUNKS)
    return pose.R_cam_obj.numpy(), pose.t_cam_obj.numpy()


def steps_of(stage: Stage) -> int:
    """Of a pose that slides."""
    return stage.steps + stage.more


def gates_of_steps(stage: Stage, grazing: float) -> tuple[list[Any], list[float]]:
    """Of every step: its gates, and how little [px] a pose's rim moves by that has come to rest: none does while gates
    fall.
    """
    ends = stage.depth_gate, stage.needle_gate, stage.contour_gate
    gates = [[ramp(gate, min(k, stage.steps - 1), stage.steps) for gate in ends] for k in range(steps_of(stage))]
    at_last = [float(last) for _, last in ends]
    rest = [REST if gate == at_last else 0.0 for gate in gates]
    if stage.more:
        rest[stage.steps - 1 :] = [SLIDES] * (stage.more + 1)
    return [gates_of(depth, needle, contour, grazing) for depth, needle, contour in gates], rest


def poses_on_device(R: Float[np.ndarray, "h 3 3"], t: Float[np.ndarray, "h 3"], device: str) -> MovedPoses:
    """Copies that the kernels may change."""
    return MovedPoses(
        wp.array(R, dtype=wp.mat33, device=device), wp.array(t, dtype=wp.vec3, device=device),
        wp.ones(len(t), dtype=int, device=device),
    )  # fmt: skip


def any_stale(seen: Windows, first: int, last: int) -> bool:
    """Whether there is anything to cast. On a GPU it costs less to launch than to ask."""
    return seen.device != "cpu" or bool(seen.stale.numpy()[first:last].any())


def any_moving(pose: MovedPoses, first: int, last: int) -> bool:
    """Whether there is anything to move, likewise."""
    return str(pose.moving.device) != "cpu" or bool(pose.moving.numpy()[first:last].any())


def cast_in(
    camera: Camera, R: Float[np.ndarray, "h 3 3"], t: Float[np.ndarray, "h 3"], model: RefineModel, size: int,
    stride: int, jump: float | None, read: Callable[[Windows, int, int], None], *kernels: Any,
    crease: float | None = None,
) -> Windows:
    """Casts windows of poses that are told in a camera's frame, and has each of them read as soon as it is cast."""
    device = model.mesh.device
    seen = windows(R, t, window_origins(camera, t, size, stride), size, stride, device, jump is not None)
    rays = Rays(model.mesh, camera, model.reach, jump, crease, model.rough)
    how = rays.into(seen)

    def cast_some(first: int, last: int) -> None:
        rays.cast(seen, first, last, how)
        read(seen, first, last)

    rays.load()
    for kernel in kernels:
        load_kernel(kernel, device)
    launch_in_chunks(cast_some, len(t), size**2, device, CHUNKS)
    return seen
