"""Measuring the determination rules: the scales of what a true attitude leaves, and each rule's error by group."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from itree_cad.symmetry import Symmetries
from jaxtyping import Array, Float, Int

from itree_jax.features.region import RegionFeatures
from itree_jax.tree.appearances import Appearances
from itree_jax.tree.choice import ERROR_BOUND, wilson_interval
from itree_jax.tree.determination_rules import (
    ROTATIONS,
    AppearanceArrays,
    DeterminationScales,
    aligned,
    egi_candidates,
    egi_elsewhere,
    outline_distance,
    tilt_from,
)
from itree_jax.tree.draws import Draws
from itree_jax.tree.tree import Determination

ROW_BATCH = 256  # appearance rows are padded to a multiple, so that few shapes are compiled
REACH = float(np.radians(20.0))  # refinement converges from here: an attitude within it is determined
LEAST_UNIQUENESS = 0.15  # moments within 30 % of each other: noise of the boundary turns the direction at will
FLOORS = (np.radians(3.0), np.radians(3.0), 0.03, 0.03, 0.03)  # no scale is trusted below what other parts' shadows change
DRAWS_AT_ONCE = 64
RULES = ("A1", "A2", "A4", "A5")


def appearance_arrays(table: Appearances, group_of_view: Int[np.ndarray, "views"], rolls: int, base_only: bool) -> tuple[
    AppearanceArrays, Int[np.ndarray, "rows"]
]:
    """Rows for determination, padded, and their index in the table. `base_only`: one rotation per viewer direction."""
    index = np.flatnonzero(table.attitude % rolls == 0) if base_only else np.arange(len(table.attitude))
    size = max(1, -(-len(index) // ROW_BATCH)) * ROW_BATCH

    def pad(values: np.ndarray) -> Array:
        return jnp.asarray(np.concatenate([values[index], np.zeros((size - len(index), *values.shape[1:]), values.dtype)]))

    arrays = AppearanceArrays(
        R_cam_obj=pad(table.R_cam_obj[table.attitude]),
        group=pad(group_of_view[table.view[table.attitude]].astype(np.int32)),
        area=pad(table.area), mean_normal=pad(table.mean_normal), egi=pad(table.egi), inertia=pad(table.inertia),
        outline=pad(table.outline), centroid_obj=pad(table.centroid_obj),
    )
    return arrays, np.concatenate([index, np.zeros(size - len(index), int)])


def attitude_error(
    R: Float[Array, "*n 3 3"], S: Float[Array, "3 3"], turns: Float[Array, "k 3 3"], axis: Float[Array, "3"]
) -> Float[Array, "*n"]:
    """Least angle [rad] between attitudes over the part's symmetries; `axis` is 0 unless the part is one of revolution."""
    same = jnp.einsum("ab,kbc->kac", S, turns)
    trace = jnp.einsum("...ab,kab->...k", R, same)
    turn = jnp.arccos(jnp.clip((trace - 1.0) / 2.0, -1.0, 1.0))
    tip = jnp.arccos(jnp.clip(jnp.einsum("...a,ka->...k", R @ axis, same @ axis), -1.0, 1.0))
    return jnp.min(jnp.where(jnp.sum(axis**2) > 0, tip, turn), axis=-1)


def symmetry_arrays(symmetries: Symmetries) -> tuple[Float[Array, "k 3 3"], Float[Array, "3"]]:
    """Discrete turns (identity first) and the axis of revolution (0 if none)."""
    axis = np.asarray(symmetries.continuous[0][0], np.float32) if symmetries.continuous else np.zeros(3, np.float32)
    return jnp.asarray(np.asarray(symmetries.discrete)[:, :3, :3], jnp.float32), jnp.asarray(axis)


@partial(jax.jit, static_argnames=())
def scale_samples(
    features: RegionFeatures, R_true: Float[Array, "draws 3 3"], group: Int[Array, "draws"], base: AppearanceArrays,
    rows: AppearanceArrays, turns: Float[Array, "k 3 3"], axis: Float[Array, "3"],
) -> Float[Array, "draws 5"]:
    """What the candidate nearest to the truth leaves: tilt, direction, outline, size, EGI share elsewhere."""

    def one(item):
        f, R, g = item
        candidates = aligned(f, base)
        own = ((base.group == g) & (base.area > 0))[:, None]
        error = jnp.where(own, attitude_error(candidates, R, turns, axis), jnp.inf)
        k, turn = jnp.unravel_index(jnp.argmin(error), error.shape)
        tilt = tilt_from(candidates[k, turn], base.R_cam_obj[k])
        distance = outline_distance(f.outline, base.outline)[k, turn]
        size = 0.25 * jnp.log(jnp.maximum(f.inertia.I_max, 1.0) / jnp.maximum(base.inertia[k, 0], 1.0))
        row_error = attitude_error(rows.R_cam_obj, R, turns, axis)
        row_error = row_error + jnp.where(jnp.sum(rows.mean_normal * f.mean_normal, -1) > 0.9, 0.0, 10.0)
        nearest = jnp.argmin(jnp.where(rows.area > 0, row_error, jnp.inf))
        elsewhere = egi_elsewhere(f.egi, rows.egi[nearest][None])[0]
        return jnp.stack([tilt, error[k, turn], distance, jnp.abs(size), elsewhere])

    return jax.lax.map(one, (features, R_true, group), batch_size=8)


