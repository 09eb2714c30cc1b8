"""Whether each image fits its light: the order in which images are given against every other order.

Three cues, each a support per pixel that is summed over blocks of the image, so that their spread tells how sure the
sum is: where shadows end (`shadow_edges`); with four lights and more, whether the intensities of a pixel can be those
of one normal; with a depth map, whether they are those of its normal. Any of the three alone decides most cases. Three
lights without depth have the shadows alone: for lights evenly around the camera every order gives normals that face
it, with one albedo.
"""

from dataclasses import dataclass
from itertools import combinations, permutations

import cv2
import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import linear_sum_assignment

from itree_jax.sensing.noise_model import saturation_level
from itree_jax.sensing.reaching import shadow_ratio
from itree_jax.sensing.shadow_edges import shadow_support
from itree_jax.sensor import Sensor

Order = tuple[int, ...]  # order[k]: the light of image k

BLOCK = 24  # [px] a shadow's end or a face is about that long: blocks are nearly independent
ALL_ORDERS = 4  # up to so many lights; of more, those that swap two, and the one that shadows fit best
SURE = 3.0  # standard deviations by which another order must fit better to be refused
DOUBTFUL = 2.0  # ... by which the order as given must fit better to be taken without a word
MISFIT = 0.1  # of a pixel's intensities: reflected light makes half of that
NORMAL_SMOOTHING = 2.5  # [px] of the depth map; a slope then errs by 0.05 at 0.3 mm of noise and half a mm a pixel
ROUNDING = 1e-6  # of all support: orders that explain the same differ by that much
LEAST_INTENSITY = 0.1  # of the brightest pixels: darker ones are mostly noise


@dataclass(frozen=True)
class LightOrder:
    """The order that fits best beside the one given, and by how much."""

    rival: Order  # the best of all other orders
    margin: float  # standard deviations by which the order as given fits better than it; negative: the rival does
    cues: dict[str, float]  # the margin of each cue alone

    @property
    def wrong(self) -> bool:
        """Clearly: together the cues are sure of it, and none of them speaks for the order as given."""
        return self.margin < -SURE and max(self.cues.values()) < DOUBTFUL

    @property
    def doubtful(self) -> bool:
        return self.margin < DOUBTFUL


def light_order(
    images: Float[np.ndarray, "lights height width"], sensor: Sensor, depth: Float[np.ndarray, "height width"] | None
) -> LightOrder:
    """Compares the order as given with all others (with more than four lights: with those that swap two images, and
    the order that the shadows fit best). Images linear, undistorted, ambient light subtracted; depth z [mm], 0 = none.
    """
    shadows = shadow_support(images, sensor)
    given = tuple(range(len(images)))
    orders = [given, *other_orders(shadows.sum(axis=(2, 3)))]
    every = np.arange(len(images))
    cues = {"shadows": np.stack([_in_blocks(shadows[every, list(order)].sum(axis=0)) for order in orders])}
    x = np.asarray(images, float) / np.asarray(sensor.light_intensities, float)[:, None, None]
    usable = (np.asarray(images) < saturation_level(sensor.noise)).all(axis=0) & _bright(x)
    L = np.asarray(sensor.light_directions, float)
    if len(images) > 3:
        ratio = float(shadow_ratio(L.astype(np.float32), sensor.slant_limit))
        lit = usable & (x.min(axis=0) > ratio * x.max(axis=0))
        cues["intensities"] = np.stack([_in_blocks(one_normal_support(x, lit, L[list(order)])) for order in orders])
    if depth is not None:
        normals, known = depth_normals(depth, sensor)
        cues["depth"] = np.stack([_in_blocks(normal_support(x, usable & known, normals, L[list(o)])) for o in orders])
    margins = {name: _margins(support) for name, support in cues.items()}
    total = together(np.stack(list(margins.values())))
    best = int(np.argmin(total))
    return LightOrder(orders[1:][best], float(total[best]), {name: float(m[best]) for name, m in margins.items()})


