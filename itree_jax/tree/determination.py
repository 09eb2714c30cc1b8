"""Measuring the determination rules: the scales of what a true attitude leaves, and each rule's error by group."""

from collections.abc import Iterator
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from itree_cad.symmetry import Symmetries
from jaxtyping import Array, Bool, Float, Int

from itree_jax.batches import multiple_above, on_all_cores
from itree_jax.features.region import RegionFeatures
from itree_jax.features.relation import MOST_MISFIT, THERE
from itree_jax.kept_functions import kept, on_device
from itree_jax.tree.appearance_rows import AppearanceArrays, DeterminationScales, bounded, take_rows, wrapped
from itree_jax.tree.appearances import Appearances
from itree_jax.tree.determination_family import DETERMINATION_RULE_NAMES
from itree_jax.tree.determination_relations import brothers_apart, compare_maps, relation_penalty
from itree_jax.tree.determination_rules import (
    FAR,
    about_normal,
    compare_shape,
    direction_penalty,
    egi_candidates,
    egi_elsewhere,
    facing,
    mass_centre_penalty,
    within_roll,
)
from itree_jax.tree.draws import Draws
from itree_jax.tree.error_rates import wilson_interval
from itree_jax.tree.freedom import choose_steps
from itree_jax.tree.tree import Determination
from itree_jax.tree.work_models import LEAST_UNIQUENESS

# Appearance rows, those of one group, and groups are padded to multiples, so that few shapes are compiled.
ROW_BATCH, GROUP_ROW_BATCH, GROUP_BATCH = 256, 512, 16
REACH = float(np.radians(20.0))  # refinement converges from here: an attitude within it is determined
# No scale is trusted below what other parts' shadows change.
FLOORS = (np.radians(3.0), np.radians(3.0), 0.03, 0.03, 0.03, np.radians(3.0), 0.03, 0.05, 0.05, 0.003)
OUTLIER = 4.0  # medians: what lies beyond is another region, not a deviation
SAME_REGION = 0.9  # cosine between mean normals: less than 26 degrees, for a step of roll on a face of 42 degrees
DRAWS_AT_ONCE = 40  # a fifth of a group's `ERROR_DRAWS`
SCALE_DRAWS, ERROR_DRAWS = 25, 200  # per group, at most: each is compared with every appearance at every turn
SHORTLIST = 96  # appearances whose maps are compared: a group of ten views at 12 rolls, with some of the next
TURNS = 32  # about the mean normal, tried for the best one
RULES = DETERMINATION_RULE_NAMES
EGI_SCALE = 4  # of the samples: the one whose quartile is taken


def appearance_arrays(
    table: Appearances, uses: Float[np.ndarray, "groups 8"], kept: Int[np.ndarray, "kept"] | None = None,
    least: int = ROW_BATCH,
) -> AppearanceArrays:
    """Rows for determination, padded with rows of area 0; row k is row k of the table, or of those that are `kept`.

    `uses`: 1 where a group's steps use a rule (`rules_used`). There are `least` rows or more.
    """
    index = np.arange(len(table.attitude)) if kept is None else kept
    extra = max(least, multiple_above(len(index), ROW_BATCH)) - len(index)

    def pad(values: np.ndarray) -> Array:
        return on_device(np.concatenate([values[index], np.zeros((extra, *values.shape[1:]), values.dtype)]))

    return AppearanceArrays(
        R_cam_obj=pad(table.R_cam_obj[table.attitude]),
        group=pad(table.group[table.attitude].astype(np.int32)),
        area=pad(table.area), mean_normal=pad(table.mean_normal),
        concentration=pad(np.linalg.norm(table.mass_centre, axis=-1)), egi=pad(table.egi), inertia=pad(table.inertia),
        outline=pad(table.outline), centroid_obj=pad(table.centroid_obj), brothers=pad(table.brothers),
        characteristic_map=pad(table.characteristic_map), edge_map=pad(table.edge_map),
        uses=on_device(uses, np.float32),
    )


def rules_used(steps: tuple[tuple[str, ...], ...]) -> Float[np.ndarray, "groups 8"]:
    """1 where a group's steps use a rule."""
    return np.array([[float(rule in of_group) for rule in RULES] for of_group in steps], np.float32)


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
    return on_device(np.asarray(symmetries.discrete)[:, :3, :3], np.float32), on_device(axes)


