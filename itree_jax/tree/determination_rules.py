"""Determination rules A1-A8: candidate attitudes of a region, with their log-likelihoods (Ikeuchi 1987, sec. 2.2.1).

Every appearance (view x roll) is turned so that its mean normal is the region's (A1), then about that normal by no more
than half a step of roll: as far as its cast shadows hold. A3 compares the directions toward the brother regions, A4 the
inertia directions, A5 the outlines d(theta), A6 where the surface characteristics lie, A7 where the edges do, A8 both
at once. A2 compares the whole extended Gaussian image and needs no outline, so that cut regions keep their orientation
content. A5 looks at all turns of all appearances; A6-A8, which cost more, at those that A1, A3 and A4 leave.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from itree_jax.features.rectify import face_axes, gradient_space
from itree_jax.features.region import RegionFeatures
from itree_jax.tree.appearance_rows import (
    MOST_PENALTY,
    AppearanceArrays,
    DeterminationScales,
    bounded,
    take_rows,
    wrapped,
)
from itree_jax.tree.determination_relations import map_penalty

FAR = 1e3  # penalty of a turn that no appearance stands for [log-likelihood]
PROMISING = 1024  # appearances whose outlines are compared: of the others mean normal and EGI say enough


class Candidates(NamedTuple):
    """Attitudes in the frame of the region's viewing ray, with the appearance row they come from."""

    R_ray_obj: Float[Array, "*n 3 3"]
    row: Int[Array, "*n"]
    log_likelihood: Float[Array, "*n"]


class ShapeComparison(NamedTuple):
    """A region beside every appearance, turned by A1; `turns` are rotations about the mean normal, one per direction of
    the outline."""

    tilt: Float[Array, "rows"]  # between the mean normals [rad]
    turn: Float[Array, "rows turns"]  # about the mean normal, from the face's x' to its y' [rad], -pi..pi
    direction: Float[Array, "turns"]  # between the inertia directions [rad], 0..pi/2
    distance: Float[Array, "rows turns"]  # relative rms distance of the outlines
    size: Float[Array, "rows"]  # log of the ratio of lengths
    concentration: Float[Array, "rows"]  # difference of the lengths of the EGI mass centres


def compare_shape(features: RegionFeatures, rows: AppearanceArrays) -> ShapeComparison:
    """One region against all appearances."""
    n_theta = rows.outline.shape[-1]
    p, q = gradient_space(features.mean_normal)
    e1, e2 = face_axes(p, q)
    after_turn = jax.vmap(direction_after_turn, in_axes=(0, 0, None))
    toward = after_turn(rows.mean_normal, rows.inertia[:, 2], features.mean_normal)
    lag = features.inertia.alpha - jnp.arctan2(toward @ e2, toward @ e1)  # appearance's direction to region's
    step = jnp.arange(n_theta) * (2.0 * jnp.pi / n_theta)
    half = jnp.pi / 2.0
    tilt, concentration = compare_mass_centres(features, rows)
    lengths = jnp.log(jnp.maximum(features.inertia.I_max, 1.0)) - jnp.log(jnp.maximum(rows.inertia[:, 0], 1.0))
    return ShapeComparison(
        tilt=tilt,
        turn=wrapped(lag[:, None] + step[None, :]),
        direction=half - jnp.abs(half - step % jnp.pi),
        distance=outline_distance(features.outline, rows.outline),
        size=0.25 * lengths,
        concentration=concentration,
    )


def direction_after_turn(
    normal: Float[Array, "3"], alpha: Float[Array, ""], target: Float[Array, "3"]
) -> Float[Array, "3"]:
    """The 3-D inertia direction of a region after the smallest turn that takes its mean normal to `target`."""
    e1, e2 = face_axes(*gradient_space(normal))
    return shortest_turn(normal, target) @ (jnp.cos(alpha) * e1 + jnp.sin(alpha) * e2)


