"""Edge map: "three edge maps can be obtained by differentiating three intensity maps" (Ikeuchi 1987, sec. 3.1).

The maps of the lights are combined into one, which the work model "original edge relationship" is taken from and
searched in (sec. 2.1.3, 3.3). An edge is a change of intensity, relative to the brighter side, that is confined to a
pixel or two: a crease, a slot, a depth step, the border of a cast shadow. The shading of a curved face goes on over
its neighbours, so that a pixel counts only what it has beyond them. The paper leaves its edge operator open.
"""

from functools import reduce
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

# Change of intensity over two pixels, as a share of the brighter side, beyond what the neighbours have. At the pitch of
# a window a cylinder changes by 5-10 % per pixel; the part that its neighbours don't share stays under 5 %. An edge
# changes by 20 % or more, which counts half.
NO_CONTRAST = 0.1
FULL_CONTRAST = 0.3
# Pure noise exceeds 4 standard deviations in exp(-4^2/2) = 3 of 10,000 pixels; an edge of 8 counts full.
NOISE_STDS = 4.0
SMOOTH = 0.1875  # 3/16, 10/16, 3/16 along the edge: the direction that 3 x 3 pixels give is then right within a degree
NOISE_GAIN = (2.0 * (2.0 * SMOOTH**2 + (1.0 - 2.0 * SMOOTH) ** 2)) ** 0.5  # of one component of the difference
SHADING_DISTANCE = 2  # [px]: the nearest place across the edge that a step no longer touches
THINNING = 4  # power of the share of the largest response across the edge: half of it counts 1/16


class EdgeMap(NamedTuple):
    """Edges of a whole image or of a window; a batch has a leading axis on both fields."""

    # Strength 0..1 times (cos 2 phi, sin 2 phi), phi the direction of the edge from x right toward y down: the same for
    # both signs of contrast and both ways along the edge.
    edges: Float[Array, "h w 2"]
    # Share of the lights whose own map has this edge, 1/lights..1; 0 where there is none. A cast shadow shows under its
    # light alone, creases and depth steps under most.
    lights_share: Float[Array, "h w"]


class Vectors(NamedTuple):
    """Vectors of pixels, a plane per component: interleaved ones keep a CPU from computing several pixels at once."""

    x: Float[Array, "*n"]
    y: Float[Array, "*n"]

    def times(self, factor: Float[Array, "*n"]) -> "Vectors":
        return Vectors(self.x * factor, self.y * factor)


def edge_map(images: Float[Array, "lights h w"], image_std: Float[Array, "lights h w"] | float) -> EdgeMap:
    """The edge map of one scene or window: the maps of all lights combined, where the strongest counts most.

    Args:
        images: linear intensities, one image per light.
        image_std: standard deviation of their noise, in the same unit (`sensing.noise_model.intensity_std`).
    """
    std = jnp.broadcast_to(jnp.asarray(image_std, dtype=images.dtype), images.shape)
    each = jax.vmap(_edges_of_one_light)(images, std)
    squared = _length(each) ** 2
    # Each light weighs with the square of its strength: one light alone keeps its strength, equal ones share it.
    weight = jnp.sum(squared, axis=0)
    weighed = each.times(squared / jnp.where(weight > 0, weight, 1.0)[None])
    edges = Vectors(jnp.sum(weighed.x, axis=0), jnp.sum(weighed.y, axis=0))
    return EdgeMap(jnp.stack(edges, axis=-1), _lights_share(each, edges))


def seen_by(edge_map: EdgeMap, lights: int, least: int = 2) -> Float[Array, "h w 2"]:
    """The edges that at least `least` of `lights` lights show, which leaves out the borders of most cast shadows.

    Edges fade in over the last half light, so that the result has a derivative.
    """
    shown = _rise((edge_map.lights_share * lights - (least - 0.75)) / 0.5)
    return edge_map.edges * shown[..., None]


