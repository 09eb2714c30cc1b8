"""Rays for refinement: what each hypothesis predicts at the pixels of its window, and where its occluding contour runs.

One launch serves all hypotheses of all regions. Windows have a fixed size and integer pixel positions, so that arrays
keep their shapes and observed maps are read without interpolation.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from itree_kernels.camera import Camera
from itree_kernels.mesh import RayMesh
from itree_kernels.windows import Rays, windows


@dataclass(frozen=True)
class Correspondences:
    """What hypothesis h predicts at window pixel (i, j), that is at image point `origin_uv[h] + stride * (j, i)`."""

    depth: Float[np.ndarray, "hypotheses s s"]  # z [mm], 0 where the ray misses the part
    triangle: Int[np.ndarray, "hypotheses s s"]  # triangle hit, -1 where none
    contour_uv: Float[np.ndarray, "hypotheses 2 s s 2"]  # contour crossing toward the right / lower neighbour [px]
    contour_depth: Float[np.ndarray, "hypotheses 2 s s"]  # z [mm] of the near side there, 0 where no contour


def correspondences(
    mesh: RayMesh,
    R_cam_obj: Float[np.ndarray, "hypotheses 3 3"],
    t_cam_obj: Float[np.ndarray, "hypotheses 3"],
    camera: Camera,
    origin_uv: Float[np.ndarray, "hypotheses 2"],
    size: int,
    stride: int,
    reach: float,
    jump: float | None = None,
    crease: float | None = None,
) -> Correspondences:
    """Casts the rays of every hypothesis's window.

    `reach` [mm]: no point of the part is farther than this from its origin. `jump` [mm]: the least step between two
    surfaces that counts as an occluding contour; None leaves contours out. `crease` [rad]: where the surface turns by
    more from one triangle to the next, its crease is a contour point too; None: occluding contours alone.
    """
    seen = windows(R_cam_obj, t_cam_obj, origin_uv, size, stride, mesh.device, contours=jump is not None)
    seen.clear_contours()
    Rays(mesh, camera, reach, jump, crease).cast_all(seen)
    return Correspondences(
        seen.depth.numpy(), seen.triangle.numpy(), seen.contour_uv.numpy(), seen.contour_depth.numpy()
    )
