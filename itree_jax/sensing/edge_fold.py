"""Whether two needles can be those of faces that meet in an edge, and whether they meet in a ridge or a groove.

Two planes meet in a line that lies in both, along the cross product of their normals, and the image shows it in one
direction only (in gradient space: the join of the two gradients is at right angles to the line; Mackworth 1973). So the
needles on both sides of a crease agree with the direction of its edge; those of two surfaces that merely overlap in the
image agree with it by chance.
"""

from typing import NamedTuple

import numpy as np
from itree_kernels.camera import Camera
from jaxtyping import Bool, Float

from itree_jax.sensing.edge_points import nearest
from itree_jax.sensing.needle import NeedleMap

ASIDE = 3.0  # [px]: where needles are looked up; nearer, pixels mix both sides
# By how much [rad] a crease may miss its direction. On simulated bins 98 % of creases do by less and, since overlaps go
# any way, one of five overlaps too.
MISMATCH = np.radians(10.0)
# Needles err by interreflection up to some degrees, and the line in which two planes meet by that over their turn.
LEAST_TURN = np.radians(10.0)


class Fold(NamedTuple):
    """NaN where a needle on one of the sides is uninterpretable."""

    turn: Float[np.ndarray, "points"]  # [rad] between the needles: > 0 a ridge (convex), < 0 a groove (concave)
    mismatch: Float[np.ndarray, "points"]  # [rad] between the line in which the planes meet and the edge

    @property
    def is_crease(self) -> Bool[np.ndarray, "points"]:
        return (np.nan_to_num(np.abs(self.turn)) > LEAST_TURN) & (np.nan_to_num(self.mismatch, nan=np.inf) < MISMATCH)

    @property
    def is_overlap(self) -> Bool[np.ndarray, "points"]:
        """Two surfaces that don't meet where they are seen to."""
        return (np.nan_to_num(np.abs(self.turn)) > LEAST_TURN) & (np.nan_to_num(self.mismatch) >= MISMATCH)


def fold(
    needle: NeedleMap, camera: Camera, uv: Float[np.ndarray, "points 2"], direction: Float[np.ndarray, "points 2"]
) -> Fold:
    """The fold of the surface at edge points (u, v) [px] with unit direction across them."""
    known = np.asarray(needle.interpretable, np.float32)
    normals = np.asarray(needle.normals, np.float32)
    places = [uv + t * direction for t in (-ASIDE, ASIDE)]
    there = np.all([nearest(known, place) > 0.5 for place in places], axis=0)
    before, after = (np.stack([nearest(normals[..., k], p) for k in range(3)], axis=-1).astype(float) for p in places)
    line = np.cross(before, after)
    sine, cosine = np.linalg.norm(line, axis=-1), (before * after).sum(axis=-1)
    # All that is seen along the edge lies in the plane of two viewing rays; the line in space does if it is the edge.
    across = _across(camera, uv, direction)
    mismatch = np.arcsin(np.clip(np.abs((line * across).sum(axis=-1)) / np.maximum(sine, 1e-9), 0.0, 1.0))
    ridge = ((after - before) * across).sum(axis=-1) > 0.0
    turn = np.where(ridge, 1.0, -1.0) * np.arctan2(sine, cosine)
    return Fold(np.where(there, turn, np.nan), np.where(there, mismatch, np.nan))


def _across(
    camera: Camera, uv: Float[np.ndarray, "points 2"], direction: Float[np.ndarray, "points 2"]
) -> Float[np.ndarray, "points 3"]:
    """Unit normal, on the side of `direction`, of the plane that projects to the edge's line."""
    along = np.stack([-direction[:, 1], direction[:, 0]], axis=-1)
    first, second = (camera.unproject(uv + t * along, np.ones(len(uv))) for t in (-1.0, 1.0))
    sight = np.zeros_like(first) + np.array([0.0, 0.0, 1.0]) if camera.is_orthographic else first
    normal = np.cross(second - first, sight)
    return normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
