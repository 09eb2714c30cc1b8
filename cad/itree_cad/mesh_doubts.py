"""What a mesh has that a solid has not, told as warnings: it is read all the same."""

import warnings

import numpy as np
from itree_kernels.errors import ItreeWarning
from jaxtyping import Float, Int

from itree_cad.assemble import is_watertight, triangle_areas

OFF_SURFACE = 1e-4  # of the diameter: how far before a triangle it is asked whether that is outside
MOST_INSIDE = 0.01  # of the area: rounding at concave edges makes less


def warn_of_doubts(
    vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "triangles 3"], diameter: float, where: str
) -> None:
    """An `ItreeWarning` where the mesh (welded, [mm]) is not closed, or a part of its surface lies inside of it."""
    if not is_watertight(triangles):
        _warn(
            f"{where}: the mesh is not closed ({open_edges(triangles)} of its edges do not join two triangles). What "
            "is missing is not seen and casts no shadow: repair the mesh, or export the part again as STEP"
        )
        return
    share = inside_share(vertices, triangles, diameter)
    if share > MOST_INSIDE:
        _warn(
            f"{where}: {100 * share:.0f} % of the surface lies inside of the part (bodies that overlap, or a surface "
            "that crosses itself): no camera sees it, but its faces count. Unite the bodies before you export"
        )


def open_edges(triangles: Int[np.ndarray, "triangles 3"]) -> int:
    """Edges that do not join two triangles, one on each side."""
    directed = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    sign = np.where(directed[:, 0] < directed[:, 1], 1, -1)
    _, inverse, count = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True, return_counts=True)
    balance = np.bincount(inverse.reshape(-1), weights=sign, minlength=len(count))
    return int(((count != 2) | (balance != 0)).sum())


def inside_share(
    vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "triangles 3"], diameter: float
) -> float:
    """Share of a closed mesh's area before which there is not outside but inside."""
    from itree_kernels.inside import signed_distance
    from itree_kernels.mesh import ray_mesh

    mesh = ray_mesh(vertices, triangles, np.zeros(len(triangles), np.int64))
    centres = vertices[triangles].mean(axis=1) + OFF_SURFACE * diameter * np.asarray(mesh.triangle_normals)
    areas = triangle_areas(vertices, triangles)
    return float(areas[signed_distance(mesh, centres) < 0.0].sum() / areas.sum())


def _warn(text: str) -> None:
    warnings.warn(text, ItreeWarning, stacklevel=5)
