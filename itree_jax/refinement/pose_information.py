"""What all cameras measure of refined poses: their normal equations, with what the covariance is made of."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.correspond import Correspondences, correspondences
from jaxtyping import Float, Int

from itree_jax.batches import on_all_cores
from itree_jax.kept_functions import kept
from itree_jax.refinement.information import SmoothSurface
from itree_jax.refinement.observed import CameraArrays, ObservedMaps, camera_arrays, filled_up
from itree_jax.refinement.optimise import (
    Hypotheses,
    OtherView,
    RefineModel,
    Stage,
    window_origins,
    window_stride,
)
from itree_jax.refinement.residuals import Deviations, NormalEquations, Predicted, are_few, total_equations
from itree_jax.sensing.needle import Array

BATCH = 1  # poses that the compiled function takes at once: of more, what is computed between falls out of the cache


def equations_at(
    poses: Hypotheses, model: RefineModel, observed: ObservedMaps, camera: Camera, deviations: Deviations, stage: Stage,
    jump: float, others: Sequence[OtherView] = (), crease: float | None = None,
) -> NormalEquations:
    """Normal equations of every pose under the last gates of a stage, for twists in the frame of the first camera.

    `jump` [mm] and `crease` [rad] as in `refine`.
    """
    count = len(poses.t_cam_obj)
    extra = -count % BATCH
    R, t = (np.concatenate([a, np.repeat(a[-1:], extra, axis=0)]).astype(np.float32) for a in poses)
    deviations = deviations._replace(
        depth_gate=np.asarray(stage.depth_gate[1], np.float32),
        needle_gate=np.asarray(stage.needle_gate[1], np.float32),
        contour_gate=np.asarray(stage.contour_gate[1], np.float32),
    )
    stride = window_stride(camera, model.reach, float(np.median(t[:, 2])), stage.size)
    first = OtherView(observed, camera, np.eye(3), np.zeros(3))
    of_views = [_seen_by(view, R, t, model, deviations, stage, stride, jump, crease) for view in (first, *others)]
    total = jax.tree.map(lambda *parts: sum(parts[1:], parts[0]), *of_views)
    return NormalEquations(*(np.asarray(e)[:count] for e in total))


def _seen_by(
    view: OtherView, R: Float[np.ndarray, "h 3 3"], t: Float[np.ndarray, "h 3"], model: RefineModel,
    deviations: Deviations, stage: Stage, stride: int, jump: float, crease: float | None,
) -> NormalEquations:
    R, t = view.poses(R, t)
    origin = window_origins(view.camera, t, stage.size, stride)
    edges = jump if stage.contour else None
    found = correspondences(model.mesh, R, t, view.camera, origin, stage.size, stride, model.reach, edges, crease)
    equations_of = partial(
        equations_in_view, R_view_cam=jnp.asarray(view.R_other_cam, jnp.float32), observed=filled_up(view.observed),
        normal_obj=model.normal_obj, camera=camera_arrays(view.camera), deviations=deviations,
        stride=np.asarray(stride, np.int32), size=stage.size, surface=model.surface if stage.contour else None,
    )
    predicted = as_predicted(found, origin)

    def equations_from(first: int) -> NormalEquations:
        some = jax.tree.map(lambda a: a[first : first + BATCH], (R, t, predicted))
        few = are_few(some[2].triangle, some[2].contour_depth)
        return jax.tree.map(np.asarray, equations_of(*some, few=few))

    batches = [equations_from(0), *on_all_cores(equations_from, range(BATCH, len(t), BATCH))]  # compiled but once
    return jax.tree.map(lambda *parts: np.concatenate(parts), *batches)


@kept("size", "few")
def equations_in_view(
    R_view_obj: Float[Array, "poses 3 3"],
    t_view_obj: Float[Array, "poses 3"],
    predicted: Predicted,
    R_view_cam: Float[Array, "3 3"],
    observed: ObservedMaps,
    normal_obj: Float[Array, "triangles 3"],
    camera: CameraArrays,
    deviations: Deviations,
    stride: Int[Array, ""],
    size: int,
    surface: SmoothSurface | None = None,
    few: bool = False,
) -> NormalEquations:
    """Normal equations of one camera, for twists in the frame of the first one. Poses are in the camera's own frame.

    A twist is about the part's origin, so that from frame to frame it only turns.
    """
    turn = jnp.zeros((6, 6)).at[:3, :3].set(R_view_cam).at[3:, 3:].set(R_view_cam)

    def one(R, t, seen):
        there = total_equations(R, t, seen, observed, normal_obj, camera, deviations, size, stride, surface, few)
        squares: Any = (turn.T @ a @ turn for a in (there.hessian, there.information, there.spread))
        hessian, information, spread = squares
        return NormalEquations(hessian, turn.T @ there.gradient, there.cost, information, spread)

    return jax.vmap(one)(R_view_obj, t_view_obj, predicted)


def as_predicted(found: Correspondences, origin_uv: Float[np.ndarray, "poses 2"]) -> Predicted:
    """Ray-cast windows as the compiled functions take them."""
    return Predicted(origin_uv.astype(np.float32), found.depth, found.triangle, found.contour_uv, found.contour_depth)
