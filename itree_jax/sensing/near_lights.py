"""Near point lights: direction and intensity differ from pixel to pixel.

A lamp at p lights a point X from (p - X) / |p - X|, by one over the squared distance. Its intensity is told where the
optical axis meets the working distance; there a near light and the distant one of the same direction agree.
"""

import jax.numpy as jnp
import numpy as np
from itree_kernels.camera import Camera
from jaxtyping import Float

from itree_jax.sensing.lights import axis_point
from itree_jax.sensing.needle import Array
from itree_jax.sensor import Sensor


def near_light_field(
    positions: Float[Array, "lights 3"],
    intensities: Float[Array, "lights"],
    depth: Float[Array, "height width"] | float,
    camera: Camera,
    working_distance: float,
) -> tuple[Float[Array, "height width lights 3"], Float[Array, "height width lights"]]:
    """Unit directions toward near lights at `positions` [mm] and the intensities there, at every pixel.

    `depth`: z [mm] of the surface, or one number for a plane that faces the camera; where it is 0, the working distance
    [mm] stands for it. Differentiable in positions, intensities and depth.
    """
    p, e = jnp.asarray(positions), jnp.asarray(intensities)
    z = jnp.broadcast_to(jnp.asarray(depth, p.dtype), (camera.height, camera.width))
    to_light = p - _surface(jnp.where(z > 0.0, z, working_distance), camera)[..., None, :]
    square = (to_light**2).sum(-1)
    reference = ((p - jnp.asarray(axis_point(working_distance), p.dtype)) ** 2).sum(-1)
    return to_light / jnp.sqrt(square)[..., None], e * reference / square


def lights_of(sensor: Sensor, depth: Float[Array, "height width"] | None = None) -> tuple[Array, Array]:
    """Directions and intensities as `photometric_stereo` takes them: of distant lights [lights, 3] and [lights].

    Of near ones those of `near_light_field` at the surface that `depth` [mm] tells, else at the working distance.
    """
    if sensor.light_positions is None:
        return sensor.light_directions, sensor.light_intensities
    surface = sensor.working_distance if depth is None else depth
    return near_light_field(
        sensor.light_positions, sensor.light_intensities, surface, sensor.camera, sensor.working_distance
    )


def _surface(z: Float[Array, "height width"], camera: Camera) -> Float[Array, "height width 3"]:
    v, u = np.mgrid[: camera.height, : camera.width]
    scale = jnp.ones_like(z) if camera.is_orthographic else z
    x = jnp.asarray((u - camera.cx) / camera.fx, z.dtype) * scale
    y = jnp.asarray((v - camera.cy) / camera.fy, z.dtype) * scale
    return jnp.stack([x, y, z], axis=-1)
