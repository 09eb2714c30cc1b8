"""How hypotheses are narrowed and refined: stages, gates and tolerances from the part's size and the sensor's errors.

The stages follow one idea: many hypotheses at few rays, few hypotheses at many rays. Gates start at the reach of the
dome's spacing and end at what the sensor's errors allow.
"""

from dataclasses import dataclass, replace

import numpy as np
from itree_kernels.camera import Camera

from itree_jax.refinement.likelihood import SIZE, SensorErrors
from itree_jax.refinement.optimise import Stage
from itree_jax.refinement.residuals import Deviations
from itree_jax.refinement.verify import Tolerances
from itree_jax.sensor import Sensor

STEEPEST_SEEN = np.radians(75.0)  # slant up to which neighbouring pixels of one surface are told from a depth step
NEEDLE_BIAS = np.radians(2.0)  # needles of a face share errors of interreflection and reflectance of about this size
NEEDLE_PIXEL = np.radians(3.0)  # of one pixel, noise and raster together
EDGE_PIXEL = 0.5  # [px] an occluding edge lies anywhere between two pixels
EDGE_BIAS = 0.15  # [px] shared by a contour
EDGE_STD = 0.7  # [px] of an edge beside a pose's contour: half a pixel of its own and as much of the pose's
RASTER = 0.1  # [px] that a depth is off by sideways, at least: what is left of its error on a surface seen edge-on
DEPTH_BIAS = 0.15  # of the depth noise: what a depth camera's neighbouring pixels share
FACE_TURNED = np.radians(8.0)  # what a highlight or a corner's reflections turn all needles of a face by
FACE_MOVED = 10.0  # times what matched depth is off by else: a highlight lies behind a curved face, or before it
NOISE_SIGMAS = 4.0
LAST_SIGMAS = 3.0  # at the end: what a pixel is off by more is a part that leans on this one
# With a depth map agreement tells right poses from wrong ones once they are refined a little: of those that ended right
# none had less of its region's best (experiments/beam_margins.py: 0.23 and more; turned poses, which compete with one
# that agrees already, 0.55, after the first round 0.17).
READ_BEHIND, TURNED_BEHIND, TURNED_ROUGHLY_BEHIND = 0.2, 0.4, 0.1
MORE = 8  # steps of a pose that slides: a contour farther off than its gate draws none, a nearer one a share of the way
DEPTH_EDGE_GATE = 4.0  # [px] at the last step: a depth map has outlines alone, far apart
IMAGE_EDGE_GATE = 1.5  # [px]: three deviations; images have edges of textures and other parts a few pixels away


@dataclass(frozen=True)
class Round:
    """Refine, verify, keep the best hypotheses of every region."""

    stage: Stage
    keep: int  # hypotheses per region after this round
    tolerances: Tolerances
    behind: float | None = None  # share of its region's best agreement under which a pose is left behind; None: none is


@dataclass(frozen=True)
class Schedule:
    """All rounds of one part under one sensor."""

    rounds: tuple[Round, ...]  # of the candidates
    turned: tuple[Round, ...]  # of accepted poses and those turned about their main axes
    last: tuple[Stage, ...]  # of the answers and their rivals, at the image's resolution in the end
    deviations: Deviations
    independent: Deviations  # of the last stage: a depth map's pixels may err independently
    exact: tuple[Stage, Deviations] | None  # a word more on the answers, where a depth map errs along its rays
    # another way to end, where whole faces' needles and depth may be off
    by_contours: tuple[tuple[Stage, ...], Deviations] | None
    errors: SensorErrors  # that the last verification reckons with
    jump: float  # least depth step between two surfaces [mm]
    verify_size: int  # window pixels of the last verification


def depth_jump(camera: Camera, distance: float, noise: float) -> float:
    """Least depth step [mm] between neighbouring pixels that no single surface under 75 degrees of slant makes."""
    return camera.mm_per_px(distance) * float(np.tan(STEEPEST_SEEN)) + NOISE_SIGMAS * np.sqrt(2.0) * noise


