"""Views of a part of revolution: turned about its axis it shows the same, so a ring of directions is seen once."""

from collections.abc import Sequence

import numpy as np
from itree_cad.symmetry import rotation
from jaxtyping import Float, Int

from itree_jax.tree.dome import camera_rotation

SAME_ANGLE = 1e-6  # [rad]: directions of the dome that lie on one ring differ by rounding only


def meridian_views(
    directions: Float[np.ndarray, "views 3"], axes: Sequence[Float[np.ndarray, "3"]]
) -> tuple[Float[np.ndarray, "views 3 3"], Float[np.ndarray, "rings 3 3"], Int[np.ndarray, "views"]]:
    """Cameras with the axis of revolution projected upward, and one view per polar angle that stands for its ring.

    With any other image up, the lights would lie otherwise about the part in every view of a ring, and its views would
    differ by their shadows.

    Args:
        directions: unit, from the part toward the viewer.
        axes: of revolution, one, or several of a sphere, which shows the same from everywhere.

    Returns:
        `R_cam_obj` of every view, `R_cam_obj` of one view per ring (all in one half plane through the axis), and the
        ring of every view.
    """
    if len(axes) > 1:
        return camera_rotation(directions), camera_rotation(directions[:1]), np.zeros(len(directions), dtype=np.int32)
    axis = axes[0]
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side /= np.linalg.norm(side)
    other = np.cross(axis, side)
    polar = np.arctan2(np.linalg.norm(np.cross(directions, axis), axis=1), directions @ axis)
    _, first, ring = np.unique(np.round(polar / SAME_ANGLE), return_index=True, return_inverse=True)
    R_ring = np.stack([_camera(axis, side, angle) for angle in polar[first]])
    azimuth = np.arctan2(directions @ other, directions @ side)
    back = np.stack([rotation(axis, -angle) for angle in azimuth])
    ring = ring.reshape(-1).astype(np.int32)
    return R_ring[ring] @ back, R_ring, ring


def _camera(axis: np.ndarray, side: np.ndarray, polar: float) -> Float[np.ndarray, "3 3"]:
    """`R_cam_obj` of the view from a polar angle [rad] toward `side`; up is defined at the poles too."""
    c, s = np.cos(polar), np.sin(polar)
    z_cam, y_cam = -(c * axis + s * side), -(s * axis - c * side)
    return np.stack([np.cross(y_cam, z_cam), y_cam, z_cam])