def _edges_of_one_light(image: Float[Array, "h w"], std: Float[Array, "h w"]) -> Vectors:
    """Strength times double-angle direction of the edges in one intensity map."""
    around = _neighbourhood(image)
    gradient = _differences(around)
    change = _length(gradient)
    normal = gradient.times(1.0 / jnp.where(change > 0, change, 1.0))

    confined = jnp.maximum(change - jnp.maximum(_beside(gradient, normal, SHADING_DISTANCE), 0.0), 0.0)
    brighter = jnp.maximum(_largest(_neighbourhood(_largest(around))), 0.0)  # of 5 x 5 pixels
    noise = NOISE_STDS * NOISE_GAIN * _largest(_neighbourhood(std))
    range_ = (FULL_CONTRAST - NO_CONTRAST) * brighter + noise
    strength = _rise((confined - NO_CONTRAST * brighter - noise) / jnp.where(range_ > 0, range_, 1.0))
    largest = jnp.maximum(change, _beside(gradient, normal, 1))
    thin = (change / jnp.where(largest > 0, largest, 1.0)) ** THINNING
    shown = strength * thin

    # The gradient points across the edge: a quarter turn is a half turn of the double angle.
    c, s = normal
    rough = Vectors(s**2 - c**2, -2.0 * c * s).times(shown)
    # Steps of whole pixels make the direction of one pixel jump; its neighbours along the edge settle it.
    mean = Vectors(*(_blurred(_blurred(component)) for component in rough))
    length = _length(mean)
    return mean.times(shown / jnp.where(length > 0, length, 1.0))


def _lights_share(each: Vectors, edges: Vectors) -> Float[Array, "h w"]:
    """How many of the lights show `edges`, a pixel beside included, in its direction and as strongly."""
    squared = edges.x**2 + edges.y**2
    agree = jax.vmap(lambda light: _agreement(light, edges))(each)
    shown = jnp.clip(agree / jnp.where(squared > 0, squared, 1.0)[None], 0.0, 1.0)
    return jnp.mean(shown, axis=0)


def _agreement(light: Vectors, edges: Vectors) -> Float[Array, "h w"]:
    """Largest inner product of an edge with those of one light in the 3 x 3 pixels around it."""
    beside = zip(_neighbourhood(light.x), _neighbourhood(light.y), strict=True)
    return _largest([x * edges.x + y * edges.y for x, y in beside])


def _differences(around: list[Float[Array, "h w"]]) -> Vectors:
    """Central differences over two pixels, smoothed along the edge."""
    a = around
    x = SMOOTH * (a[2] - a[0] + a[8] - a[6]) + (1.0 - 2.0 * SMOOTH) * (a[5] - a[3])
    y = SMOOTH * (a[6] - a[0] + a[8] - a[2]) + (1.0 - 2.0 * SMOOTH) * (a[7] - a[1])
    return Vectors(x, y)


def _beside(gradient: Vectors, normal: Vectors, distance: int) -> Float[Array, "h w"]:
    """The larger change in the direction of each pixel's `normal`, `distance` [px] across the edge to either side.

    Bilinear, as a weighted sum of the pixels that can be reached: many times faster than looking each one up.
    """
    height, width = gradient.x.shape
    framed = Vectors(*(jnp.pad(component, distance) for component in gradient))
    reach = range(-distance, distance + 1)
    column, row = ({j: _tent(distance * c - j) for j in reach} for c in normal)
    ahead = behind = jnp.zeros_like(normal.x)
    for i, j in ((i, j) for i in reach for j in reach):
        rows, columns = (slice(distance + i, distance + i + height), slice(distance + j, distance + j + width))
        change = framed.x[rows, columns] * normal.x + framed.y[rows, columns] * normal.y
        ahead = ahead + change * column[j] * row[i]
        behind = behind + change * column[-j] * row[-i]
    return jnp.maximum(ahead, behind)


def _tent(t: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Weight of a pixel centre at this distance [px] in linear interpolation."""
    return jnp.maximum(1.0 - jnp.abs(t), 0.0)


def _neighbourhood(image: Float[Array, "h w"]) -> list[Float[Array, "h w"]]:
    """The 3 x 3 pixels around every pixel, row by row; the image's rim is repeated outward, which makes no edge."""
    height, width = image.shape
    framed = jnp.pad(image, 1, mode="edge")
    return [framed[i : i + height, j : j + width] for i in range(3) for j in range(3)]


def _largest(images: list[Float[Array, "h w"]]) -> Float[Array, "h w"]:
    return reduce(jnp.maximum, images)


def _blurred(image: Float[Array, "h w"]) -> Float[Array, "h w"]:
    """1/4, 1/2, 1/4 both ways."""
    a = _neighbourhood(image)
    return (a[0] + a[2] + a[6] + a[8] + 2.0 * (a[1] + a[3] + a[5] + a[7]) + 4.0 * a[4]) / 16.0


def _rise(t: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """0 up to 0, 1 from 1 on, with a continuous derivative."""
    t = jnp.clip(t, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def _length(vectors: Vectors) -> Float[Array, "*n"]:
    """Euclidean length; its derivative at 0 is 0."""
    squared = vectors.x**2 + vectors.y**2
    return jnp.where(squared > 0, jnp.sqrt(jnp.where(squared > 0, squared, 1.0)), 0.0)
