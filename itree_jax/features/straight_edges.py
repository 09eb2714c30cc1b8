"""Straight segments in an edge map.

From the pixels whose neighbourhood agrees best on a direction, a line is grown both ways: the pixels on it and in its
direction are taken, the line is fitted to them, and the reach is doubled. Gaps are bridged on the way, so that pieces
of one line are one segment, and a curve gives the chords that it keeps to. Deterministic, at any resolution.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float

LEAST_STRENGTH = 0.25  # below it an edge has lost half its contrast to noise, or most of it to thinning
STRAIGHT = 1.5  # [px] off the line at most: a band is two pixels wide, and a fitted line is half a pixel off
SAME_DIRECTION = np.radians(22.5)  # steps of whole pixels turn the direction of a pixel by up to 10 degrees
SEED_SIDE = 7  # [px], side of the neighbourhood that has to agree
FIRST_REACH = 4.0  # [px] both ways, on which the direction of the seed is good enough to stay within `STRAIGHT`
# As shares of the window, so that the same edges are prominent at any resolution; in a window of 48 pixels:
LEAST_LENGTH = 1 / 8  # 6 pixels, three times the width of an edge
GAP = 1 / 16  # 3 pixels: two edges that end closer than this are seen as one


class StraightEdge(NamedTuple):
    """A segment in window pixels."""

    ends: Float[np.ndarray, "2 2"]  # (x, y) [px] of both ends
    strength: float  # 0..1, mean along the segment, gaps included
    length: float  # [px]


class _Pixels(NamedTuple):
    """The edge pixels of a map."""

    xy: Float[np.ndarray, "n 2"]
    double_angle: Float[np.ndarray, "n 2"]  # unit
    strength: Float[np.ndarray, "n"]


def straight_edges(edges: Float[np.ndarray, "h w 2"], most: int) -> list[StraightEdge]:
    """At most `most` segments, those with the largest length times strength first."""
    edges = np.asarray(edges, np.float64)
    strength = np.linalg.norm(edges, axis=-1)
    size = max(strength.shape)
    v, u = np.nonzero(strength >= LEAST_STRENGTH)
    strong = strength[v, u]
    pixels = _Pixels(np.stack([u, v], axis=1).astype(float), edges[v, u] / strong[:, None], strong)
    agreement = np.linalg.norm(cv2.blur(edges, (SEED_SIDE, SEED_SIDE)), axis=-1)[v, u] * strong
    free = np.ones(len(strong), bool)
    found = []
    # Rounded, so that the last digits don't decide between equals; then row by row.
    for seed in np.argsort(-agreement.round(6), kind="stable"):
        if not free[seed]:
            continue
        segment, used = _grown(pixels, free, seed, size)
        free &= ~used
        free[seed] = False
        if segment.length >= LEAST_LENGTH * size:
            found.append(segment)
    return sorted(found, key=lambda e: -e.length * e.strength)[:most]


def _grown(
    pixels: _Pixels, free: Bool[np.ndarray, "n"], seed: int, size: int
) -> tuple[StraightEdge, Bool[np.ndarray, "n"]]:
    """The segment through one pixel, and the pixels it accounts for."""
    angle = np.arctan2(pixels.double_angle[seed, 1], pixels.double_angle[seed, 0]) / 2.0
    middle, tangent = pixels.xy[seed], np.array([np.cos(angle), np.sin(angle)])
    members, reach = np.zeros_like(free), FIRST_REACH
    while True:
        members = _on_line(pixels, free, seed, middle, tangent, reach, GAP * size)
        if np.count_nonzero(members) < 3:
            break
        middle, tangent = _fitted_line(pixels.xy[members], pixels.strength[members])
        if reach > 2.0 * size:
            break
        reach *= 2.0
    along, off = _along_and_off(pixels.xy, middle, tangent)
    taken = along[members] if members.any() else along[[seed]]
    first, last = taken.min() - 0.5, taken.max() + 0.5  # a pixel is a square, not a point
    best = np.zeros(int(last - first) + 1)
    np.maximum.at(best, (taken - first).astype(int), pixels.strength[members] if members.any() else 0.0)
    strength = min(1.0, float(best.sum() / (last - first)))
    ends = middle[None] + np.outer([first, last], tangent)
    beside = _same_direction(pixels, tangent) & (np.abs(off) <= STRAIGHT + 0.5) & (along >= first) & (along <= last)
    return StraightEdge(ends, strength, float(last - first)), members | beside


def _on_line(
    pixels: _Pixels,
    free: Bool[np.ndarray, "n"],
    seed: int,
    middle: Float[np.ndarray, "2"],
    tangent: Float[np.ndarray, "2"],
    reach: float,
    gap: float,
) -> Bool[np.ndarray, "n"]:
    """Free pixels on a line, in its direction, at most `reach` from the seed and without a gap in between."""
    along, off = _along_and_off(pixels.xy, middle, tangent)
    along = along - along[seed]
    close = free & _same_direction(pixels, tangent) & (np.abs(off) <= STRAIGHT) & (np.abs(along) <= reach)
    index = np.flatnonzero(close)
    index = index[np.argsort(along[index], kind="stable")]
    part = np.concatenate([[0], np.cumsum(np.diff(along[index]) > gap + 1.0)]) if len(index) else index
    home = part[np.argmin(np.abs(along[index]))] if len(index) else 0
    close[index[part != home]] = False
    return close


def _fitted_line(
    xy: Float[np.ndarray, "n 2"], weight: Float[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """Mean and unit direction of the line with the least weighted squares across it."""
    middle = weight @ xy / weight.sum()
    centred = xy - middle
    _, vectors = np.linalg.eigh((centred * weight[:, None]).T @ centred)
    return middle, vectors[:, 1]


def _along_and_off(
    xy: Float[np.ndarray, "n 2"], middle: Float[np.ndarray, "2"], tangent: Float[np.ndarray, "2"]
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Coordinates along and across a line."""
    offset = xy - middle
    return offset @ tangent, offset @ np.array([-tangent[1], tangent[0]])


def _same_direction(pixels: _Pixels, tangent: Float[np.ndarray, "2"]) -> Bool[np.ndarray, "n"]:
    """Pixels whose direction is within `SAME_DIRECTION` of the tangent."""
    double = np.array([tangent[0] ** 2 - tangent[1] ** 2, 2.0 * tangent[0] * tangent[1]])
    return pixels.double_angle @ double >= np.cos(2.0 * SAME_DIRECTION)
