"""Self-calibration: the lights refined together with the poses of recognised parts.

A recognised part is a calibration target: its pose tells the normal of every pixel that it shows. Robust photometric
residuals (`light_equations`) over poses, lights and albedo, and depth and contour over the poses (`pose_terms`), are
minimised together by Gauss-Newton. What no image can tell, and how it is settled:

- the scale of lights times albedo: the mean intensity of the lights stays what was told;
- a turn of everything together: only depth and contour hold it, and without a depth map nothing does (it then stays
  nearest to what was told, and is reported as not observed);
- whatever else the parts' normals leave open: likewise.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Float

from itree_jax.detections import Detections
from itree_jax.prepared import Prepared
from itree_jax.refinement.joint_equations import (
    JointEquations,
    Layout,
    photometric_part,
    prior_hessian,
    solved,
)
from itree_jax.refinement.light_equations import LightEquations, LitPixels, ModelErrors, light_equations
from itree_jax.refinement.lit_pixels import PixelTable, PlacedPart, Sighted, lit_pixels, reflections, sighted
from itree_jax.refinement.pose_terms import PoseTerms, pose_equations, pose_terms
from itree_jax.refinement.schedule import NOISE_SIGMAS
from itree_jax.refinement.so3 import move
from itree_jax.refinement.unobserved import unobserved_directions
from itree_jax.sensing.regions import depth_noise
from itree_jax.sensor import Sensor

STEPS = 8  # lights are linear in the model: two or three steps do it, and the gate shrinks over the others
FIRST_GATE = 0.2  # of full albedo: lights that are off by 5 degrees and 10 % still fit
LAST_GATE = 0.06  # twice the 3 % that reflected light adds to most pixels of rendered bins
PIXEL_ERROR = 0.01  # of full albedo: texture and raster of one pixel
MOST_BIAS = 0.017  # a light that turns by 1 degree changes a pixel by less: what hides it cannot correct it
LEAST_BIAS = 0.005  # of full albedo, shared by a patch: no paint is more even
ENOUGH_PIXELS = 30.0  # of a patch: the mean of their noise is then less than `LEAST_BIAS`
PART_BATCH, PATCH_BATCH = 8, 128  # numbers of parts and patches are rounded up, so that few shapes are compiled
BEST_PARTS = 12  # more parts tell little more


class NothingLit(ItreeError):
    """The parts show no pixel that a light reaches."""


@dataclass(frozen=True)
class SelfCalibration:
    """What recognised parts say about the lights."""

    told: Sensor
    sensor: Sensor  # with the corrected lights, or as told where they are not `kept`
    kept: bool  # it explains the pixels better that it was not fitted on, and the surfaces are Lambertian enough
    light_directions: Float[np.ndarray, "lights 3"]  # as corrected, unit
    light_intensities: Float[np.ndarray, "lights"]  # as corrected; their mean is the told one
    direction_std: Float[np.ndarray, "lights"]  # [rad] rms of the two angles
    intensity_std: Float[np.ndarray, "lights"]  # relative
    residual_before: float  # of held-out pixels, lights as told: mean robust loss, 0 none .. 1 beyond the gate
    residual_after: float  # ... lights as fitted on the other pixels
    albedo: tuple[float, ...]  # of each kind of part, under lights of the told mean intensity
    parts: tuple[PlacedPart, ...]  # at their corrected poses
    reflected: float  # light that the parts send one another, beside that of parts of reflectance 0.5
    patch_bias: float  # spread of patches about the model, of full albedo: reflected light, gloss
    pixels: int  # compared, over all lights
    unobserved: tuple[str, ...]  # what the parts could not tell, in words

    @property
    def direction_change(self) -> Float[np.ndarray, "lights"]:
        """Angle [rad] between a light as told and as corrected."""
        chord = np.linalg.norm(self.light_directions - self.told.light_directions, axis=1)
        return 2.0 * np.arcsin(np.clip(chord / 2.0, 0.0, 1.0))

    @property
    def intensity_change(self) -> Float[np.ndarray, "lights"]:
        """Relative change of a light's intensity."""
        return self.light_intensities / self.told.light_intensities - 1.0


