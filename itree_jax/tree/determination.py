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
    AppearanceArrays,
    DeterminationScales,
    about_normal,
    compare_shape,
    egi_candidates,
    egi_elsewhere,
    shape_candidates,
    within_roll,
)
from itree_jax.tree.draws import Draws
from itree_jax.tree.tree import Determination

ROW_BATCH = 256  # appearance rows are padded to a multiple, so that few shapes are compiled
REACH = float(np.radians(20.0))  # refinement converges from here: an attitude within it is determined
LEAST_UNIQUENESS = 0.15  # moments within 30 % of each other: noise of the boundary turns the direction at will
# No scale is trusted below what other parts' shadows change.
FLOORS = (np.radians(3.0), np.radians(3.0), 0.03, 0.03, 0.03)
OUTLIER = 4.0  # medians: what lies beyond is another region, not a deviation
SAME_REGION = 0.9  # cosine between mean normals: less than 26 degrees, for a step of roll on a face of 42 degrees
DRAWS_AT_ONCE = 64
SCALE_DRAWS, ERROR_DRAWS = 25, 200  # per group, at most: each is compared with every appearance at every turn
TURNS = 32  # about the mean normal, tried for the best one
RULES = ("A1", "A2", "A4", "A5")


def appearance_arrays(table: Appearances, group_of_view: Int[np.ndarray, "views"]) -> AppearanceArrays:
    """Rows for determination, padded with rows of area 0; row k is row k of the table."""
    count = len(table.attitude)
    extra = -count % ROW_BATCH

    def pad(values: np.ndarray) -> Array:
        return jnp.asarray(np.concatenate([values, np.zeros((extra, *values.shape[1:]), values.dtype)]))

    return AppearanceArrays(
        R_cam_obj=pad(table.R_cam_obj[table.attitude]),
        group=pad(group_of_view[table.view[table.attitude]].astype(np.int32)),
        area=pad(table.area), mean_normal=pad(table.mean_normal), egi=pad(table.egi), inertia=pad(table.inertia),
        outline=pad(table.outline), centroid_obj=pad(table.centroid_obj),
    )


def attitude_error(
    R: Float[Array, "*n 3 3"], S: Float[Array, "3 3"], turns: Float[Array, "k 3 3"], axes: Float[Array, "m 3"]
) -> Float[Array, "*n"]:
    """Least angle [rad] between attitudes over the part's symmetries, as `symmetry_arrays` gives them."""
    same = jnp.einsum("ab,kbc->kac", S, turns)
    if len(axes) > 1:  # a sphere
        return jnp.zeros(R.shape[:-2])
    if len(axes) == 1:
        cosine = jnp.einsum("...a,ka->...k", R @ axes[0], same @ axes[0])
    else:
        cosine = (jnp.einsum("...ab,kab->...k", R, same) - 1.0) / 2.0
    return jnp.min(jnp.arccos(jnp.clip(cosine, -1.0, 1.0)), axis=-1)


def symmetry_arrays(symmetries: Symmetries) -> tuple[Float[Array, "k 3 3"], Float[Array, "m 3"]]:
    """Discrete turns (identity first), and the axes of revolution: none, one, or more of a sphere."""
    axes = np.array([axis for axis, _ in symmetries.continuous], np.float32).reshape(-1, 3)
    return jnp.asarray(np.asarray(symmetries.discrete)[:, :3, :3], jnp.float32), jnp.asarray(axes)


@partial(jax.jit, static_argnames=("roll_step",))
def scale_samples(
    features: RegionFeatures, R_true: Float[Array, "draws 3 3"], group: Int[Array, "draws"], rows: AppearanceArrays,
    turns: Float[Array, "k 3 3"], axes: Float[Array, "m 3"], roll_step: float,
) -> Float[Array, "draws 5"]:
    """What the appearance nearest to the truth leaves: tilt, direction (NaN where there is none), outline, size, EGI
    share elsewhere."""

    def one(item):
        f, R, _ = item
        seen = compare_shape(f, rows)
        distance = jnp.where(within_roll(seen.turn, roll_step), seen.distance, jnp.inf)
        at = jnp.argmin(distance, axis=1)
        distance = jnp.take_along_axis(distance, at[:, None], axis=1)[:, 0]
        same = (rows.area > 0) & (jnp.cos(seen.tilt) > SAME_REGION)
        # of an attitude's regions with one mean normal, the one of the same shape
        away = attitude_error(rows.R_cam_obj, R, turns, axes) + 0.1 * jnp.minimum(distance, 1.0)
        k = jnp.argmin(jnp.where(same, away, jnp.inf))
        # any appearance within reach would do: the one that fits best
        within = same & (away < away[k] + REACH)
        elsewhere = jnp.min(jnp.where(within, egi_elsewhere(f.egi, rows.egi), jnp.inf))
        unique = jnp.minimum(f.inertia.uniqueness, rows.inertia[k, 3]) > LEAST_UNIQUENESS
        direction = jnp.where(unique, seen.direction[at[k]], jnp.nan)
        return jnp.stack([seen.tilt[k], direction, distance[k], jnp.abs(seen.size[k]), elsewhere])

    return jax.lax.map(one, (features, R_true, group), batch_size=4)


