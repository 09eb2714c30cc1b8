"""What holds the poses of recognised parts, whatever the lights: depth and occluding contours."""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.correspond import correspondences
from jaxtyping import Float, Int

from itree_jax.refinement.lit_pixels import PlacedPart
from itree_jax.refinement.observed import CameraArrays, ObservedMaps, camera_arrays, observe
from itree_jax.refinement.optimise import window_origins, window_stride
from itree_jax.refinement.pose_information import as_predicted
from itree_jax.refinement.residuals import (
    Deviations,
    NormalEquations,
    Predicted,
    contour_equations,
    depth_equations,
    look_up,
)
from itree_jax.refinement.schedule import schedule
from itree_jax.sensing.regions import depth_noise
from itree_jax.sensor import Sensor

WINDOW = 96  # pixels per side, as of the last verification


class PoseTerms(NamedTuple):
    """The observed depth with its edges, and how far it is believed."""

    observed: ObservedMaps
    deviations: Deviations
    camera: Camera
    jump: float  # least depth step of an occluding contour [mm]


def pose_terms(depth: Float[np.ndarray, "height width"], sensor: Sensor, diameter: float) -> PoseTerms:
    """Deviations and gates are those of the last round of recognition, for parts of this diameter [mm]."""
    plan = schedule(sensor, diameter, depth_noise(depth, depth > 0), spacing=0.0)
    last = plan.rounds[-1].stage
    deviations = plan.deviations._replace(
        depth_gate=jnp.float32(last.depth_gate[1]), contour_gate=jnp.float32(last.contour_gate[1])
    )
    nothing = np.zeros((*depth.shape, 3), np.float32)
    return PoseTerms(observe(nothing, nothing[..., 0], depth, plan.jump), deviations, sensor.camera, plan.jump)


def pose_equations(terms: PoseTerms, parts: Sequence[PlacedPart]) -> list[NormalEquations]:
    """Normal equations of depth and contour of every part at its pose; twist order (omega [rad], v [mm])."""
    return [_of_one(terms, part) for part in parts]


def _of_one(terms: PoseTerms, part: PlacedPart) -> NormalEquations:
    R, t = part.R_cam_obj[None].astype(np.float32), part.t_cam_obj[None].astype(np.float32)
    model, camera = part.model, terms.camera
    stride = window_stride(camera, model.reach, float(t[0, 2]), WINDOW)
    origin = window_origins(camera, t, WINDOW, stride)
    found = correspondences(model.mesh, R, t, camera, origin, WINDOW, stride, model.reach, terms.jump)
    predicted = jax.tree.map(lambda a: a[0], as_predicted(found, origin))
    return _depth_and_contour(
        R[0], t[0], predicted, terms.observed, model.normal_obj, camera_arrays(camera), terms.deviations,
        jnp.int32(stride), WINDOW,
    )  # fmt: skip


@partial(jax.jit, static_argnames=("size",))
def _depth_and_contour(
    R_cam_obj: Float[np.ndarray, "3 3"], t_cam_obj: Float[np.ndarray, "3"], predicted: Predicted,
    observed: ObservedMaps, normal_obj: Float[jax.Array, "triangles 3"], camera: CameraArrays, deviations: Deviations,
    stride: Int[jax.Array, ""], size: int,
) -> NormalEquations:
    window = look_up(observed, predicted.origin_uv, size, stride)
    depth = depth_equations(R_cam_obj, t_cam_obj, predicted, window, normal_obj, camera, deviations)
    contour = contour_equations(t_cam_obj, predicted, observed, camera, deviations)
    return NormalEquations(*(a + b for a, b in zip(depth, contour, strict=True)))
