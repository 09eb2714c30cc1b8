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
LEAST_FACING = 0.2  # cosine to the direction to the viewer: a steeper surface shows next to nothing


def two_light_needles(
    shading: Float[np.ndarray, "height width lights"], lights: Float[np.ndarray, "lights 3"],
    toward_viewer: Float[np.ndarray, "height width 3"],
) -> list[tuple[Float[np.ndarray, "height width 3"], Bool[np.ndarray, "height width"]]]:
    """Both normals (unit, camera frame) that each pixel's two brightest lights leave, and where each can be seen.

    The first is turned away from the other lights: it has its shadow from itself. The second's is cast by something
    else. `shading`: intensity over the light's strength and the parts' albedo; `toward_viewer`: unit.
    """
    height, width, count = shading.shape
    x = np.asarray(shading, float).reshape(-1, count)
    order = np.argsort(x, axis=1)[:, -2:]
    bright = np.take_along_axis(x, order, axis=1)
    two, one = lights[order[:, 0]].astype(float), lights[order[:, 1]].astype(float)
    cosine = (one * two).sum(axis=1)
    inside = np.where(np.abs(cosine) < 0.999, 1.0 - cosine**2, np.inf)
    # the part of the normal in the plane of the two lights, from its cosines to them
    a = (bright[:, 1] - cosine * bright[:, 0]) / inside
    b = (bright[:, 0] - cosine * bright[:, 1]) / inside
    within = a[:, None] * one + b[:, None] * two
    squared = (within**2).sum(axis=1)
    across = np.cross(one, two) / np.sqrt(inside)[:, None]
    rest = lights.sum(axis=0) - one - two  # the side of the lights that don't reach it
    across *= np.where((across * rest).sum(axis=1) > 0.0, 1.0, -1.0)[:, None]
    beyond = np.sqrt(np.clip(1.0 - squared, 0.0, None))[:, None] * across
    told = (bright[:, 0] > LEAST_LIT) & (squared < BRIGHTEST) & np.isfinite(inside)
    both = []
    for n in (within - beyond, within + beyond):
        n = n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-9)
        seen = told & ((n * toward_viewer.reshape(-1, 3)).sum(axis=1) > LEAST_FACING)
        both.append(((n * seen[:, None]).astype(np.float32).reshape(height, width, 3), seen.reshape(height, width)))
    return both