def outline_distance(
    outline: Float[Array, "n_theta"], table: Float[Array, "rows n_theta"]
) -> Float[Array, "rows turns"]:
    """Relative rms distance of d(theta) from every appearance's turned by each 2 pi k/n_theta from x' to y'."""
    n_theta = outline.shape[0]
    k = jnp.arange(n_theta)
    turned_back = outline[(k[None, :] + k[:, None]) % n_theta]
    size = jnp.maximum(jnp.mean(table, axis=-1), 1e-6)
    power = jnp.mean(table**2, axis=-1)[:, None] + jnp.mean(outline**2)
    mean_square = power - 2.0 * (table @ turned_back.T) / n_theta
    return jnp.sqrt(jnp.maximum(mean_square, 0.0)) / size[:, None]


def egi_elsewhere(egi: Float[Array, "cells"], table: Float[Array, "rows cells"]) -> Float[Array, "rows"]:
    """Share of the region's mass that an appearance doesn't have there: 0 for a part of it, whatever was cut off."""
    total = jnp.maximum(jnp.sum(egi), 1e-6)
    return 1.0 - jnp.sum(jnp.minimum(egi, table), axis=-1) / total


def egi_penalty(
    features: RegionFeatures, rows: AppearanceArrays, scales: DeterminationScales
) -> tuple[Float[Array, "rows"], Float[Array, "rows"]]:
    """A2's penalties of mass beyond all that an appearance has, and of mass that it hasn't where the region has it."""
    elsewhere = egi_elsewhere(features.egi, rows.egi)
    excess = jnp.log(jnp.maximum(features.area, 1.0)) - jnp.log(jnp.maximum(rows.area, 1.0))
    return 0.5 * (jnp.maximum(excess, 0.0) / (2.0 * scales.size)) ** 2, 0.5 * (elsewhere / scales.egi) ** 2


def shape_candidates(
    features: RegionFeatures, rows: AppearanceArrays, group_log_prior: Float[Array, "groups"],
    scales: DeterminationScales, most: int, roll_step: float,
) -> Candidates:
    """A1-A8: the best `most` appearances by mean normal, EGI, inertia direction, size and outline, then by the brothers
    and by what lies where, each at its best turn.

    Brothers and maps count in groups whose determination steps use them. `roll_step` [rad] is the angle between the
    rolls of the appearances. Outlines are compared of the `PROMISING` appearances for which mean normal, EGI and group
    leave most room: no appearance is likelier than that.
    """
    excess, elsewhere = egi_penalty(features, rows, scales)
    tilt, concentration = compare_mass_centres(features, rows)
    a1 = mass_centre_penalty(tilt, concentration, scales)
    most_that = group_log_prior[rows.group] - a1 - elsewhere - jnp.minimum(excess, MOST_PENALTY)
    most_that = jnp.where(rows.area > 0, most_that, -jnp.inf)
    bound, promising = jax.lax.top_k(most_that, min(max(PROMISING, 2 * most), rows.area.shape[0]))
    some = take_rows(rows, promising)
    seen = compare_shape(features, some)
    a4 = direction_penalty(features, some, seen, scales)
    a5 = bounded(seen.distance / scales.outline)
    penalty = a4 + a5 + jnp.where(within_roll(seen.turn, roll_step), 0.0, FAR)
    at = jnp.argmin(penalty, axis=1)
    whole = jnp.take_along_axis(penalty, at[:, None], axis=1)[:, 0] + bounded(seen.size / scales.size)
    value, k = jax.lax.top_k(bound - whole, min(2 * most, len(bound)))
    value = value - map_penalty(features, take_rows(rows, promising[k]), scales, at[k])
    value, kept = jax.lax.top_k(value, most)
    k = k[kept]
    row = promising[k]
    R = about_normal(features.mean_normal, seen.turn[k, at[k]]) @ facing(rows, row, features.mean_normal)
    return Candidates(R, row, value)


