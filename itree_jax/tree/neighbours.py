"""Views of a part beside another one, which hides some of it and casts its shadow on it.

In a bin a region is as often cut as not. What cuts it is another part of the same kind: another view of the batch, put
beside or partly before the first. Its shadow is found by walking from every surface point toward the light over the
neighbour's depth map, which is exact but for the neighbour's hidden back.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from itree_kernels.apparent import ApparentShapes
from jaxtyping import Bool, Float, Int

from itree_jax.batches import filled, power_of_two_above
from itree_jax.kept_functions import kept
from itree_jax.sensing.needle import Array

STEP = 1.5  # [px] of the walk toward a light
STEPS = 20  # to 30 px: beyond the half of a window
BESIDE = (0.5, 0.95)  # distance in sums of the two parts' radii: from half hidden to just shadowed
LIFT = 0.5  # of the part's reach: the neighbour lies this much higher or lower at most
FAR = 1e6  # [mm] depth where nothing is


class Views(NamedTuple):
    """What rays met, a batch of windows seen by an orthographic camera."""

    there: Bool[Array, "n s s"]
    depth: Float[Array, "n s s"]  # [mm]
    normal: Float[Array, "n s s 3"]
    lit: Bool[Array, "n lights s s"]
    own: Bool[Array, "n s s"]  # of the part itself, not of its neighbour


def alone(shapes: ApparentShapes) -> Views:
    """Views of the part by itself."""
    there = shapes.face >= 0
    return Views(there, np.where(there, shapes.depth, FAR), shapes.normal, shapes.lit, there)


def either(first: Bool[np.ndarray, "n"], a: Views, b: Views) -> Views:
    """The views of `a` where `first`, else those of `b`."""
    return Views(*[np.where(first.reshape(-1, *[1] * (x.ndim - 1)), x, y) for x, y in zip(a, b, strict=True)])


def with_neighbours(views: Views, L: Float[np.ndarray, "lights 3"], pitch: float, reach: float,
                    rng: np.random.Generator) -> Views:
    """Every view beside another view of the batch, at a random place around it."""
    if not len(L):  # a depth camera: an axis of no lights cannot be mapped over, one that meets no shadow can
        axis = np.array([[0.0, 0.0, -1.0]])
        beside = with_neighbours(views._replace(lit=np.asarray(views.there)[:, None]), axis, pitch, reach, rng)
        return beside._replace(lit=beside.lit[:, :0])
    count, size = len(views.there), views.there.shape[-1]
    other = (np.arange(count) + 1 + rng.integers(0, max(count - 1, 1), count)) % count
    radius = np.sqrt(np.asarray(views.there).sum(axis=(1, 2)) / np.pi)
    apart = rng.uniform(*BESIDE, count) * (radius + radius[other])
    around = rng.uniform(0.0, 2.0 * np.pi, count)
    shift = np.rint(apart[:, None] * np.stack([np.sin(around), np.cos(around)], axis=1)).astype(np.int32)
    lift = rng.uniform(-LIFT, LIFT, count) * reach
    neighbour = jax.tree.map(lambda a: np.asarray(a)[other], views)
    each = (views, neighbour, np.clip(shift, 1 - size, size - 1), lift.astype(np.float32))
    found = _put_beside(*filled(each, power_of_two_above(count)), np.asarray(L, np.float32), np.float32(pitch))
    return jax.tree.map(lambda a: np.asarray(a)[:count], found)


@kept()
def _put_beside(
    views: Views, others: Views, shift: Int[Array, "n 2"], lift: Float[Array, "n"], L: Float[Array, "lights 3"],
    pitch: Float[Array, ""],
) -> Views:
    def one(item: tuple[Views, Views, Array, Array]) -> Views:
        return beside(*item, L, pitch)

    return jax.lax.map(one, (views, others, shift, lift), batch_size=16)


def beside(own: Views, other: Views, shift: Int[Array, "2"], lift: Array, L: Array, pitch: Array) -> Views:
    """One window with another one moved by `shift` (down, right) [px] and `lift` [mm] away from the viewer."""
    there = shifted(other.there, shift, False)
    depth = jnp.where(there, shifted(other.depth, shift, FAR) + lift, FAR)
    front = there & (~own.there | (depth < own.depth))
    shadow = jax.vmap(partial(shadowed, own.depth, depth, pitch))(L)
    lit = jnp.where(front, jax.vmap(lambda a: shifted(a, shift, False))(other.lit), own.lit & ~shadow)
    normal = jnp.where(front[..., None], shifted(other.normal, shift, 0.0), own.normal)
    return Views(own.there | there, jnp.where(front, depth, own.depth), normal, lit, own.there & ~front)


def shifted(image: Array, shift: Int[Array, "2"], empty: float | bool) -> Array:
    """The image moved by whole pixels (down, right); `empty` comes in from outside."""
    size = image.shape[0]
    i, j = jnp.arange(size) - shift[0], jnp.arange(size) - shift[1]
    inside = ((i >= 0) & (i < size))[:, None] & ((j >= 0) & (j < size))[None, :]
    moved = image[jnp.clip(i, 0, size - 1)][:, jnp.clip(j, 0, size - 1)]
    return jnp.where(inside.reshape(inside.shape + (1,) * (image.ndim - 2)), moved, jnp.asarray(empty, image.dtype))


def shadowed(
    depth: Float[Array, "s s"], blocker: Float[Array, "s s"], pitch: Float[Array, ""], light: Float[Array, "3"]
) -> Bool[Array, "s s"]:
    """Where the blocker's surface stands between a surface point and a distant light."""
    size = depth.shape[0]
    across = jnp.sqrt(light[0] ** 2 + light[1] ** 2)
    unit = jnp.where(across > 1e-3, light[:2] / jnp.maximum(across, 1e-3), 0.0)  # a light on the axis: no walk
    rise = STEP * pitch * light[2] / jnp.maximum(across, 1e-3)  # of depth per step, toward the viewer
    grid = jnp.arange(size, dtype=depth.dtype)

    def step(found: Array, k: Array) -> tuple[Array, None]:
        i = jnp.rint(grid + k * STEP * unit[1]).astype(jnp.int32)
        j = jnp.rint(grid + k * STEP * unit[0]).astype(jnp.int32)
        inside = ((i >= 0) & (i < size))[:, None] & ((j >= 0) & (j < size))[None, :]
        there = blocker[jnp.clip(i, 0, size - 1)][:, jnp.clip(j, 0, size - 1)]
        return found | (inside & (there < depth + k * rise)), None

    none = jnp.zeros((size, size), bool)
    return jax.lax.scan(step, none, jnp.arange(1, STEPS + 1, dtype=depth.dtype))[0] & (across > 1e-3)