@kept("roll_step")
def scale_samples(
    features: RegionFeatures, R_true: Float[Array, "draws 3 3"], group: Int[Array, "draws"], rows: AppearanceArrays,
    turns: Float[Array, "k 3 3"], axes: Float[Array, "m 3"], roll_step: float,
) -> Float[Array, "draws 10"]:
    """What the appearance nearest to the truth leaves: tilt, direction (NaN where there is none), outline, size, EGI
    share elsewhere, direction toward a brother (NaN without one), the disagreement of characteristics, of edges and of
    both, and the difference of the EGI mass centres' lengths."""

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
        nearest = take_rows(rows, k[None])
        maps = jnp.stack([m[0, at[k]] for m in compare_maps(f, nearest)])
        toward = brother_deviation(f, nearest, at[k])
        rest = jnp.stack([seen.tilt[k], direction, distance[k], jnp.abs(seen.size[k]), elsewhere, toward])
        return jnp.concatenate([rest, maps, jnp.abs(seen.concentration[k])[None]])

    return jax.lax.map(one, (features, R_true, group), batch_size=4)


def brother_deviation(features: RegionFeatures, row: AppearanceArrays, at: Int[Array, ""]) -> Float[Array, ""]:
    """Angle [rad] between the directions toward a brother after a turn of the outline; NaN where there is none."""
    n_theta = row.outline.shape[-1]
    misfit, apart = jax.vmap(brothers_apart, in_axes=(0, None))(features.brothers, row.brothers[0])
    best = jnp.argmin(misfit)
    turned = wrapped(apart.reshape(-1)[best] - at * (2.0 * jnp.pi / n_theta))
    return jnp.where(misfit.reshape(-1)[best] < MOST_MISFIT, jnp.abs(turned), jnp.nan)


@kept("roll_step")
def rule_errors(
    features: RegionFeatures, R_true: Float[Array, "draws 3 3"], group: Int[Array, "draws"], rows: AppearanceArrays,
    scales: DeterminationScales, turns: Float[Array, "k 3 3"], axes: Float[Array, "m 3"], roll_step: float,
) -> Float[Array, "draws 8"]:
    """Attitude error [rad] that each rule leaves within the true group, given the rules before it.

    A1: at the best turn about the mean normal; A2: of the attitude that it picks; A3, A4: of the better of the two
    rotations that they leave; A5-A8: of the rotation that they pick among those that A1, A3 and A4 leave.
    """
    angle = jnp.arange(TURNS) * (2.0 * jnp.pi / TURNS)

    def one(item):
        f, R, g = item
        prior = jnp.where(jnp.arange(rows.uses.shape[0]) == g, 0.0, -jnp.inf)
        a2 = attitude_error(egi_candidates(f, rows, prior, scales, 1).R_ray_obj[0], R, turns, axes)
        seen = compare_shape(f, rows)
        own = (rows.area > 0) & (rows.group == g)
        base = mass_centre_penalty(seen.tilt, seen.concentration, scales) + bounded(seen.size / scales.size)
        base = base[:, None] + jnp.where(within_roll(seen.turn, roll_step), 0.0, FAR)
        base = jnp.where(own[:, None], base, jnp.inf)
        a3, a4 = relation_penalty(f, rows, scales), direction_penalty(f, rows, seen, scales)
        a5 = bounded(seen.distance / scales.outline)
        left = base + a3 + a4

        def attitude(penalty: Array, index: Array) -> Array:
            """The attitude of the least penalty; `index` are the rows of the appearances it is taken from."""
            k, at = jnp.unravel_index(jnp.argmin(penalty), penalty.shape)
            row = index[k]
            turn = about_normal(f.mean_normal, seen.turn[row, at][None])[0]
            return turn @ facing(rows, row[None], f.mean_normal)[0]

        def error(R_found: Array) -> Array:
            return attitude_error(R_found, R, turns, axes)

        every = jnp.arange(rows.area.shape[0])
        a1 = jnp.min(error(about_normal(f.mean_normal, angle) @ attitude(base, every)))
        half = about_normal(f.mean_normal, jnp.asarray([0.0, jnp.pi]))
        two = [jnp.min(error(half @ attitude(base + penalty, every))) for penalty in (a3, a4)]
        _, short = jax.lax.top_k(-jnp.min(left, axis=1), min(SHORTLIST, rows.area.shape[0]))
        maps = compare_maps(f, take_rows(rows, short))
        scaled = zip(maps, (scales.characteristic, scales.edges, scales.both), strict=True)
        pick = [error(attitude(left[short] + bounded(m / s), short)) for m, s in scaled]
        return jnp.stack([a1, a2, *two, error(attitude(left + a5, every)), *pick])

    return jax.lax.map(one, (features, R_true, group), batch_size=4)