@jax.jit
def rule_errors(
    features: RegionFeatures, R_true: Float[Array, "draws 3 3"], group: Int[Array, "draws"], base: AppearanceArrays,
    rows: AppearanceArrays, scales: DeterminationScales, turns: Float[Array, "k 3 3"], axis: Float[Array, "3"],
) -> Float[Array, "draws 4"]:
    """Attitude error [rad] left by A1 (best rotation given), A2, A4 (better of two), A5 (the one it picks)."""

    def one(item):
        f, R, g = item
        own = (base.group == g) & (base.area > 0)
        candidates = aligned(f, base)
        error = attitude_error(candidates, R, turns, axis)
        tilt = tilt_from(candidates, base.R_cam_obj[:, None])
        distance = outline_distance(f.outline, base.outline)
        penalty = 0.5 * (tilt / scales.tilt) ** 2 + 0.5 * (distance / scales.outline) ** 2
        penalty = jnp.where(own[:, None], penalty, jnp.inf)
        half = ROTATIONS // 2
        a1 = jnp.min(error[jnp.argmin(jnp.min(penalty, axis=1))])
        two = penalty[:, ::half]
        k = jnp.argmin(jnp.min(two, axis=1))
        a4 = jnp.min(error[k, ::half])
        flat = jnp.argmin(two)
        a5 = error[:, ::half].reshape(-1)[flat]
        prior = jnp.where(jnp.arange(base.group.shape[0]) == g, 0.0, -jnp.inf)
        best = egi_candidates(f, rows, prior, scales, 1)
        a2 = attitude_error(best.R_ray_obj[0], R, turns, axis)
        return jnp.stack([a1, a2, a4, a5])

    return jax.lax.map(one, (features, R_true, group), batch_size=8)


def in_batches(function, draws: Draws, *rest) -> Float[np.ndarray, "draws k"]:
    """Calls a compiled function on draws in batches of one size."""
    count, out = len(draws.group), []
    for first in range(0, count, DRAWS_AT_ONCE):
        index = np.minimum(np.arange(first, first + DRAWS_AT_ONCE), count - 1)
        features = jax.tree.map(lambda a, index=index: jnp.asarray(a[index]), draws.features)
        part = function(features, jnp.asarray(draws.R_cam_obj[index], jnp.float32), jnp.asarray(draws.group[index]), *rest)
        out.append(np.asarray(part)[: min(DRAWS_AT_ONCE, count - first)])
    return np.concatenate(out)


def measure_determination(
    table: Appearances, group_of_view: Int[np.ndarray, "views"], rolls: int, symmetries: Symmetries, train: Draws,
    test: Draws, group_count: int,
) -> Determination:
    """Scales from one set of draws, error rates from another."""
    base, _ = appearance_arrays(table, group_of_view, rolls, base_only=True)
    rows, _ = appearance_arrays(table, group_of_view, rolls, base_only=False)
    turns, axis = symmetry_arrays(symmetries)
    samples = in_batches(scale_samples, train, base, rows, turns, axis)
    spread = np.maximum(np.sqrt(np.mean(np.minimum(samples, np.median(samples, axis=0) * 4.0 + 1e-3) ** 2, axis=0)), FLOORS)
    scales = np.array([*spread, LEAST_UNIQUENESS], np.float32)
    errors = in_batches(rule_errors, test, base, rows, DeterminationScales(*map(jnp.float32, scales)), turns, axis)
    rate = np.full((group_count, len(RULES)), np.nan, np.float32)
    interval = np.full((group_count, len(RULES), 2), np.nan, np.float32)
    for g in range(group_count):
        own = errors[test.group == g]
        for r in range(len(RULES) if len(own) else 0):
            wrong = float(np.sum(own[:, r] > REACH))
            rate[g, r] = wrong / len(own)
            interval[g, r] = wilson_interval(wrong, len(own))
    chosen = [choose_steps(rate[g]) for g in range(group_count)]
    return Determination(
        rules=RULES, error=rate, error_interval=interval,
        draws=np.bincount(test.group, minlength=group_count).astype(np.int32),
        steps=tuple(c[0] for c in chosen), rotations_left=np.array([c[1] for c in chosen], np.int32), scales=scales,
    )


def choose_steps(rate: Float[np.ndarray, "rules"]) -> tuple[tuple[str, ...], int]:
    """Rules under the error bound in the paper's order, and the rotations they leave (0: open, all go on)."""
    if np.isnan(rate).all():
        return (), 0
    a1, a2, a4, a5 = rate
    viewer = ("A1",) if a1 < ERROR_BOUND else ()
    if a5 < ERROR_BOUND:
        return (*viewer, "A4", "A5"), 1
    if a2 < ERROR_BOUND:
        return (*viewer, "A2"), 1
    if a4 < ERROR_BOUND:
        return (*viewer, "A4"), 2
    return viewer, 0
