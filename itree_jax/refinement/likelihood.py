"""The log-likelihood of a pose, pixel by pixel: how much better it explains what was seen than if it were not there.

Counts of agreeing pixels rank rough poses. Two poses of one place that differ by a small feature are told apart by the
pixels in which they differ, at the image's own resolution, under the sensor's errors. Something else may lie at any
depth within reach and face any way; a pixel that something nearer hides says nothing; one behind the pose says that the
pose is not there.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.scene_maps import SeenBy
from itree_kernels.weighing import errors_of, room, weigh_rows, weighing_kernel
from jaxtyping import Bool, Float, Int

from itree_jax.refinement.observed import ObservedMaps, seen_by
from itree_jax.refinement.optimise import Hypotheses, OtherView, RefineModel, cast_in
from itree_jax.sensing.needle import Array

SIZE = 192  # window pixels: the image's own for parts of up to 90 pixels' reach
WINDOW = 2.25  # of the part's reach: also where it lies an eighth nearer than the working distance
# What pixels, and those at steps, are worth beside a contour's points where images alone tell. Reflected light and
# highlights turn the needles of a whole face together, and carry its matched depth along: a mean over N of them knows
# no more than N / (1 + N b^2 / s^2) do, one in a thousand of a face, where a contour's points are worth one in thirty.
# By experiments/pixel_weight.py right poses are told best from wrong ones of their place with a few thousandths.
BESIDE_CONTOURS, STEPS_BESIDE_CONTOURS = 0.003, 0.1


class SensorErrors(NamedTuple):
    """What the likelihood reckons with: standard deviations, and how far apart things may lie."""

    depth: Float[Array, ""]  # [mm] of one pixel
    needle: Float[Array, ""]  # [rad]
    reach: Float[Array, ""]  # [mm] of depth over which something else may lie: the part's diameter
    pitch: Float[Array, ""]  # [mm] of a pixel at the working distance
    edge: Float[Array, ""]  # [px] of an image's edge beside its contour; 0: contours are steps of depth: pixels tell


class Support(NamedTuple):
    """Log-likelihood ratios [nats] of a list of poses, in windows of the first camera.

    Windows are shared by the lists that a pose is in: none is copied when lists are joined or cut, and those that were
    weighed together go together, with the last of them.
    """

    pixels: Sequence[Float[np.ndarray, "s s"]]  # above 0: the pose explains the pixel; below: it contradicts it
    at_steps: Sequence[Float[np.ndarray, "s s"]]  # of those beside the pose's own steps of depth: not in `pixels`
    hidden: Sequence[Bool[np.ndarray, "s s"]]  # pixels of the pose behind something nearer
    lit: Float[np.ndarray, "h"]  # window pixels that speak for the pose and that a light shows
    beside: Float[np.ndarray, "h"]  # of contours and of other cameras
    origin_uv: Float[np.ndarray, "h 2"]  # image point of window pixel (0, 0) [px]
    stride: int  # [px]
    weight: float = 1.0  # what the nats of `pixels` and `at_steps` are worth beside those of contours

    def joined(self, other: "Support") -> "Support":
        """Both lists, one after the other; of one part, so of one stride."""
        assert self[-2:] == other[-2:]
        lit, beside, origin = (np.concatenate(pair) for pair in zip(self[3:6], other[3:6], strict=True))
        pixels, at_steps = [*self.pixels, *other.pixels], [*self.at_steps, *other.at_steps]
        hidden = [*self.hidden, *other.hidden]
        return self._replace(
            pixels=pixels, at_steps=at_steps, hidden=hidden, lit=lit, beside=beside, origin_uv=origin
        )

    def take(self, index: Int[np.ndarray, "kept"]) -> "Support":
        pixels, at_steps, hidden = ([windows[k] for k in index] for windows in self[:3])
        lit, beside, origin = (array[index] for array in self[3:6])
        return self._replace(
            pixels=pixels, at_steps=at_steps, hidden=hidden, lit=lit, beside=beside, origin_uv=origin
        )


def support(
    hypotheses: Hypotheses, model: RefineModel, observed: ObservedMaps | SeenBy, camera: Camera, errors: SensorErrors,
    jump: float, others: Sequence[OtherView] = (), size: int = SIZE, crease: float | None = None,
) -> Support:
    """Renders every hypothesis and weighs each of its pixels. `jump` [mm]: least depth step of a contour; `crease`
    [rad]: creases are contours too, as in `correspondences`.
    """
    R, t = (np.asarray(a, np.float32) for a in hypotheses)
    stride = max(1, int(np.ceil(WINDOW * model.reach / float(errors.pitch) / size)))
    edges = jump if float(errors.edge) > 0 else None  # where depth ends contours, the pixels have told already
    weight, at_step = (1.0, 1.0) if edges is None else (BESIDE_CONTOURS, STEPS_BESIDE_CONTOURS)
    pixels, at_steps, hidden, lit, beside, origin = _seen_by(
        R, t, model, seen_by(observed, camera), errors, size, stride, edges, crease
    )
    for view in others:
        there, _, _, _, contour, _ = _seen_by(
            *view.poses(R, t), model, view.seen_by, errors, size, stride, edges, crease
        )
        beside = beside + contour + np.float32(weight) * np.sum(there, axis=(1, 2), dtype=np.float32)
    if at_step != weight:
        at_steps = np.float32(at_step / weight) * at_steps
    return Support(list(pixels), list(at_steps), list(hidden), lit, beside, origin, stride, weight)


def _seen_by(
    R: Float[np.ndarray, "h 3 3"], t: Float[np.ndarray, "h 3"], model: RefineModel, by: SeenBy, errors: SensorErrors,
    size: int, stride: int, edges: float | None, crease: float | None,
) -> tuple[np.ndarray, ...]:
    """Pixels, those at steps, hidden, lit, contour and window origins, as in `Support`."""
    weighed = room(len(t), size, model.mesh.device)
    reckoned = errors_of(*(float(v) for v in errors))

    def weigh(seen, first: int, last: int) -> None:
        weigh_rows(seen, by, model.mesh.normals_obj, reckoned, first, last, weighed)

    seen = cast_in(by.camera, R, t, model, size, stride, edges, weigh, weighing_kernel, crease=crease)
    rows = (a.numpy().sum(axis=1) for a in (weighed.lit, weighed.contour))
    squares = (a.numpy() for a in (weighed.pixels, weighed.at_steps, weighed.hidden))
    return *squares, *rows, seen.origin_uv.numpy()