def scales_of(samples: Float[np.ndarray, "draws k"]) -> Float[np.ndarray, "k"]:
    """Root mean square of each quantity (a direction that no draw has: the floor), outliers bounded; of the EGI's the
    lower quartile.

    Most of the mass that a draw has elsewhere comes from the appearances being 13 degrees apart, about as wide as the
    cells; a draw close to one of them shows what noise and shadow leave.
    """
    samples = np.where(np.isnan(samples).all(axis=0), 0.0, samples)
    typical = np.minimum(samples, OUTLIER * np.nanmedian(samples, axis=0) + 1e-3)
    spread = np.sqrt(np.nanmean(typical**2, axis=0))
    spread[EGI_SCALE] = np.percentile(samples[:, EGI_SCALE], 25.0)
    return np.maximum(spread, FLOORS[: len(spread)])


def first_of_each_group(draws: Draws, count: int) -> Draws:
    """The first `count` draws of every group."""
    first = [np.flatnonzero(draws.group == g)[:count] for g in np.unique(draws.group)]
    return draws.take(np.sort(np.concatenate(first)))


def in_batches(function, draws: Draws, *rest) -> Float[np.ndarray, "draws k"]:
    """Calls a compiled function on draws in batches of one size."""
    count = len(draws.group)

    def of_batch(first: int) -> np.ndarray:
        index = np.minimum(np.arange(first, first + DRAWS_AT_ONCE), count - 1)
        features = jax.tree.map(lambda a: jnp.asarray(a[index]), draws.features)
        R_cam_obj = jnp.asarray(draws.R_cam_obj[index], jnp.float32)
        part = function(features, R_cam_obj, jnp.asarray(draws.group[index]), *rest)
        return np.asarray(part)[: min(DRAWS_AT_ONCE, count - first)]

    return np.concatenate(on_all_cores(of_batch, range(0, count, DRAWS_AT_ONCE)))


def measure_determination(
    table: Appearances, rolls: int, symmetries: Symmetries, train: Draws, test: Draws, group_count: int, policy: str
) -> Determination:
    """Scales from one set of draws, error rates from another: of whole regions by policy `paper`, else of both."""
    train = first_of_each_group(train, SCALE_DRAWS)
    if policy == "paper":
        test = test.take(np.flatnonzero(~test.cut))
    test = first_of_each_group(test, ERROR_DRAWS)
    unused = np.zeros((multiple_above(group_count, GROUP_BATCH), len(RULES)), np.float32)
    rows = appearance_arrays(table, unused)
    turns, axes = symmetry_arrays(symmetries)
    roll_step = 2.0 * np.pi / rolls
    samples = in_batches(partial(scale_samples, roll_step=roll_step), train, rows, turns, axes)
    found = scales_of(samples)
    scales = np.array([*found[:5], LEAST_UNIQUENESS, *found[5:]], np.float32)
    measured = DeterminationScales(*map(jnp.float32, scales))
    errors = np.full((len(test.group), len(RULES)), np.nan)
    for g, own_rows in rows_by_group(table, unused, np.unique(test.group)):
        own = np.flatnonzero(test.group == g)
        error = partial(rule_errors, roll_step=roll_step)
        errors[own] = in_batches(error, test.take(own), own_rows, measured, turns, axes)
    rate = np.full((group_count, len(RULES)), np.nan, np.float32)
    interval = np.full((group_count, len(RULES), 2), np.nan, np.float32)
    for g in range(group_count):
        own = errors[test.group == g]
        for r in range(len(RULES) if len(own) else 0):
            wrong = float(np.sum(own[:, r] > REACH))
            rate[g, r] = wrong / len(own)
            interval[g, r] = wilson_interval(wrong, len(own))
    related = brothers_expected(table, group_count)
    chosen = [choose_steps(rate[g], bool(related[g]), policy) for g in range(group_count)]
    return Determination(
        rules=RULES, error=rate, error_interval=interval,
        draws=np.bincount(test.group, minlength=group_count).astype(np.int32),
        steps=tuple(c[0] for c in chosen), rotations_left=np.array([c[1] for c in chosen], np.int32), scales=scales,
    )


def rows_by_group(
    table: Appearances, uses: Float[np.ndarray, "groups 8"], groups: Int[np.ndarray, "n"]
) -> Iterator[tuple[int, AppearanceArrays]]:
    """The appearances of each group, as many rows for each: `rule_errors` asks no others of a draw of the group."""
    of_row = table.group[table.attitude]
    least = multiple_above(int(np.bincount(of_row).max()), GROUP_ROW_BATCH)
    for g in groups:
        yield int(g), appearance_arrays(table, uses, np.flatnonzero(of_row == g), least)


def brothers_expected(table: Appearances, group_count: int) -> Bool[np.ndarray, "groups"]:
    """Whether half of a group's appearances or more show a brother region: A3 is no rule for the others."""
    group = table.group[table.attitude]
    count = np.bincount(group, minlength=group_count)
    with_brother = np.bincount(group, weights=table.brothers[:, 0, THERE] > 0, minlength=group_count)
    return with_brother >= 0.5 * np.maximum(count, 1)
