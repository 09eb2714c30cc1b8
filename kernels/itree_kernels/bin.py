"""An open box for parts to lie in."""

import numpy as np
from jaxtyping import Float, Int

from itree_kernels.errors import ItreeError

# Corners of each ring, counter-clockwise seen from above; rings: outer bottom, outer top, inner top, inner bottom
_RING = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def bin_mesh(
    inner_size: tuple[float, float], wall_thickness: float, height: float
) -> tuple[Float[np.ndarray, "16 3"], Int[np.ndarray, "28 3"]]:
    """Vertices [mm] and outward triangles of an open box: a floor whose top is z = 0, and four walls up to z = height.

    `inner_size` (x, y) [mm] is centred on the origin; floor and walls are `wall_thickness` [mm] thick. The surface is
    closed. Raises ItreeError when a length isn't positive.
    """
    lengths = (*inner_size, wall_thickness, height)
    if not all(np.isfinite(length) and length > 0 for length in lengths):
        raise ItreeError(
            f"a bin needs positive lengths, not inner size {inner_size}, wall {wall_thickness}, height {height} mm"
        )
    inner = _RING * np.asarray(inner_size) / 2
    outer = inner + _RING * wall_thickness
    rings = [(outer, -wall_thickness), (outer, height), (inner, height), (inner, 0.0)]
    vertices = np.concatenate([np.column_stack([xy, np.full(4, z)]) for xy, z in rings])
    quads = [(3, 2, 1, 0), (12, 13, 14, 15)]  # underside, floor
    for ring in range(3):  # outer walls, rim, inner walls
        for k in range(4):
            a, b = 4 * ring + k, 4 * ring + (k + 1) % 4
            quads.append((a, b, b + 4, a + 4))
    return vertices, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
