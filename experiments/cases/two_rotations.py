"""The two rotations that A3 or A4 leave: which attitudes they are, and what the rules A5-A8 say between them.

The inertia direction is known up to a half turn. Of an attitude with two regions, the highest may be either: the
direction toward the brother (A3) leaves one half turn of each.
"""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from cases.recognised import Recognised
from cases.work_models import RegionModel
from itree_jax.features.edge_support import edge_support
from itree_jax.features.prominent_edges import edge_table
from itree_jax.features.relation import MOST_MISFIT, THERE, brother_angle, brother_misfit
from itree_jax.tree.appearance_rows import DeterminationScales, bounded, take_rows
from itree_jax.tree.determination import appearance_arrays, attitude_error, rules_used, symmetry_arrays
from itree_jax.tree.determination_family import DETERMINATION_RULES
from itree_jax.tree.determination_relations import relation_penalty
from itree_jax.tree.determination_rules import (
    FAR,
    about_normal,
    compare_shape,
    direction_after_turn,
    facing,
    mass_centre_penalty,
    shortest_turn,
    within_roll,
)

NAMES = ("a", "b")


@dataclass(frozen=True)
class Rotation:
    """One supposed rotation of the target region's face."""

    name: str  # "a" or "b"
    model: RegionModel
    turn: float  # [rad] beyond the maximum inertia direction: 0 or pi
    R_ray_obj: Float[np.ndarray, "3 3"]  # the representative attitude, turned by A1 and by this rotation
    error: float  # [rad] between the part's axis (x) under it and in truth: near 0, or half a turn

    @property
    def outline(self) -> Float[np.ndarray, "n_theta"]:
        """d(theta) of the model from the region's maximum inertia direction."""
        half = len(self.model.outline) // 2 if self.turn else 0
        return np.roll(self.model.outline, half)


def two_rotations(r: Recognised) -> tuple[Rotation, Rotation]:
    """Half turns of the one region that the attitude shows, or one half turn of each of two."""
    if len(r.models) == 1:
        found = [(r.models[0], turn) for turn in (0.0, np.pi)]
    else:
        found = [(model, turn_toward_brother(r, model)) for model in r.models[:2]]
    a, b = (rotation(r, name, *f) for name, f in zip(NAMES, found, strict=True))
    return a, b


def turn_toward_brother(r: Recognised, model: RegionModel) -> float:
    """A3: the half turn under which the model's brother lies where one is seen; the region's nearest one counts."""
    apart = float(brother_angle(r.features.brothers[best_brother(r)]) - brother_angle(model.brothers[0]))
    return 0.0 if np.cos(apart) > 0 else np.pi


def best_brother(r: Recognised) -> int:
    """Of the regions beside the target, the one that looks most like the group's brother (rule L6)."""
    return int(np.argmin(brother_misfits(r)))


def brother_misfits(r: Recognised) -> Float[np.ndarray, "most"]:
    """How many sigmas each region beside the target differs from the brother of the group's representative attitude."""
    seen = r.features.brothers
    misfit = np.full(len(seen), MOST_MISFIT)
    for k, m in ((k, m) for k in np.flatnonzero(seen[:, THERE] > 0) for m in r.with_brother):
        expected = jnp.asarray(m.brothers[0], jnp.float32)
        misfit[k] = min(misfit[k], float(brother_misfit(jnp.asarray(seen[k]), expected, jnp.asarray(True))))
    return misfit


def rotation(r: Recognised, name: str, model: RegionModel, turn: float) -> Rotation:
    frame = r.frame
    normal, own = jnp.asarray(frame.mean_normal, jnp.float32), jnp.asarray(model.mean_normal, jnp.float32)
    along, across = frame.inertia_axes()
    toward = np.asarray(direction_after_turn(own, jnp.float32(model.alpha), normal), float)
    lag = np.float32(turn - np.arctan2(toward @ across, toward @ along))
    R = np.asarray(about_normal(normal, jnp.asarray([lag]))[0] @ shortest_turn(own, normal), float) @ model.R_cam_obj
    true = frame.R_ray_cam @ r.measured.case_scene.target.R_cam_obj
    return Rotation(name, model, turn, R, float(np.arccos(np.clip(R[:, 0] @ true[:, 0], -1.0, 1.0))))


def right_one(rotations: tuple[Rotation, Rotation]) -> Rotation:
    return min(rotations, key=lambda rotation: rotation.error)


def edges_found(r: Recognised, rotation: Rotation) -> Float[np.ndarray, "k"]:
    """Support 0..1 of each edge of the rotation's work model on the edge map of the region."""
    if not rotation.model.edges:
        return np.zeros(0)
    table = jnp.asarray(edge_table(rotation.model.edges, len(rotation.model.edges)))
    f = r.frame
    of_region = (jnp.asarray(f.T, jnp.float32), jnp.asarray(f.centroid, jnp.float32))
    alpha = jnp.float32(f.alpha + rotation.turn)
    return np.asarray(edge_support(jnp.asarray(r.edges), table, *of_region, alpha, jnp.float32(f.pitch)))


def mean_support(rotation: Rotation, support: Float[np.ndarray, "k"]) -> float:
    """Of all edges together, weighted with their lengths."""
    length = np.array([np.linalg.norm(edge.end - edge.start) for edge in rotation.model.edges])
    return float(support @ length / length.sum()) if len(length) else 0.0


def rule_preferences(
    r: Recognised, rotations: tuple[Rotation, Rotation]
) -> dict[str, tuple[float, float]]:
    """Of A5-A8 the least penalty [nat] of the group's appearances near either rotation, A1, A3 and A4 included.

    This is what the tree compares: all its appearances, not the representative attitude alone.
    """
    tree = r.tree
    rows = appearance_arrays(tree.appearances, rules_used(tree.determination.steps))
    rows = take_rows(rows, jnp.flatnonzero((rows.group == r.wanted) & (rows.area > 0)))
    scales = DeterminationScales(*(jnp.float32(s) for s in tree.determination.scales))
    f = r.features
    seen = compare_shape(f, rows)
    left = mass_centre_penalty(seen.tilt, seen.concentration, scales) + bounded(seen.size / scales.size)
    left = left[:, None] + jnp.where(within_roll(seen.turn, 2.0 * np.pi / tree.rolls), 0.0, FAR)
    left = left + relation_penalty(f, rows, scales)
    penalty = {rule.name: rule.penalty(f, rows, scales) for rule in DETERMINATION_RULES if rule.penalty}
    left = np.asarray(left + penalty["A4"])
    R = facing(rows, jnp.arange(len(left)), f.mean_normal)
    R = jnp.einsum("rtab,rbc->rtac", about_normal(f.mean_normal, seen.turn), R)
    turns, axes = symmetry_arrays(tree.symmetries)
    apart = [np.asarray(attitude_error(R, jnp.asarray(k.R_ray_obj, jnp.float32), turns, axes)) for k in rotations]
    nearer_a = apart[0] < apart[1]
    return {
        name: (least(left + np.asarray(penalty[name]), nearer_a), least(left + np.asarray(penalty[name]), ~nearer_a))
        for name in ("A5", "A6", "A7", "A8")
    }


def least(penalty: Float[np.ndarray, "rows turns"], where: np.ndarray) -> float:
    return float(np.where(where, penalty, np.inf).min())