@partial(jax.jit, static_argnames=("roll_step",))
def rule_errors(
    features: RegionFeatures, R_true: Float[Array, "draws 3 3"], group: Int[Array, "draws"], rows: AppearanceArrays,
    scales: DeterminationScales, turns: Float[Array, "k 3 3"], axes: Float[Array, "m 3"], roll_step: float,
) -> Float[Array, "draws 4"]:
    """Attitude error [rad] left within the true group by A1 (the best turn about the mean normal given), A2, A4 (better
    of its two) and A5 (the one that it picks)."""
    angle = jnp.arange(TURNS) * (2.0 * jnp.pi / TURNS)

    def one(item):
        f, R, g = item
        prior = jnp.where(jnp.arange(rows.group.shape[0]) == g, 0.0, -jnp.inf)
        by_shape = shape_candidates(f, rows, prior, scales, 1, roll_step).R_ray_obj[0]
        error = attitude_error(about_normal(f.mean_normal, angle) @ by_shape, R, turns, axes)
        by_egi = egi_candidates(f, rows, prior, scales, 1).R_ray_obj[0]
        a2 = attitude_error(by_egi, R, turns, axes)
        return jnp.stack([jnp.min(error), a2, jnp.minimum(error[0], error[TURNS // 2]), error[0]])

    return jax.lax.map(one, (features, R_true, group), batch_size=4)


def scales_of(samples: Float[np.ndarray, "draws 5"]) -> Float[np.ndarray, "5"]:
    """Root mean square of each quantity (a direction that no draw has: the floor), outliers bounded; of the EGI's the
    lower quartile.

    Most of the mass that a draw has elsewhere comes from the appearances being 13 degrees apart, about as wide as the
    cells; a draw close to one of them shows what noise and shadow leave.
    """
    samples = np.where(np.isnan(samples).all(axis=0), 0.0, samples)
    typical = np.minimum(samples, OUTLIER * np.nanmedian(samples, axis=0) + 1e-3)
    spread = np.sqrt(np.nanmean(typical**2, axis=0))
    spread[4] = np.percentile(samples[:, 4], 25.0)
    return np.maximum(spread, FLOORS)


def first_of_each_group(draws: Draws, count: int) -> Draws:
    """The first `count` draws of every group."""
    index = np.sort(np.concatenate([np.flatnonzero(draws.group == g)[:count] for g in np.unique(draws.group)]))
    features = jax.tree.map(lambda a: a[index], draws.features)
    return Draws(features, draws.group[index], draws.R_cam_obj[index], draws.empty)


def in_batches(function, draws: Draws, *rest) -> Float[np.ndarray, "draws k"]:
    """Calls a compiled function on draws in batches of one size."""
    count, out = len(draws.group), []
    for first in range(0, count, DRAWS_AT_ONCE):
        index = np.minimum(np.arange(first, first + DRAWS_AT_ONCE), count - 1)
        features = jax.tree.map(lambda a, index=index: jnp.asarray(a[index]), draws.features)
        R_cam_obj = jnp.asarray(draws.R_cam_obj[index], jnp.float32)
        part = function(features, R_cam_obj, jnp.asarray(draws.group[index]), *rest)
        out.append(np.asarray(part)[: min(DRAWS_AT_ONCE, count - first)])
    return np.concatenate(out)


def measure_determination(
    table: Appearances, group_of_view: Int[np.ndarray, "views"], rolls: int, symmetries: Symmetries, train: Draws,
    test: Draws, group_count: int,
) -> Determination:
    """Scales from one set of draws, error rates from another."""
    train, test = first_of_each_group(train, SCALE_DRAWS), first_of_each_group(test, ERROR_DRAWS)
    rows = appearance_arrays(table, group_of_view)
    turns, axes = symmetry_arrays(symmetries)
    roll_step = 2.0 * np.pi / rolls
    samples = in_batches(partial(scale_samples, roll_step=roll_step), train, rows, turns, axes)
    scales = np.array([*scales_of(samples), LEAST_UNIQUENESS], np.float32)
    measured = DeterminationScales(*map(jnp.float32, scales))
    errors = in_batches(partial(rule_errors, roll_step=roll_step), test, rows, measured, turns, axes)
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
