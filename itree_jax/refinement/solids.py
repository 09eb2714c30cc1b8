"""Solids exclude each other: two accepted poses may touch, but not share space."""

from dataclasses import dataclass

import numpy as np
from itree_kernels.inside import signed_distance
from itree_kernels.mesh import RayMesh
from jaxtyping import Float

PROBES = 400  # points inside of the part: a twentieth of its volume is seen by some twenty of them
DEPTH = 0.02  # of the diameter: deeper than any error of two good poses
SHARED = 0.05  # share of the probes that may lie deeper: a pose's own error along a thin wall
SEED = 0


@dataclass(frozen=True, eq=False)
class Solid:
    """A part with probe points spread over its inside, at least `depth` [mm] below the surface."""

    mesh: RayMesh
    probes_obj: Float[np.ndarray, "probes 3"]  # empty for an open mesh, which has no inside
    depth: float  # [mm]
    low: Float[np.ndarray, "3"]  # corners of its bounding box [mm]
    high: Float[np.ndarray, "3"]


def solid(mesh: RayMesh, diameter: float, watertight: bool) -> Solid:
    """Draws the probes. An open mesh excludes nothing."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    if not watertight:
        return Solid(mesh, np.zeros((0, 3)), DEPTH * diameter, low, high)
    rng = np.random.default_rng(SEED)
    points = rng.uniform(low, high, (20 * PROBES, 3))
    distance = signed_distance(mesh, points)
    # in a thin part nothing lies deep: a good pose's error must still fit in a quarter of its thickness
    depth = min(DEPTH * diameter, 0.5 * float(-distance.min()))
    inside = points[distance < -depth]
    if len(inside) < PROBES // 4:  # a thin part: points anywhere inside
        inside = points[distance < 0]
    return Solid(mesh, inside[:PROBES], depth, low, high)


def share_space(
    a: Solid, R_a: Float[np.ndarray, "3 3"], t_a: Float[np.ndarray, "3"],
    b: Solid, R_b: Float[np.ndarray, "3 3"], t_b: Float[np.ndarray, "3"],
) -> bool:
    """True when more of one solid lies deep inside of the other than errors of the poses explain."""
    centre_a, centre_b = R_a @ a.mesh.centre + t_a, R_b @ b.mesh.centre + t_b
    if np.linalg.norm(centre_a - centre_b) > a.mesh.radius + b.mesh.radius:
        return False
    return _intrudes(a, R_a, t_a, b, R_b, t_b) or _intrudes(b, R_b, t_b, a, R_a, t_a)


def _intrudes(a: Solid, R_a, t_a, b: Solid, R_b, t_b) -> bool:
    if len(a.probes_obj) == 0 or len(b.probes_obj) == 0:
        return False
    in_b = (a.probes_obj @ R_a.T + t_a - t_b) @ R_b
    near = in_b[((in_b > b.low) & (in_b < b.high)).all(axis=1)]
    enough = SHARED * len(in_b)
    return len(near) > enough and bool(np.count_nonzero(signed_distance(b.mesh, near) < -b.depth) > enough)