@dataclass(frozen=True)
class Estimate:
    """Where the iteration stands."""

    parts: tuple[PlacedPart, ...]
    lights: Float[np.ndarray, "lights 3"]  # direction times intensity
    albedo: Float[np.ndarray, "kinds"]
    moved: Float[np.ndarray, "size"]  # all steps so far, for the priors
    reflected: float  # c of `light_equations`
    patch_bias: float  # what the residuals of patches show, relative to full albedo
    covariance: Float[np.ndarray, "size size"] | None = None


def self_calibrate(
    parts: Sequence[PlacedPart], images: Float[np.ndarray, "lights height width"], sensor: Sensor,
    depth: Float[np.ndarray, "height width"] | None = None,
) -> SelfCalibration:
    """Corrected lights from parts at their recognised poses.

    Args:
        parts: one or more recognised parts; three that lie differently make all directions observable.
        images: linear intensities, 1.0 = full scale.
        sensor: its lights are the ones to correct, by some degrees and some percent.
        depth: z [mm], 0 = none; it holds the poses.

    The correction is fitted on one colour of a checkerboard of 8 px and kept if it explains the other colour better
    than the lights as told, with poses and albedo fitted in both cases; then it is fitted on all pixels. Neighbouring
    squares share reflected light and gloss, which the lights would follow; so it is not kept either where the patches
    are off by more than `MOST_BIAS`: such surfaces need another model before they can calibrate lights.

    Raises ItreeError if no part shows a lit pixel, no parts are given, or the lights are near ones.
    """
    if sensor.light_positions is not None:
        raise ItreeError("self-calibration corrects distant lights only; calibrate near ones with `calibrate-lights`")
    if not parts:
        raise ItreeError("self-calibration needs at least one recognised part; recognise some, or calibrate the lights")
    terms = None if depth is None else pose_terms(np.asarray(depth, np.float32), sensor, parts[0].model.diameter)
    seen = sighted(images, depth, sensor, _allowed(depth, sensor))
    start = _start(parts, seen, sensor)
    # the lights are off by little, and so is what is reflected of them
    seen = replace(seen, reflected=reflections(parts, start.lights, seen.camera))
    as_told = _fitted(start, seen, terms, sensor, lights_free=False, even=True)
    on_half = _fitted(start, seen, terms, sensor, lights_free=True, even=True)
    before, after = (_loss(estimate, seen, even=False) for estimate in (as_told, on_half))
    final = _fitted(start, seen, terms, sensor, lights_free=True, even=None)
    return _described(final, seen, sensor, before, after)


def calibrated_by_answers(
    detections: Detections, trees: Sequence[Prepared], images: Float[np.ndarray, "lights height width"],
    sensor: Sensor, depth: Float[np.ndarray, "height width"] | None = None, least_score: float = 0.5,
) -> SelfCalibration | None:
    """`self_calibrate` on what `recognize` answered: the best answers that are more likely right than not.

    `trees` are those that answered. None if no answer has a score of `least_score`, or those that have show no pixel
    that a light reaches.
    """
    by_object = {one.tree.obj_id: one for one in trees}
    sure = [d for d in detections.by_score if d.score >= least_score and d.obj_id in by_object][:BEST_PARTS]
    kinds = {obj_id: k for k, obj_id in enumerate(dict.fromkeys(d.obj_id for d in sure))}
    parts = [
        PlacedPart(
            by_object[d.obj_id].model, *by_object[d.obj_id].about_middle(d.R_cam_obj, d.t_cam_obj), kinds[d.obj_id],
            tuple(by_object[d.obj_id].symmetries.continuous),
        )
        for d in sure
    ]  # fmt: skip
    try:
        return self_calibrate(parts, images, sensor, depth) if parts else None
    except NothingLit:
        return None


