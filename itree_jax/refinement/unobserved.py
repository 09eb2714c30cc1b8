"""Which changes of the lights the recognised parts could not tell, in words."""

import numpy as np
from jaxtyping import Float

from itree_jax.refinement.joint_equations import light_prior

KNOWN = 0.25  # of the prior's variance: what is known no better than half of its standard deviation is not observed
MOSTLY = 0.8  # of a direction, for it to be called by one name


def unobserved_directions(
    covariance: Float[np.ndarray, "size size"], told: Float[np.ndarray, "lights 3"]
) -> tuple[str, ...]:
    """Directions of the lights' covariance whose variance is more than a quarter of the prior's."""
    count = len(told)
    root = np.zeros((3 * count, 3 * count))  # prior = root root^T
    for i, g in enumerate(told):
        root[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = np.linalg.cholesky(light_prior(g))
    values, vectors = np.linalg.eigh(root.T @ covariance @ root)
    return tuple(_named(root, vectors[:, k], told) for k in np.flatnonzero(values > KNOWN))


def _named(root: Float[np.ndarray, "size size"], whitened: Float[np.ndarray, "size"], told: np.ndarray) -> str:
    turns = np.stack([np.cross(axis, told).ravel() for axis in np.eye(3)], axis=1)  # d lights / d common turn
    basis = root.T @ turns
    common = np.linalg.lstsq(basis, whitened, rcond=None)[0]
    if np.sum((basis @ common) ** 2) > MOSTLY:
        axis = common / np.linalg.norm(common)
        return "a turn of all lights together about ({:.2f}, {:.2f}, {:.2f})".format(*axis)
    of_light = (whitened.reshape(-1, 3) ** 2).sum(axis=1)
    light = int(np.argmax(of_light))
    if of_light[light] > MOSTLY:
        change = np.linalg.solve(root.T, whitened)[3 * light : 3 * light + 3]
        along = abs(change @ told[light]) > 0.7 * np.linalg.norm(change) * np.linalg.norm(told[light])
        return f"the {'intensity' if along else 'direction'} of light {light}"
    return "a change of lights " + ", ".join(str(i) for i in np.flatnonzero(of_light > (1 - MOSTLY) / 2)) + " together"
