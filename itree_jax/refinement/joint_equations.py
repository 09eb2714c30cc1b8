"""The joint normal equations of all poses, all lights and the albedo: assembled from blocks, solved under the gauge.

Unknowns in this order: a twist (omega [rad], v [mm]) of each part, delta g of each light (direction times intensity),
delta log albedo of each kind of part, and how much light the parts send one another (c of `light_equations`). Scaling
all lights up and all albedos down changes no image: the mean intensity of the lights is held. Turning everything
together changes no image either; only depth and contour, which see the poses and not the lights, tell that turn. A weak
prior stands in where nothing tells a direction.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from itree_jax.refinement.light_equations import ALBEDO, LIGHT, OMEGA, REFLECTED, LightEquations
from itree_jax.refinement.lit_pixels import PlacedPart

# What a calibration is told to: lamps that were aimed by hand, or measured on a sphere of a few dozen pixels.
DIRECTION_PRIOR = float(np.radians(2.0))
INTENSITY_PRIOR = 0.04
POSE_PRIOR = float(np.radians(5.0))  # recognised poses are off by less; times the reach [mm] for the position
HELD = 1e-3  # [rad] a turn about an axis of revolution, which no measurement sees
ALBEDO_PRIOR = 10.0  # of log albedo: none
REFLECTED_PRIOR = 1.0  # about none: twice the typical reflectance is a mirror
FIXED = 1e-6  # standard deviation of what is not to be solved for


@dataclass(frozen=True)
class Layout:
    """Where each unknown stands."""

    parts: int
    lights: int
    kinds: int

    @property
    def size(self) -> int:
        return 6 * self.parts + 3 * self.lights + self.kinds + 1

    def pose(self, k: int) -> slice:
        return slice(6 * k, 6 * k + 6)

    def light(self, i: int) -> slice:
        return slice(6 * self.parts + 3 * i, 6 * self.parts + 3 * i + 3)

    @property
    def all_lights(self) -> slice:
        return slice(6 * self.parts, 6 * self.parts + 3 * self.lights)

    @property
    def albedos(self) -> slice:
        return slice(6 * self.parts + 3 * self.lights, self.size - 1)

    @property
    def reflected(self) -> int:
        return self.size - 1


@dataclass(frozen=True)
class JointEquations:
    """Half the cost is x^T hessian x / 2 + gradient^T x about the present estimate."""

    hessian: Float[np.ndarray, "size size"]
    gradient: Float[np.ndarray, "size"]


def photometric_part(layout: Layout, blocks: LightEquations, kinds: Sequence[int]) -> JointEquations:
    """The blocks of eight unknowns, added up where they belong."""
    places = np.arange(layout.size)
    H, gradient = np.zeros((layout.size, layout.size)), np.zeros(layout.size)
    of_block, of_gradient = np.asarray(blocks.hessian, float), np.asarray(blocks.gradient, float)
    for k, kind in enumerate(kinds):
        for i in range(layout.lights):
            where = np.zeros(8, int)
            where[OMEGA], where[LIGHT] = places[layout.pose(k)][:3], places[layout.light(i)]
            where[ALBEDO], where[REFLECTED] = places[layout.albedos][kind], layout.reflected
            H[np.ix_(where, where)] += of_block[k, i]
            gradient[where] -= of_gradient[k, i]
    return JointEquations(H, gradient)


def prior_hessian(
    layout: Layout, parts: Sequence[PlacedPart], told: Float[np.ndarray, "lights 3"], lights_free: bool
) -> Float[np.ndarray, "size size"]:
    """Information of the priors: lights about what is told, poses about what was recognised."""
    H = np.zeros((layout.size, layout.size))
    for k, part in enumerate(parts):
        spread = POSE_PRIOR * np.repeat([1.0, part.model.reach], 3)
        H[layout.pose(k), layout.pose(k)] = np.diag(spread**-2) + free_turns(part) / HELD**2
    for i, g in enumerate(told):
        H[layout.light(i), layout.light(i)] = light_prior(g) if lights_free else np.eye(3) / FIXED**2
    H[layout.albedos, layout.albedos] = np.eye(layout.kinds) / ALBEDO_PRIOR**2
    H[layout.reflected, layout.reflected] = REFLECTED_PRIOR**-2
    return H


def light_prior(told: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Information about g = e l: along it the intensity, across it the direction."""
    e = np.linalg.norm(told)
    along = np.outer(told, told) / e**2
    return (along / INTENSITY_PRIOR**2 + (np.eye(3) - along) / DIRECTION_PRIOR**2) / e**2


def free_turns(part: PlacedPart) -> Float[np.ndarray, "6 6"]:
    """Projection on the twists that turn a part about its axes of revolution."""
    total = np.zeros((6, 6))
    for axis, point in part.revolution:
        turn = part.R_cam_obj @ axis
        twist = np.concatenate([turn, -np.cross(turn, part.R_cam_obj @ point)])
        total += np.outer(twist, twist) / (twist @ twist)
    return total


def solved(
    layout: Layout, equations: JointEquations, lights: Float[np.ndarray, "lights 3"]
) -> tuple[Float[np.ndarray, "size"], Float[np.ndarray, "size size"]]:
    """The step, and the covariance of the unknowns, with the mean intensity of the lights held."""
    gauge = np.zeros(layout.size)
    gauge[layout.all_lights] = (lights / np.linalg.norm(lights, axis=1, keepdims=True)).ravel()
    Z = np.linalg.svd(gauge[None])[2][1:].T  # what leaves the mean intensity as it is
    inside = Z.T @ equations.hessian @ Z
    scale = 1.0 / np.sqrt(np.diag(inside))  # angles and millimetres alike
    inverse = scale[:, None] * np.linalg.inv(inside * np.outer(scale, scale)) * scale
    covariance = Z @ inverse @ Z.T
    return -covariance @ equations.gradient, covariance