def schedule(
    sensor: Sensor, diameter: float, noise: float, spacing: float, shared: float | None = None, edge: float = 0.0
) -> Schedule:
    """The rounds for a part of this diameter [mm], a depth map of this noise [mm], a dome of this spacing [rad].

    `shared` [mm]: what neighbouring pixels' depths are off by together; None: a depth camera's share of its noise.
    `edge` [px]: see `Tolerances`.
    """
    last_gate = DEPTH_EDGE_GATE if edge == 0.0 else IMAGE_EDGE_GATE
    bias = DEPTH_BIAS * noise if shared is None else shared
    camera, distance = sensor.camera, sensor.working_distance
    pitch = camera.mm_per_px(distance)
    rim = diameter / 2.0
    jump = depth_jump(camera, distance, noise)
    fine = 3.0 * float(np.hypot(noise, 0.0 if shared is None else shared)) + 0.5 * pitch
    start = max(2.0 * spacing * rim, 4.0 * fine)  # a hypothesis is off by a cell of the dome and its centroid's error
    middle = max(0.5 * spacing * rim, 3.0 * fine)

    def tolerances(depth: float, needle: float, least_jump: float) -> Tolerances:
        return Tolerances(*(np.asarray(v, np.float32) for v in (depth, needle, least_jump, edge)))

    read, turned_rough, turned_fine = (
        (READ_BEHIND, TURNED_ROUGHLY_BEHIND, TURNED_BEHIND) if edge == 0.0 else (None, None, None)
    )
    middle_steps, fine_steps, more = (5, 4, MORE) if edge == 0.0 else (7, 6, 0)
    polish = Stage(2, 96, (2.0 * fine, 2.0 * fine), (0.4, 0.4), (last_gate, last_gate), more=more)
    rounds = (
        Round(
            Stage(1, 16, (start, start), (1.0, 1.0), (1.0, 1.0), contour=False),
            64,
            tolerances(start, np.radians(45.0), max(jump, start)),
        ),
        Round(
            Stage(2, 24, (start, start), (1.0, 1.0), (start / pitch, start / pitch)),
            20,
            tolerances(middle, np.radians(35.0), max(jump, middle)),
        ),
        Round(
            Stage(middle_steps, 32, (start, middle), (1.0, 0.6), (start / pitch, middle / pitch)),
            5,
            tolerances(max(middle / 2, fine), np.radians(25.0), max(jump, middle / 2)),
            read,
        ),
        Round(
            Stage(fine_steps, 48, (middle, 2.0 * fine), (0.6, 0.4), (middle / pitch, last_gate), more=more),
            2,
            tolerances(fine, np.radians(20.0), jump),
            read,
        ),
        Round(polish, 2, tolerances(fine, np.radians(20.0), jump), read),
    )
    turned = (
        Round(
            Stage(2, 24, (start, middle), (1.0, 0.8), (start / pitch, middle / pitch)),
            9,
            rounds[1].tolerances,
            turned_rough,
        ),
        Round(
            Stage(5, 32, (start, middle), (1.0, 0.6), (start / pitch, middle / pitch)),
            5,
            rounds[2].tolerances,
            turned_fine,
        ),
        Round(
            Stage(4, 48, (middle, 2.0 * fine), (0.6, 0.4), (middle / pitch, last_gate)),
            3,
            rounds[3].tolerances,
            turned_fine,
        ),
        Round(polish, 2, rounds[4].tolerances, turned_fine),
    )
    values = (max(noise, RASTER * pitch), max(bias, 0.02 * pitch), 0.0, NEEDLE_PIXEL, NEEDLE_BIAS, 0.0,
              EDGE_PIXEL, EDGE_BIAS, 0.0)
    reckoned = (np.hypot(noise, bias), np.hypot(NEEDLE_PIXEL, NEEDLE_BIAS), diameter, pitch, EDGE_STD if edge else 0.0)
    errors = SensorErrors(*(np.asarray(v, np.float32) for v in reckoned))
    deviations = Deviations(*(np.asarray(v, np.float32) for v in values))
    if edge == 0.0:
        by_contours = None
        independent = deviations._replace(depth_bias=np.zeros((), np.float32))
        narrow = (NOISE_SIGMAS * values[0], LAST_SIGMAS * values[0])
        last = (Stage(4, SIZE, narrow, (0.4, 0.4), (last_gate, last_gate)),)
        along_rays = np.asarray((RASTER * pitch / values[0]) ** 2, np.float32)
        exact = replace(last[0], steps=2), independent._replace(grazing=along_rays)
    else:  # matched depth errs together over whole faces: no reason to believe it more
        independent, exact = deviations, None
        # halfway a pose may be less likely than where it started, and would be taken back: hence as many steps
        at_last = Stage(24, SIZE, polish.depth_gate, polish.needle_gate, polish.contour_gate)
        nearly = replace(at_last, steps=12, size=polish.size)  # most of the way, for a quarter of the pixels
        last = nearly, at_last
        moved, turned_by = (np.asarray(v, np.float32) for v in (FACE_MOVED * bias, FACE_TURNED))
        astray = deviations._replace(depth_bias=moved, needle_bias=turned_by)
        falling = replace(nearly, contour_gate=(DEPTH_EDGE_GATE, last_gate))
        by_contours = (falling, replace(at_last, steps=12)), astray
    return Schedule(rounds, turned, last, deviations, independent, exact, by_contours, errors, jump, 96)
