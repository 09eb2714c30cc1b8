"""The edges of a scene with their labels: outline, crease or cast shadow (Ikeuchi 1987, sec. 3.1).

The paper differentiates three intensity maps and asks no more. But a cast shadow has edges too, which are not the
part's. Comparing the lights tells them apart: a cast shadow belongs to one light, under which one side is as dark as
what neighbours reflect, and no other light changes there; at a crease or an outline the surface changes, and with it
the intensity under most lights. A depth map tells an outline, where the surface ends before another one, from a crease
of one surface; without it both are `GEOMETRIC`.

`features.edges` is the edge map of a window, with a derivative, that rules L5 and A7 compare; `seen_by` there leaves
out what one light shows alone. Here are points with a place and a reason, for borders of regions and for refinement.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from itree_jax.sensing.edge_depth import DepthSides, depth_sides, unlit_steps
from itree_jax.sensing.edge_points import edge_points, joined
from itree_jax.sensing.edge_sides import LightSides, light_sides, needle_turn
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensor import Sensor

NO_LIGHT = -1
# Of the brightest light beside the edge. Under the lights that a shadow doesn't belong to, simulated bins change by
# less at three of four shadow edges (the others have another edge within 4 px) and at one of forty creases.
UNCHANGED = 0.05
SHADOW_LEFT = 0.3  # of the bright side: what two bounces fill in is 22 % at the 99 percentile of rendered bins
LIT = 0.15  # of the brightest light: darker on a side, a light is shadowed there and its silence says nothing
# Slopes of a depth map of 0.3 mm noise err by 5 degrees; 95 % of the creases of simulated bins turn by 40 or more.
CREASE = np.radians(20.0)


class EdgeLabel(IntEnum):
    UNKNOWN = 0  # no more than one light reaches both sides: there is none to compare it with
    OUTLINE = 1  # occluding: the surface ends, another one lies behind
    CREASE = 2  # orientation changes, depth does not
    SHADOW = 3  # the border of a cast shadow: the surface goes on
    GEOMETRIC = 4  # outline or crease: there is no depth map to tell


class SceneEdges(NamedTuple):
    """Edge points of one image."""

    uv: Float[np.ndarray, "points 2"]  # [px], pixel centres at integers
    # Unit, across the edge: from near to far at an outline with depth, else to the side that is darker over all lights.
    direction: Float[np.ndarray, "points 2"]
    strength: Float[np.ndarray, "points"]  # 0..1: largest change under a light, of the brightest intensity around
    label: Int[np.ndarray, "points"]  # `EdgeLabel`, int8
    lights_share: Float[np.ndarray, "points"]  # of the lights that show it
    light: Int[np.ndarray, "points"]  # whose shadow it is, NO_LIGHT at other edges

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
        needle: its normals on both sides tell a crease, where they are known.
        depth: z [mm], 0 = none; tells outlines from creases.
    """
    points = edge_points(images, sensor)
    if depth is not None:
        points = joined(points, unlit_steps(depth, sensor, points))
    lights = light_sides(images, sensor, points.uv, points.direction)
    shadow, light, blind = _by_lights(lights)
    if depth is None:
        label = np.where(shadow, EdgeLabel.SHADOW, np.where(blind, EdgeLabel.UNKNOWN, EdgeLabel.GEOMETRIC))
        direction = points.direction
    else:
        sides = depth_sides(depth, sensor, points.uv, points.direction)
        turn = sides.turn if needle is None else _first_known(needle_turn(needle, points), sides.turn)
        label = _with_depth(shadow, blind, sides, turn)
        behind = (label == EdgeLabel.OUTLINE) & (sides.step < 0.0)
        direction = np.where(behind[:, None], -points.direction, points.direction)
    light = np.where((label == EdgeLabel.SHADOW) & shadow, light, NO_LIGHT)
    return SceneEdges(points.uv, direction, points.change, label.astype(np.int8), lights.share, light)


def _by_lights(
    lights: LightSides,
) -> tuple[Bool[np.ndarray, "points"], Int[np.ndarray, "points"], Bool[np.ndarray, "points"]]:
    """Whether an edge is one light's shadow, which light's, and whether no other light could tell."""
    index = np.arange(len(lights.bright))
    light = np.argmax(lights.bright - lights.dark, axis=1)
    top = lights.bright.max(axis=1)
    fall = lights.dark[index, light] <= SHADOW_LEFT * lights.bright[index, light]
    others = np.arange(lights.bright.shape[1])[None] != light[:, None]
    quiet = ~((lights.change > UNCHANGED * top[:, None]) & others).any(axis=1)
    witnesses = ((lights.dark > LIT * top[:, None]) & others).any(axis=1)
    return quiet & fall & witnesses, light, quiet & ~witnesses


def _with_depth(
    shadow: Bool[np.ndarray, "points"], blind: Bool[np.ndarray, "points"], sides: DepthSides,
    turn: Float[np.ndarray, "points"],
) -> Int[np.ndarray, "points"]:
    """Labels of edges that a depth map is known around; NaN in `step` or `turn` where it isn't."""
    by_lights = np.where(shadow, EdgeLabel.SHADOW, np.where(blind, EdgeLabel.UNKNOWN, EdgeLabel.GEOMETRIC))
    by_turn = np.where((turn > CREASE) & ~shadow, EdgeLabel.CREASE, EdgeLabel.SHADOW)
    label = np.where(np.isnan(turn), by_lights, by_turn)
    label = np.where(sides.is_step, EdgeLabel.OUTLINE, label)
    return np.where(np.isnan(sides.step), by_lights, label)


def _first_known(a: Float[np.ndarray, "points"], b: Float[np.ndarray, "points"]) -> Float[np.ndarray, "points"]:
    return np.where(np.isnan(a), b, a)
