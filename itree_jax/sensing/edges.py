"""The edges of a scene with their labels: outline, crease or cast shadow (Ikeuchi 1987, sec. 3.1).

The paper differentiates three intensity maps and asks no more. But a cast shadow has edges too, which are not the
part's. Comparing the lights tells them apart: a cast shadow belongs to one light, under which one side, the one toward
the light, is as dark as what neighbours reflect, and no other light changes there; at a crease or an outline the
surface changes, and with it the intensity under most lights. A depth map tells an outline, where the surface ends
before another one, from a crease of one surface; without it needles do, where both sides have one (`edge_fold`), and
the others are `GEOMETRIC`. Attached shadows that end at a crease are creases.

`features.edges` is the edge map of a window, with a derivative, that rules L5 and A7 compare; `seen_by` there leaves
out what one light shows alone. Here are points with a place and a reason, for borders of regions and for refinement.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from itree_jax.sensing.edge_depth import DepthSides, depth_sides, unlit_steps
from itree_jax.sensing.edge_fold import Fold, fold
from itree_jax.sensing.edge_points import edge_points, joined
from itree_jax.sensing.edge_sides import LightSides, light_sides
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensor import Sensor

NO_LIGHT = -1
# Of the brightest light beside the edge: what neighbours reflect, and the next edge a few pixels away, change by. Under
# the lights that a shadow doesn't belong to, simulated bins change by less at three of four shadow edges.
UNCHANGED = 0.08
SHADOW_LEFT = 0.3  # of the bright side: what two bounces fill in is 22 % at the 99 percentile of rendered bins
LIT = 0.15  # of the brightest light: darker on a side, a light is shadowed there and its silence says nothing
# cos. Where a shadow ends on a surface, its dark side lies toward the light; where it begins, at the outline or crease
# that casts it, it lies away from it. A shadow's sides run along the light's direction, found within some degrees.
FAR_BORDER = -0.1
# Slopes of a depth map of 0.3 mm noise err by 5 degrees; 95 % of the creases of simulated bins turn by 40 or more.
CREASE = np.radians(20.0)


class EdgeLabel(IntEnum):
    UNKNOWN = 0  # no more than one light reaches both sides: there is none to compare it with
    OUTLINE = 1  # occluding: the surface ends, another one lies behind
    CREASE = 2  # orientation changes, depth does not
    SHADOW = 3  # the border of a cast shadow: the surface goes on
    GEOMETRIC = 4  # outline or crease: neither a depth map nor needles on both sides tell


class SceneEdges(NamedTuple):
    """Edge points of one image."""

    uv: Float[np.ndarray, "points 2"]  # [px], pixel centres at integers
    # Unit, across the edge: from near to far at an outline with depth, else to the side that is darker over all lights.
    direction: Float[np.ndarray, "points 2"]
    strength: Float[np.ndarray, "points"]  # 0..1: largest change under a light, of the brightest intensity around
    label: Int[np.ndarray, "points"]  # `EdgeLabel`, int8
    lights_share: Float[np.ndarray, "points"]  # of the lights that show it
    light: Int[np.ndarray, "points"]  # whose shadow it is, NO_LIGHT at other edges
    turn: Float[np.ndarray, "points"]  # [rad] of the surface, > 0 convex, < 0 concave; NaN where it is not known

    def of(self, *labels: EdgeLabel) -> "SceneEdges":
        """The points with one of these labels."""
        return SceneEdges(*(a[np.isin(self.label, labels)] for a in self))


def scene_edges(
    images: Float[np.ndarray, "lights height width"],
    sensor: Sensor,
    needle: NeedleMap | None = None,
    depth: Float[np.ndarray, "height width"] | None = None,
) -> SceneEdges:
    """Edge points of one image under each light, labelled. Host code; the same input gives the same bytes.

    Orientation discontinuities need no detector of their own: intensities are a linear map of the normal, so that one
    of the lights shows them. Depth steps that no light shows (both sides in the dark) make points at half pixels.

    Args:
        images: linear intensities, 1.0 = full scale.
        sensor: camera, light intensities and noise.
        needle: its normals on both sides, where they are known, tell a crease from an overlap.
        depth: z [mm], 0 = none; tells outlines from creases.
    """
    points = edge_points(images, sensor)
    if depth is not None:
        points = joined(points, unlit_steps(depth, sensor, points))
    lights = light_sides(images, sensor, points.uv, points.direction)
    shadow = _shadows(lights)
    needles = None if needle is None else fold(needle, sensor.camera, points.uv, points.direction)
    label, direction = _by_lights(shadow, needles), points.direction
    turn = np.full(len(label), np.nan) if needles is None else needles.turn
    if depth is not None:
        sides = depth_sides(depth, sensor, points.uv, points.direction)
        turn = np.where(np.isnan(turn), sides.turn, turn)
        label = _with_depth(label, shadow, sides, turn)
        behind = (label == EdgeLabel.OUTLINE) & (sides.step < 0.0)
        direction = np.where(behind[:, None], -direction, direction)
    light = np.where((label == EdgeLabel.SHADOW) & shadow.found, shadow.light, NO_LIGHT)
    return SceneEdges(points.uv, direction, points.change, label.astype(np.int8), lights.share, light, turn)


class _Shadow(NamedTuple):
    """What the lights say of edges."""

    found: Bool[np.ndarray, "points"]  # the border of a shadow
    light: Int[np.ndarray, "points"]  # whose; that of the deepest one if several end there
    blind: Bool[np.ndarray, "points"]  # no other light is there to compare with
    dark: Bool[np.ndarray, "points"]  # one side is dark under some light: what all light can be no shadow's border


def _shadows(lights: LightSides) -> _Shadow:
    """Every light either falls into a shadow or doesn't change, and one at least is there to say so."""
    top = lights.bright.max(axis=1, keepdims=True)
    quiet = lights.change <= UNCHANGED * top
    falls = ~quiet & (lights.dark <= SHADOW_LEFT * lights.bright)
    into = falls & (lights.toward > FAR_BORDER)
    explained = (quiet | into).all(axis=1)
    witness = (quiet & (lights.dark > LIT * top)).any(axis=1)
    light = np.argmax(np.where(into, lights.bright - lights.dark, -1.0), axis=1)
    one = falls.sum(axis=1) == 1
    blind = (quiet | falls).all(axis=1) & ~witness & one
    return _Shadow(explained & into.any(axis=1) & witness, light, blind, falls.any(axis=1))


def _by_lights(shadow: _Shadow, fold: Fold | None) -> Int[np.ndarray, "points"]:
    """Labels without a depth map: needles, where both sides have one, tell a crease from an overlap."""
    label = np.where(shadow.blind, EdgeLabel.UNKNOWN, EdgeLabel.GEOMETRIC)
    if fold is not None:
        label = np.where(fold.is_crease, EdgeLabel.CREASE, np.where(fold.is_overlap, EdgeLabel.OUTLINE, label))
    return np.where(shadow.found, EdgeLabel.SHADOW, label)


def _with_depth(
    by_lights: Int[np.ndarray, "points"], shadow: _Shadow, sides: DepthSides, turn: Float[np.ndarray, "points"]
) -> Int[np.ndarray, "points"]:
    """Labels of edges that a depth map is known around; NaN in `step` or `turn` where it isn't."""
    goes_on = shadow.found | ((np.abs(turn) <= CREASE) & shadow.dark)
    by_turn = np.where(goes_on, EdgeLabel.SHADOW, EdgeLabel.CREASE)
    label = np.where(np.isnan(turn), by_lights, by_turn)
    label = np.where(sides.is_step, EdgeLabel.OUTLINE, label)
    return np.where(np.isnan(sides.step), by_lights, label)
