"""Original face relationship: the work model of rules L6 and A3 (Ikeuchi 1987, sec. 2.1.3).

A nonconvex part appears as several isolated regions. Of each other region (a brother if it belongs to the same part)
are kept: the vector between the mass centres, "based on the maximum inertia direction and the surface orientation of
the region", and how large and how tilted the other one is. Where the region has no unique direction only the distance
counts (`brother_misfit` looks at the region's uniqueness).

The vector is the one in space, from depth; the paper's, in the image, agrees with it for brothers on one plane.
"""

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

MOST_BROTHERS = 4  # regions beside it that are kept, the nearest ones: of a bin's regions more belong to other parts
BROTHER_FIELDS = 6  # along, across, out along the normal [mm], log size, cosine between the normals, 1 if there is one
ALONG, ACROSS, OUT, SIZE, FACING, THERE = range(BROTHER_FIELDS)
# What of a true brother differs: the mass centres of two regions move by a pixel or two and by cut corners (a tenth of
# their distance), the direction as A4's, sizes by what shadows cut, normals by the views of one group.
DISTANCE_SPREAD, ANGLE_SPREAD, SIZE_SPREAD, FACING_SPREAD = 0.1, 0.25, 0.25, 0.1
MOST_MISFIT = 5.0  # sigma; also of a region without any brother


def brothers(
    centre: Float[np.ndarray, "n 3"], mean_normal: Float[np.ndarray, "n 3"], alpha: Float[np.ndarray, "n"],
    area: Float[np.ndarray, "n"], reach: float,
) -> Float[np.ndarray, "n most fields"]:
    """Of every region, the others within `reach` [mm], nearest first; zeros fill up.

    Args:
        centre: mean surface points [mm] in one frame whose z looks away from the viewer.
        mean_normal: unit, same frame.
        alpha: maximum inertia directions [rad] in face axes (`rectify.face_axes`).
        area: [mm^2].
    """
    count = len(centre)
    found = np.zeros((count, MOST_BROTHERS, BROTHER_FIELDS), np.float32)
    if count < 2:
        return found
    along, across = inertia_axes(mean_normal, alpha)
    vector = centre[None, :] - centre[:, None]
    distance = np.linalg.norm(vector, axis=-1)
    distance[np.arange(count), np.arange(count)] = np.inf
    order = np.argsort(distance, axis=1, kind="stable")[:, :MOST_BROTHERS]
    own = np.arange(count)[:, None]
    near = np.isfinite(distance[own, order]) & (distance[own, order] <= reach)  # not itself, however far one looks
    D = vector[own, order]
    fields = np.stack([
        np.einsum("nkx,nx->nk", D, along), np.einsum("nkx,nx->nk", D, across),
        np.einsum("nkx,nx->nk", D, mean_normal),
        0.5 * np.log(np.maximum(area[order], 1.0)),
        np.einsum("nkx,nx->nk", mean_normal[order], mean_normal), np.ones(order.shape),
    ], axis=-1)  # fmt: skip
    found[:, : order.shape[1]] = np.where(near[..., None], fields, 0.0)
    return found


def inertia_axes(
    mean_normal: Float[np.ndarray, "n 3"], alpha: Float[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """3-D directions along and across the maximum inertia direction of each region, in its face."""
    x, y, z = np.moveaxis(np.asarray(mean_normal, float), -1, 0)
    toward = np.maximum(-z, 0.01)
    p, q = x / toward, y / toward
    s = np.sqrt(1.0 + p**2)
    e1 = np.stack([np.ones_like(p), np.zeros_like(p), p], axis=-1) / s[..., None]
    e2 = np.stack([-p * q, 1.0 + p**2, q], axis=-1) / (s * np.sqrt(1.0 + p**2 + q**2))[..., None]
    c, s = np.cos(alpha)[..., None], np.sin(alpha)[..., None]
    return c * e1 + s * e2, c * e2 - s * e1


def brother_misfit(
    seen: Float[Array, "*n fields"], model: Float[Array, "*m fields"], unique: Array
) -> Float[Array, "*k"]:
    """How many sigmas a region's brother differs from a model's, at most `MOST_MISFIT`; leading axes broadcast.

    `unique`: both regions have an inertia direction (known up to a half turn); else the distance alone is compared.
    """
    distance = jnp.sqrt(jnp.sum(jnp.square(seen[..., :3]), axis=-1) + 1e-12)
    stored = jnp.sqrt(jnp.sum(jnp.square(model[..., :3]), axis=-1) + 1e-12)
    scale = DISTANCE_SPREAD * jnp.maximum(stored, 1e-6)
    # the half turn that the inertia direction leaves open turns both components round
    same = jnp.abs(brother_angle(seen) - brother_angle(model)) % jnp.pi
    turn = jnp.minimum(same, jnp.pi - same)
    in_plane = jnp.sqrt(jnp.sum(jnp.square(model[..., :2]), axis=-1) + 1e-12) / jnp.maximum(stored, 1e-6)
    total = jnp.square((distance - stored) / scale) + jnp.square(
        (seen[..., SIZE] - model[..., SIZE]) / SIZE_SPREAD
    ) + jnp.square((seen[..., FACING] - model[..., FACING]) / FACING_SPREAD)
    directed = jnp.square(in_plane * turn / ANGLE_SPREAD) + jnp.square((seen[..., OUT] - model[..., OUT]) / scale)
    total = total + jnp.where(unique, directed, 0.0)
    there = (seen[..., THERE] > 0) & (model[..., THERE] > 0)
    return jnp.where(there, jnp.minimum(jnp.sqrt(total + 1e-12), MOST_MISFIT), MOST_MISFIT)


def brother_angle(brother: Float[Array, "*n fields"]) -> Float[Array, "*n"]:
    """Direction [rad] toward a brother in the face, from the maximum inertia direction."""
    there = (brother[..., ALONG] != 0) | (brother[..., ACROSS] != 0)
    return jnp.arctan2(jnp.where(there, brother[..., ACROSS], 0.0), jnp.where(there, brother[..., ALONG], 1.0))