def _allowed(depth: np.ndarray | None, sensor: Sensor) -> float:
    """[mm] between rendered and measured depth: four sigma of noise and a pixel of the raster."""
    noise = 0.0 if depth is None else depth_noise(depth, depth > 0)
    return NOISE_SIGMAS * noise + sensor.mm_per_px


def _told_lights(sensor: Sensor) -> Float[np.ndarray, "lights 3"]:
    return np.asarray(sensor.light_directions, float) * np.asarray(sensor.light_intensities, float)[:, None]


def _start(parts: Sequence[PlacedPart], seen: Sighted, sensor: Sensor) -> Estimate:
    """Lights as told, and of each kind of part the median albedo that they give."""
    lights, kinds = _told_lights(sensor), 1 + max(part.kind for part in parts)
    pixels = lit_pixels(seen, parts, lights).pixels
    if not pixels.used.any():
        raise NothingLit(
            "self-calibration: no recognised part shows a pixel that a light reaches; are the poses those of this "
            "scene, and the images in the order of the lights?"
        )
    shading = pixels.normal @ lights.T
    kind_of = np.array([part.kind for part in parts])[pixels.part]
    albedo = np.ones(kinds)
    for kind in range(kinds):
        of_kind = pixels.used & (kind_of == kind)[:, None]
        if of_kind.any():
            albedo[kind] = np.median(pixels.intensity[of_kind] / shading[of_kind])
    size = Layout(len(parts), len(lights), kinds).size
    return Estimate(tuple(parts), lights, albedo, np.zeros(size), 0.0, FIRST_GATE / NOISE_SIGMAS)


def _fitted(
    estimate: Estimate, seen: Sighted, terms: PoseTerms | None, sensor: Sensor, *, lights_free: bool, even: bool | None
) -> Estimate:
    """Gauss-Newton steps on the even squares of the checkerboard, the odd ones, or all.

    The gate shrinks, but not below what the residuals of patches ask for, whose spread becomes the weight of patches.
    """
    layout = Layout(len(estimate.parts), len(estimate.lights), len(estimate.albedo))
    for step in range(STEPS):
        gate = FIRST_GATE * (LAST_GATE / FIRST_GATE) ** (step / (STEPS - 1))
        gate = min(max(gate, NOISE_SIGMAS * estimate.patch_bias), FIRST_GATE)
        blocks = _blocks(estimate, lit_pixels(seen, estimate.parts, estimate.lights), gate, even)
        equations = photometric_part(layout, blocks, [part.kind for part in estimate.parts])
        H, gradient = equations.hessian, equations.gradient
        if terms is not None:
            for k, of_pose in enumerate(pose_equations(terms, estimate.parts)):
                H[layout.pose(k), layout.pose(k)] += np.asarray(of_pose.hessian, float)
                gradient[layout.pose(k)] += np.asarray(of_pose.gradient, float)
        prior = prior_hessian(layout, estimate.parts, _told_lights(sensor), lights_free)
        total = JointEquations(H + prior, gradient + prior @ estimate.moved)
        step_taken, covariance = solved(layout, total, estimate.lights)
        fitted = layout.kinds + 1 + (3 * layout.lights if lights_free else 0)
        estimate = replace(_moved(estimate, layout, step_taken, covariance), patch_bias=patch_bias(blocks, fitted))
    return estimate


def patch_bias(blocks: LightEquations, fitted: int) -> float:
    """Spread of the patches' mean residuals, relative to full albedo, when `fitted` unknowns were taken from them."""
    weight, residual = np.asarray(blocks.patch_weight, float), np.asarray(blocks.patch_residual, float)
    enough = weight >= ENOUGH_PIXELS
    free = int(enough.sum()) - fitted
    if free < 1:
        return FIRST_GATE / NOISE_SIGMAS
    return float(np.clip(np.sqrt(np.sum(residual[enough] ** 2) / free), LEAST_BIAS, FIRST_GATE / NOISE_SIGMAS))