def other_orders(score: Float[np.ndarray, "lights lights"]) -> list[Order]:
    """`score`: of image i under light j, from the shadows."""
    count = len(score)
    given = tuple(range(count))
    if count <= ALL_ORDERS:
        return [order for order in permutations(given) if order != given]
    orders = []
    for i, j in combinations(given, 2):
        swapped = list(given)
        swapped[i], swapped[j] = j, i
        orders.append(tuple(swapped))
    best = tuple(int(j) for j in linear_sum_assignment(-score)[1])
    return orders if best == given or best in orders else [*orders, best]


def one_normal_support(
    x: Float[np.ndarray, "lights height width"], lit: Bool[np.ndarray, "height width"], L: Float[np.ndarray, "lights 3"]
) -> Float[np.ndarray, "height width"]:
    """How well one normal explains a pixel that all lights reach: 1 exactly .. 0 not. (Normals turned or mirrored
    together explain as well: four lights evenly around the camera leave seven orders open.)"""
    flat = x[:, lit]
    misfit = flat - L @ (np.linalg.pinv(L) @ flat)
    squared = (misfit**2).sum(axis=0) / (MISFIT**2 * (flat**2).sum(axis=0))
    support = np.zeros(lit.shape)
    support[lit] = np.clip(1.0 - squared, 0.0, 1.0) ** 2
    return support


def normal_support(
    x: Float[np.ndarray, "lights height width"], usable: Bool[np.ndarray, "height width"],
    normals: Float[np.ndarray, "height width 3"], L: Float[np.ndarray, "lights 3"],
) -> Float[np.ndarray, "height width"]:
    """Cosine between a pixel's intensities and those that its normal would have, whatever its albedo."""
    flat, shading = x[:, usable], np.maximum(L @ normals[usable].T, 0.0)
    length = np.linalg.norm(flat, axis=0) * np.linalg.norm(shading, axis=0)
    support = np.zeros(usable.shape)
    support[usable] = (flat * shading).sum(axis=0) / np.where(length > 0.0, length, 1.0)
    return support


def depth_normals(
    depth: Float[np.ndarray, "height width"], sensor: Sensor
) -> tuple[Float[np.ndarray, "height width 3"], Bool[np.ndarray, "height width"]]:
    """Normals toward the camera of a smoothed depth map, and where there are any. Steps make wrong ones: few, and no
    friend of any order."""
    known = depth > 0.0
    weight = cv2.GaussianBlur(known.astype(np.float64), (0, 0), NORMAL_SMOOTHING)
    z = cv2.GaussianBlur(np.where(known, depth, 0.0).astype(np.float64), (0, 0), NORMAL_SMOOTHING)
    z = z / np.maximum(weight, 1e-6)
    v, u = np.indices(depth.shape, dtype=np.float64)
    X = sensor.camera.unproject(np.stack([u, v], axis=-1), z)
    down, right = np.gradient(X, axis=(0, 1))
    normal = np.cross(down, right)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    return normal / np.maximum(length, 1e-12), known & (weight > 0.99) & (length[..., 0] > 0.0)


def _bright(x: Float[np.ndarray, "lights height width"]) -> Bool[np.ndarray, "height width"]:
    top = x.max(axis=0)
    return top > LEAST_INTENSITY * np.percentile(top, 99.5)


def _in_blocks(support: Float[np.ndarray, "height width"]) -> Float[np.ndarray, "blocks"]:
    height, width = support.shape
    padded = np.pad(support, ((0, -height % BLOCK), (0, -width % BLOCK)))
    rows, columns = padded.shape[0] // BLOCK, padded.shape[1] // BLOCK
    return padded.reshape(rows, BLOCK, columns, BLOCK).sum(axis=(1, 3), dtype=np.float64).ravel()


def _margins(support: Float[np.ndarray, "orders blocks"]) -> Float[np.ndarray, "rivals"]:
    """By how many standard deviations the first order has more support than each of the others."""
    difference = support[0] - support[1:]
    rounding = ROUNDING * np.sqrt((support**2).sum())
    return difference.sum(axis=1) / np.sqrt((difference**2).sum(axis=1) + rounding**2 + 1e-30)


def together(margins: Float[np.ndarray, "cues rivals"]) -> Float[np.ndarray, "rivals"]:
    """Of several cues, each weighted by how sure it is: one that cannot tell two orders apart does not dilute another
    that can."""
    return (margins * np.abs(margins)).sum(axis=0) / np.sqrt((margins**2).sum(axis=0) + 1e-30)
