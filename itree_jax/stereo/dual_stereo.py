"""Dual photometric stereo: depth from two cameras under the same lights (Ikeuchi 1987, sec. 3.1, reference 35).

The paper's pair of needle maps gives depth to each region. Here regions come first too (`epipolar`), then every pixel:
windows that lie along the surface found so far are matched to a fraction of a pixel, and needles carry depth from
where there is texture (borders, creases, cast shadows, which both cameras see at the same place of the surface) to
where there is none.
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float

from itree_jax.batches import on_all_cores
from itree_jax.sensing.box import Box, box_of, in_image
from itree_jax.sensing.lit import lit_by_any
from itree_jax.sensing.material_response import MaterialResponse
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.noise_model import intensity_std
from itree_jax.sensing.reading import first_needles, turned_back
from itree_jax.sensor import Sensor
from itree_jax.stereo.epipolar import lowest_point, match_pieces, smooth_pieces, views_differ
from itree_jax.stereo.needle_surface import Slopes, needle_slopes, surface
from itree_jax.stereo.second_camera import EpipolarPair, SecondCamera, epipolar_pair, to_first_camera

NEAREST, FARTHEST = 0.75, 1.05  # of the working distance: a bin is no deeper than a quarter of it, its floor no lower
WINDOW = 9  # [px], along the surface
MOST_DIFFERENT = 0.08  # of full scale, of one light
COARSE_STD = 1.5  # [mm] of the block matcher's depths, as deviations of neighbours that share their windows
PIECE_STD = 0.7  # [mm] of a piece's depth: a quarter of a pixel
SHARPEST_STD, DULLEST_STD = 0.4, 1.0  # [mm] of a window's match
AGREES = 4.0  # [mm] a pixel without a needle is known where the block matcher says the same: a pixel of disparity
REACHES = (2.0, 1.0)  # [px] of disparity that windows are moved by, one after the other
AROUND = 16  # [px] beside what a light shows: more than windows reach that meet it
SIZES = 64  # [px]: sides of what is looked at are multiples of it, so that few shapes are compiled
ABSOLUTE_SPREAD = np.sqrt(1.0 - 2.0 / np.pi)  # of a Gaussian's absolute value, over its own deviation
# What a trusted pixel's depth is off by, as a share of a pixel of disparity; neighbours share nearly all of it.
MATCH_ERROR = 0.15


class Found(NamedTuple):
    """What was found in the left images, where a light shows the parts; a later look begins from it."""

    box: Box
    coarse: Float[np.ndarray, "height width"]  # [mm] by the block matcher, 0 = none
    trusted: Bool[np.ndarray, "height width"]  # of a matched piece
    surface: Float[np.ndarray, "height width"]  # z [mm]


@dataclass(frozen=True)
class StereoDepth:
    """Depth of the first camera's pixels."""

    depth: Float[np.ndarray, "height width"]  # z [mm], 0 where it is not known
    by_needles: Bool[np.ndarray, "height width"]  # of a matched piece; elsewhere matched by windows alone
    std: float  # [mm] of a matched piece's depth at the working distance, shared by its pixels
    found: Found


def dual_photometric_stereo(
    images: Float[np.ndarray, "lights height width"], sensor: Sensor, second: SecondCamera,
    response: MaterialResponse | None = None, before: Found | None = None, needle: NeedleMap | None = None,
) -> StereoDepth:
    """Depth from the images of two cameras (linear, 1.0 = full scale), one under each light, about where a light shows
    what is as bright as the parts; 0 elsewhere.

    `response`: of the material, as the first camera sees it. `before`: what an earlier look at the same scene found,
    with other needles or less reflected light: the last step goes on from there. `needle`: the first camera's map as
    the response reads it, if it is known already; of images that had to be turned another one is made. Raises
    `ItreeError` as `epipolar_pair` does.
    """
    pair = epipolar_pair(images, sensor, second)
    if needle is None or pair.left_stored is not images:
        needle = turned_back(first_needles(pair.left_stored, pair.sensor, None), pair.R_left_first, response)
    found = _first_found(pair, needle) if before is None else _found_again(pair, needle, before)
    agrees = (found.coarse > 0.0) & (np.abs(found.coarse - found.surface) < AGREES)
    depth = np.where(found.trusted | agrees, found.surface, 0.0)
    std = MATCH_ERROR * sensor.working_distance**2 / pair.focal_baseline
    depth, by_needles = (
        to_first_camera(in_image(a, found.box, pair.sensor.camera), pair, sensor.camera)
        for a in (depth, found.trusted)
    )
    return StereoDepth(depth.astype(np.float32), by_needles > 0.0, std, found)


def searched(pair: EpipolarPair) -> tuple[int, int]:
    """First and last disparity [px] at which parts may lie."""
    first, last = pair.disparity(np.array([FARTHEST, NEAREST]) * pair.sensor.working_distance)
    return int(np.floor(first)), int(np.ceil(last))


class _Told(NamedTuple):
    """What the needles of a part of the left images tell."""

    normals: Float[np.ndarray, "height width 3"]  # 0 where there is none
    interpretable: Bool[np.ndarray, "height width"]
    slopes: Slopes


def _told(pair: EpipolarPair, needle: NeedleMap, box: Box) -> _Told:
    here = slice(box.top, box.bottom), slice(box.left, box.right)
    normals, interpretable, confidence = (
        np.asarray(a)[here] for a in (needle.normals, needle.interpretable, needle.confidence)
    )
    normals = np.asarray(normals, np.float64) * interpretable[..., None]
    return _Told(normals, interpretable, needle_slopes(normals, confidence, pair.sensor.camera))


