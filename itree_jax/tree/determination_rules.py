"""Determination rules A1, A2, A4, A5: candidate attitudes of a region, with their log-likelihoods (sec. 2.2.1).

A1 turns an appearance so that the EGI mass centres agree; A4 turns it about them so that the inertia directions agree
(two candidates); A5 compares the outlines d(theta) under each remaining rotation. A2 compares the whole extended
Gaussian image with that of every attitude and needs no outline, so that cut regions keep their orientation content.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from itree_jax.features.rectify import face_axes, gradient_space
from itree_jax.features.region import RegionFeatures

ROTATIONS = 16  # candidates about the mass centre where A4 can't tell: every 22.5 degrees, half of it within reach of
# refinement; a divisor of the outline's 64 directions


class AppearanceArrays(NamedTuple):
    """Rows of `Appearances` as determination reads them (padded rows have area 0)."""

    R_cam_obj: Float[Array, "rows 3 3"]
    group: Int[Array, "rows"]
    area: Float[Array, "rows"]
    mean_normal: Float[Array, "rows 3"]
    egi: Float[Array, "rows cells"]
    inertia: Float[Array, "rows 4"]
    outline: Float[Array, "rows n_theta"]
    centroid_obj: Float[Array, "rows 3"]


class DeterminationScales(NamedTuple):
    """Spread of what a true attitude leaves, measured on noisy draws."""

    tilt: Float[Array, ""]  # of the viewer direction [rad]: the dome's cells and A1's error
    direction: Float[Array, ""]  # of A4's direction [rad]
    outline: Float[Array, ""]  # of A5's relative distance
    size: Float[Array, ""]  # of log lengths
    egi: Float[Array, ""]  # of the share of mass that A2 finds elsewhere
    least_uniqueness: Float[Array, ""]  # below it a region has no inertia direction


class Candidates(NamedTuple):
    """Attitudes in the frame of the region's viewing ray, with the appearance row they come from."""

    R_ray_obj: Float[Array, "*n 3 3"]
    row: Int[Array, "*n"]
    log_likelihood: Float[Array, "*n"]


def inertia_frame(mean_normal: Float[Array, "3"], alpha: Float[Array, ""]) -> Float[Array, "3 3"]:
    """Columns: inertia direction on the face, its complement, mean normal (all 3-D, unit, right-handed)."""
    p, q = gradient_space(mean_normal)
    e1, e2 = face_axes(p, q)
    a = jnp.cos(alpha) * e1 + jnp.sin(alpha) * e2
    return jnp.stack([a, jnp.cross(mean_normal, a), mean_normal], axis=-1)


def egi_elsewhere(egi: Float[Array, "cells"], table: Float[Array, "rows cells"]) -> Float[Array, "rows"]:
    """Share of the region's mass that an appearance doesn't have there: 0 for a part of it, whatever was cut off."""
    total = jnp.maximum(jnp.sum(egi), 1e-6)
    return 1.0 - jnp.sum(jnp.minimum(egi, table), axis=-1) / total