def _blocks(estimate: Estimate, table: PixelTable, gate: float, even: bool | None) -> LightEquations:
    pixels: LitPixels = table.pixels if even is None else table.half(even)
    parts = -(-len(estimate.parts) // PART_BATCH) * PART_BATCH
    patches = -(-max(table.patches, 1) // PATCH_BATCH) * PATCH_BATCH
    albedo = np.ones(parts, np.float32)
    albedo[: len(estimate.parts)] = estimate.albedo[[part.kind for part in estimate.parts]]
    errors = ModelErrors(jnp.float32(PIXEL_ERROR), jnp.float32(estimate.patch_bias), jnp.float32(gate))
    return light_equations(
        pixels, jnp.asarray(estimate.lights, jnp.float32), albedo, jnp.float32(estimate.reflected), errors, parts,
        patches,
    )  # fmt: skip


def _moved(
    estimate: Estimate, layout: Layout, step: Float[np.ndarray, "size"], covariance: Float[np.ndarray, "size size"]
) -> Estimate:
    parts = []
    for k, part in enumerate(estimate.parts):
        twist = jnp.asarray(step[layout.pose(k)], jnp.float32)
        R, t = move(jnp.asarray(part.R_cam_obj, jnp.float32), jnp.asarray(part.t_cam_obj, jnp.float32), twist)
        parts.append(replace(part, R_cam_obj=np.asarray(R, float), t_cam_obj=np.asarray(t, float)))
    lights = estimate.lights + step[layout.all_lights].reshape(-1, 3)
    return Estimate(
        tuple(parts), lights, estimate.albedo * np.exp(step[layout.albedos]), estimate.moved + step,
        estimate.reflected + float(step[layout.reflected]), estimate.patch_bias, covariance,
    )  # fmt: skip


def _loss(estimate: Estimate, seen: Sighted, *, even: bool) -> float:
    """Mean of Tukey's loss over the pixels of one colour."""
    blocks = _blocks(estimate, lit_pixels(seen, estimate.parts, estimate.lights), LAST_GATE, even)
    return float(np.sum(blocks.loss) / max(float(np.sum(blocks.count)), 1.0))


def _described(
    estimate: Estimate, seen: Sighted, told: Sensor, before: float, after: float
) -> SelfCalibration:
    layout = Layout(len(estimate.parts), len(estimate.lights), len(estimate.albedo))
    assert estimate.covariance is not None
    covariance = estimate.covariance[layout.all_lights, layout.all_lights]
    # the gauge was held to first order; the rest is rounding
    strength = np.linalg.norm(estimate.lights, axis=1)
    mean = float(np.mean(told.light_intensities) / strength.mean())
    directions, intensities = estimate.lights / strength[:, None], strength * mean
    direction_std, intensity_std = np.zeros(layout.lights), np.zeros(layout.lights)
    for i, (l, e) in enumerate(zip(directions, strength, strict=True)):
        C = covariance[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] / e**2
        intensity_std[i] = np.sqrt(l @ C @ l)
        direction_std[i] = np.sqrt(max(np.trace(C) - l @ C @ l, 0.0) / 2.0)
    kept = after < before and estimate.patch_bias < MOST_BIAS
    corrected = replace(told, light_directions=directions, light_intensities=intensities)
    pixels = lit_pixels(seen, estimate.parts, estimate.lights).pixels
    return SelfCalibration(
        told, corrected if kept else told, kept, directions, intensities, direction_std, intensity_std, before, after,
        tuple(float(a) / mean for a in estimate.albedo), estimate.parts,
        estimate.reflected, estimate.patch_bias, int(pixels.used.sum()),
        unobserved_directions(covariance, _told_lights(told)),
    )  # fmt: skip