def _first_found(whole: EpipolarPair, needle: NeedleMap) -> Found:
    """Blocks, then pieces, then windows along the surface that these and the needles make."""
    lit = lit_by_any(whole.left_stored, whole.sensor, needle)
    height, width = whole.left.shape[1:]
    box = Box(0, height, 0, width) if lit is None else box_of(lit, AROUND, SIZES)
    rows = whole.within(box._replace(left=0, right=width))  # a block matcher wants both alike
    coarse = block_matching(rows, *searched(rows))[:, box.left : box.right]
    pair = whole.within(box)
    camera, told = pair.sensor.camera, _told(pair, needle, box)
    pieces = smooth_pieces(told.normals, told.interpretable)
    alone = needle_slopes(told.normals, (pieces >= 0).astype(float), camera)
    level = coarse if coarse.any() else np.full(coarse.shape, pair.sensor.working_distance)
    shape = surface(alone, level, np.full(level.shape, 40.0 * COARSE_STD), camera, rounds=1)
    found = match_pieces(pair, pieces, shape, coarse, searched(pair))
    matched = np.where(found.trusted, found.depth, coarse)
    z = surface(told.slopes, matched, np.where(found.trusted, PIECE_STD, COARSE_STD), camera)
    for reach in REACHES:
        z = _matched_along(pair, told, z, reach)
    return Found(box, coarse, found.trusted, z)


def _found_again(whole: EpipolarPair, needle: NeedleMap, before: Found) -> Found:
    """The last step of `_first_found`, from where it ended before."""
    pair = whole.within(before.box)
    told = _told(pair, needle, before.box)
    return before._replace(surface=_matched_along(pair, told, before.surface, REACHES[-1]))


def _matched_along(
    pair: EpipolarPair, told: _Told, z: Float[np.ndarray, "height width"], reach: float
) -> Float[np.ndarray, "height width"]:
    """The surface z [mm] once windows along it were matched, as they and the needles have it."""
    matched, deviation = match_windows(pair, z, reach, told.interpretable)
    return surface(told.slopes, matched, deviation, pair.sensor.camera, start=z)


def block_matching(pair: EpipolarPair, first: int, last: int) -> Float[np.ndarray, "height width"]:
    """OpenCV's semi-global block matching on three lights at once: depth [mm] to a pixel of disparity, 0 = none."""
    count = -(-(last - first + 1) // 16) * 16
    chosen = np.linspace(0, len(pair.left) - 1, 3).round().astype(int)

    aside = max(0, first + count), max(0, -first)  # what is so near to an image's side is matched too

    def as_colours(images: np.ndarray) -> np.ndarray:
        root = np.sqrt(np.clip(images[chosen], 0.0, 1.0))  # evens out shot noise, and lifts what shadows hold
        colours = (255.0 * root).astype(np.uint8).transpose(1, 2, 0)
        return cv2.copyMakeBorder(np.ascontiguousarray(colours), 0, 0, *aside, cv2.BORDER_REPLICATE)

    matcher = cv2.StereoSGBM.create(
        minDisparity=first, numDisparities=count, blockSize=3, P1=8 * 27, P2=64 * 27, disp12MaxDiff=1,
        uniquenessRatio=3, speckleWindowSize=50, speckleRange=2, mode=cv2.STEREO_SGBM_MODE_HH,
    )
    disparity = matcher.compute(as_colours(pair.left), as_colours(pair.right)).astype(np.float32) / 16.0
    width = pair.left.shape[2]
    disparity = disparity[:, aside[0] : aside[0] + width]
    there = np.arange(width) - disparity
    seen = (disparity >= first) & (there >= 0.0) & (there <= width - 1.0)
    return np.where(seen, pair.depth(disparity), 0.0)


def noise_of_window(pair: EpipolarPair, interpretable: Bool[np.ndarray, "height width"]) -> float:
    """Standard deviation by noise of a window's mean absolute difference of the views, of full scale."""
    if not interpretable.any():
        return 0.0
    strengths = pair.sensor.light_intensities[:, None]
    std = np.asarray(intensity_std(pair.left_stored[:, interpretable], pair.sensor.noise)) / strengths
    of_difference = np.sqrt(2.0) * float(np.median(std))
    return ABSOLUTE_SPREAD * of_difference / np.sqrt(len(pair.left) * WINDOW**2)


def match_windows(
    pair: EpipolarPair, z: Float[np.ndarray, "height width"], reach: float, interpretable: Bool[np.ndarray, "h w"]
) -> tuple[Float[np.ndarray, "height width"], Float[np.ndarray, "height width"]]:
    """Depth [mm] and its deviation [mm] from windows along the surface z, moved by up to `reach` [px] of disparity.

    A window without texture looks alike wherever it lies: to move by the whole reach, the views must come to agree
    better by more than noise makes them differ, so that it stays where needles put it. How sharply the difference rises
    about its least tells the deviation: what rises no more than noise is reckoned with has `DULLEST_STD`.
    """
    disparity = pair.disparity(z)
    steps = np.linspace(-reach, reach, 17)

    def moved(step: float) -> Float[np.ndarray, "height width"]:
        return cv2.boxFilter(views_differ(pair, disparity + step, MOST_DIFFERENT), -1, (WINDOW, WINDOW))

    noise = noise_of_window(pair, interpretable)
    cost = np.stack(on_all_cores(moved, steps))
    cost += noise * np.square(steps / reach)[:, None, None]
    place, _, bend = lowest_point(cost, steps)
    of_noise = 2.0 * noise * ((steps[1] - steps[0]) / reach) ** 2
    deviation = np.clip(DULLEST_STD * np.sqrt(of_noise / bend), SHARPEST_STD, DULLEST_STD)
    return pair.depth(disparity + place), deviation