def compare_mass_centres(
    features: RegionFeatures, rows: AppearanceArrays
) -> tuple[Float[Array, "rows"], Float[Array, "rows"]]:
    """Angles [rad] between the mean normals, and differences of the lengths of the EGI mass centres."""
    cosine = jnp.clip(rows.mean_normal @ features.mean_normal, -1.0, 1.0)
    return jnp.arccos(cosine), jnp.sqrt(jnp.sum(features.mass_centre**2) + 1e-12) - rows.concentration


def mass_centre_penalty(
    tilt: Float[Array, "rows"], concentration: Float[Array, "rows"], scales: DeterminationScales
) -> Float[Array, "rows"]:
    """A1: of the angle between the EGI mass centres, and of their lengths, which a cut region changes."""
    return 0.5 * (tilt / scales.tilt) ** 2 + bounded(concentration / scales.concentration)


def direction_penalty(
    features: RegionFeatures, rows: AppearanceArrays, seen: ShapeComparison, scales: DeterminationScales
) -> Float[Array, "rows turns"]:
    """A4: of the angle between inertia directions, where both have one."""
    unique = (features.inertia.uniqueness > scales.least_uniqueness) & (rows.inertia[:, 3] > scales.least_uniqueness)
    return jnp.where(unique[:, None], bounded(seen.direction / scales.direction)[None, :], 0.0)


def within_roll(turn: Float[Array, "*n"], roll_step: float) -> Array:
    """Turns that the appearance of the next roll doesn't stand for better; never empty."""
    return jnp.abs(turn) <= 0.5 * (roll_step + 2.0 * jnp.pi / turn.shape[-1])


def egi_candidates(
    features: RegionFeatures, rows: AppearanceArrays, group_log_prior: Float[Array, "groups"],
    scales: DeterminationScales, most: int,
) -> Candidates:
    """A2: the best `most` attitudes by extended Gaussian image, each turned the short way so that A1 agrees."""
    excess, elsewhere = egi_penalty(features, rows, scales)
    missing = 1.0 - (1.0 - egi_elsewhere(features.egi, rows.egi)) * jnp.sum(features.egi) / jnp.maximum(rows.area, 1.0)
    # a whole region is likelier than a part of one, but not by much
    score = group_log_prior[rows.group] - excess - elsewhere - 0.5 * missing**2
    score = jnp.where(rows.area > 0, score, -jnp.inf)
    value, row = jax.lax.top_k(score, most)
    return Candidates(facing(rows, row, features.mean_normal), row, value)


def facing(rows: AppearanceArrays, row: Int[Array, "n"], mean_normal: Float[Array, "3"]) -> Float[Array, "n 3 3"]:
    """A1: attitudes of these rows after the smallest turn that gives their regions this mean normal."""
    turn = jax.vmap(shortest_turn, in_axes=(0, None))(rows.mean_normal[row], mean_normal)
    return turn @ rows.R_cam_obj[row]


def shortest_turn(a: Float[Array, "3"], b: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """The smallest rotation that takes unit vector a to unit vector b (not opposite: both face the viewer)."""
    v = jnp.cross(a, b)
    K = cross_matrix(v)
    return jnp.eye(3) + K + K @ K / (1.0 + jnp.sum(a * b))


def about_normal(mean_normal: Float[Array, "3"], turn: Float[Array, "*n"]) -> Float[Array, "*n 3 3"]:
    """Rotations about the mean normal, from the face's x' to its y': against the normal's own sense, which faces the
    viewer."""
    K = cross_matrix(-mean_normal)
    s, c = jnp.sin(turn)[..., None, None], jnp.cos(turn)[..., None, None]
    return jnp.eye(3) + s * K + (1.0 - c) * (K @ K)


def cross_matrix(v: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """K with K x = v x x."""
    zero = jnp.zeros_like(v[0])
    return jnp.stack([jnp.stack([zero, -v[2], v[1]]), jnp.stack([v[2], zero, -v[0]]), jnp.stack([-v[1], v[0], zero])])