def outline_distance(
    outline: Float[Array, "n_theta"], table: Float[Array, "rows n_theta"]
) -> Float[Array, "rows rotations"]:
    """Relative rms distance of d(theta) from every appearance's under every rotation."""
    n_theta = outline.shape[0]
    shift = jnp.arange(ROTATIONS) * (n_theta // ROTATIONS)
    # theta runs from e1 to e2, against the turn about the mean normal (which faces the viewer)
    turned = outline[(jnp.arange(n_theta)[None, :] - shift[:, None]) % n_theta]
    size = jnp.maximum(jnp.mean(table, axis=-1), 1e-6)
    power = jnp.mean(table**2, axis=-1)[:, None] + jnp.mean(turned**2, axis=-1)[None, :]
    mean_square = power - 2.0 * (table @ turned.T) / n_theta
    return jnp.sqrt(jnp.maximum(mean_square, 0.0)) / size[:, None]


def aligned(features: RegionFeatures, rows: AppearanceArrays) -> Float[Array, "rows rotations 3 3"]:
    """A1 then every rotation about the mass centre; rotation 0 and the opposite one are A4's two candidates."""
    observed = inertia_frame(features.mean_normal, features.inertia.alpha)
    angle = 2.0 * jnp.pi * jnp.arange(ROTATIONS) / ROTATIONS
    c, s, o = jnp.cos(angle), jnp.sin(angle), jnp.zeros(ROTATIONS)
    turn = jnp.stack([c, -s, o, s, c, o, o, o, o + 1.0], axis=-1).reshape(-1, 3, 3)
    model = inertia_frames(rows)
    in_frame = jnp.einsum("kca,kcb->kab", model, rows.R_cam_obj)  # model frame <- part
    return jnp.einsum("ac,tcd,kdb->ktab", observed, turn, in_frame)


def inertia_frames(rows: AppearanceArrays) -> Float[Array, "rows 3 3"]:
    """Inertia frames of all rows."""
    return jax.vmap(inertia_frame)(rows.mean_normal, rows.inertia[:, 2])


def tilt_from(R_ray_obj: Float[Array, "*n 3 3"], R_cam_obj: Float[Array, "*n 3 3"]) -> Float[Array, "*n"]:
    """Angle [rad] between the viewer directions of two attitudes, in the part's frame."""
    cosine = jnp.sum(R_ray_obj[..., 2, :] * R_cam_obj[..., 2, :], axis=-1)
    return jnp.arccos(jnp.clip(cosine, -1.0, 1.0))


def shape_candidates(
    features: RegionFeatures, rows: AppearanceArrays, group_log_prior: Float[Array, "groups"],
    scales: DeterminationScales, most: int,
) -> Candidates:
    """A1, A4, A5: the best `most` attitudes by mass centre, inertia direction, size and outline."""
    R = aligned(features, rows)
    tilt = tilt_from(R, rows.R_cam_obj[:, None])
    distance = outline_distance(features.outline, rows.outline)
    size = 0.25 * (jnp.log(jnp.maximum(features.inertia.I_max, 1.0)) - jnp.log(jnp.maximum(rows.inertia[:, 0], 1.0)))
    step = 2.0 * jnp.pi / ROTATIONS
    k = jnp.arange(ROTATIONS)
    half_turns = step * jnp.minimum(k % (ROTATIONS // 2), (-k) % (ROTATIONS // 2))
    unique = (features.inertia.uniqueness > scales.least_uniqueness) & (rows.inertia[:, 3] > scales.least_uniqueness)
    # a region that was cut lies about its direction and outline: their penalties are bounded
    a1 = 0.5 * (tilt / scales.tilt) ** 2
    a4 = jnp.where(unique[:, None], jnp.minimum(0.5 * (half_turns[None, :] / scales.direction) ** 2, 4.0), 0.0)
    a5 = jnp.minimum(0.5 * (distance / scales.outline) ** 2, 4.0)
    l1 = jnp.minimum(0.5 * (size / scales.size) ** 2, 4.0)[:, None]
    score = -(a1 + a4 + a5 + l1) + group_log_prior[rows.group][:, None]
    score = jnp.where(rows.area[:, None] > 0, score, -jnp.inf)
    return best(R.reshape(-1, 3, 3), jnp.repeat(jnp.arange(len(rows.area)), ROTATIONS), score.reshape(-1), most)


def egi_candidates(
    features: RegionFeatures, rows: AppearanceArrays, group_log_prior: Float[Array, "groups"],
    scales: DeterminationScales, most: int,
) -> Candidates:
    """A2: the best `most` attitudes by extended Gaussian image, each turned the short way so that A1 agrees."""
    elsewhere = egi_elsewhere(features.egi, rows.egi)
    too_small = jnp.maximum(jnp.log(jnp.maximum(features.area, 1.0)) - jnp.log(jnp.maximum(rows.area, 1.0)), 0.0)
    score = -0.5 * (elsewhere / scales.egi) ** 2 - 0.5 * (0.5 * too_small / scales.size) ** 2
    score = jnp.where(rows.area > 0, score + group_log_prior[rows.group], -jnp.inf)
    value, row = jax.lax.top_k(score, most)
    turn = jax.vmap(shortest_turn, in_axes=(0, None))(rows.mean_normal[row], features.mean_normal)
    return Candidates(turn @ rows.R_cam_obj[row], row, value)


def shortest_turn(a: Float[Array, "3"], b: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """The smallest rotation that takes unit vector a to unit vector b (not opposite: both face the viewer)."""
    v = jnp.cross(a, b)
    c = jnp.sum(a * b)
    zero = jnp.zeros_like(c)
    K = jnp.stack([jnp.stack([zero, -v[2], v[1]]), jnp.stack([v[2], zero, -v[0]]), jnp.stack([-v[1], v[0], zero])])
    return jnp.eye(3) + K + K @ K / (1.0 + c)


def best(R: Float[Array, "n 3 3"], row: Int[Array, "n"], score: Float[Array, "n"], most: int) -> Candidates:
    """The `most` best by score."""
    value, index = jax.lax.top_k(score, most)
    return Candidates(R[index], row[index], value)


def rotation_angle(R: Float[Array, "*n 3 3"], S: Float[Array, "*n 3 3"]) -> Float[Array, "*n"]:
    """Angle [rad] of R S^T."""
    cosine = (jnp.sum(R * S, axis=(-2, -1)) - 1.0) / 2.0
    return jnp.arccos(jnp.clip(cosine, -1.0, 1.0))

