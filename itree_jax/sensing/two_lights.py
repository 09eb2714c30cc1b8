"""Needles where only two lights reach, from the parts' albedo.

Photometric stereo needs three lights for a normal and an albedo (Ikeuchi 1987, sec. 3.1). The parts of a bin are of one
material, whose albedo the lit surface tells: then two lights leave two normals, mirror images of each other in the
plane of the lights (Woodham 1980). Half of what a bin shows is out of one light's reach, so that whole parts have no
needle but these. They are good for asking what lies there; poses are judged by what is known for sure.
"""

import numpy as np
from jaxtyping import Bool, Float

LEAST_LIT = 0.2  # of full albedo: what reflected light fills shadows with is less
BRIGHTEST = 1.07  # squared length of what two lights tell of a unit normal: noise and reflected light add so much
SAME_DIRECTION = 0.999  # cosine: lights 2.6 degrees apart tell nothing that one of them doesn't
LEAST_FACING = 0.2  # cosine to the direction to the viewer: a steeper surface shows next to nothing


def two_light_needles(
    shading: Float[np.ndarray, "pixels lights"], lights: Float[np.ndarray, "lights 3"],
    toward_viewer: Float[np.ndarray, "pixels 3"],
) -> list[tuple[Float[np.ndarray, "pixels 3"], Bool[np.ndarray, "pixels"]]]:
    """Both normals (unit, camera frame) that each pixel's two brightest lights leave, and where each can be seen.

    The first is turned away from the other lights: it has its shadow from itself. The second's is cast by something
    else. `shading`: intensity over the light's strength and the parts' albedo; `toward_viewer`: unit.
    """
    order = np.argsort(shading, axis=1)[:, -2:]
    dimmer, brighter = np.take_along_axis(np.asarray(shading, float), order, axis=1).T
    two, one = lights[order[:, 0]].astype(float), lights[order[:, 1]].astype(float)
    cosine = (one * two).sum(axis=1)
    sine_squared = np.where(np.abs(cosine) < SAME_DIRECTION, 1.0 - cosine**2, np.inf)
    # the part of the normal in the plane of the two lights, from its cosines to them
    a, b = (brighter - cosine * dimmer) / sine_squared, (dimmer - cosine * brighter) / sine_squared
    within = a[:, None] * one + b[:, None] * two
    squared = (within**2).sum(axis=1)
    across = np.cross(one, two) / np.sqrt(sine_squared)[:, None]
    rest = lights.sum(axis=0) - one - two  # the side of the lights that don't reach it
    across *= np.where((across * rest).sum(axis=1) > 0.0, 1.0, -1.0)[:, None]
    beyond = np.sqrt(np.clip(1.0 - squared, 0.0, None))[:, None] * across
    told = (dimmer > LEAST_LIT) & (squared < BRIGHTEST) & np.isfinite(sine_squared)
    both = []
    for n in (within - beyond, within + beyond):
        unit = n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-9)
        seen = told & ((unit * toward_viewer).sum(axis=1) > LEAST_FACING)
        both.append(((unit * seen[:, None]).astype(np.float32), seen))
    return both
