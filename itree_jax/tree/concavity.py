"""Faces that light themselves: holes and other steep concave faces, which photometric stereo cannot be trusted on.

"Group 6 corresponds to a hole region of the object and such a steep convex area cannot be detected by photometric
stereo" (Ikeuchi 1987, sec. 2.1.1; a hole is concave). What makes it so is that its walls shade and light each other.
The measure is the share of the light coming from all around toward a face's open side that the face itself blocks,
which is the share of light leaving the face that falls back on it (its view factor to itself): 0 for a plane or a
convex face, 1 - opening/area for a blind hole, a half for a hemispherical bowl.
"""

import numpy as np
from itree_cad.part import Part
from itree_kernels.apparent import cast_apparent_shapes
from itree_kernels.camera import Camera
from itree_kernels.mesh import ray_mesh
from jaxtyping import Float

from itree_jax.tree.dome import camera_rotation, dome

# On a grey part (albedo 0.6), light bounced within such a face adds 15 % or more to the direct light: twice what nine
# in ten pixels of a bin receive from all their neighbours.
STEEP = 0.25
PIXELS_ACROSS = 64  # a percent of a face's projected area
HEAD_ON = np.array([[0.0, 0.0, -1.0]])


def self_blocking(part: Part, face: int) -> float:
    """Share in [0, 1] of the light toward a face's open side, from all directions, that the face itself blocks."""
    triangles = part.triangles[part.face_of_triangle == face]
    corners = part.vertices[triangles]
    directions = dome(1).directions
    normal_area = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    unblocked = np.maximum(normal_area @ directions.T, 0.0).sum()
    if unblocked == 0:
        return 0.0
    return float(np.clip(1.0 - _seen_area(part, triangles, directions) / unblocked, 0.0, 1.0))


def _seen_area(part: Part, triangles: np.ndarray, directions: Float[np.ndarray, "views 3"]) -> float:
    """Projected area [mm^2] of the front of some triangles, alone in space, summed over the directions."""
    points = part.vertices[np.unique(triangles)]
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    reach = float(np.linalg.norm(points - middle, axis=1).max())
    pitch = 2.0 * reach / (PIXELS_ACROSS - 2)
    centre = (PIXELS_ACROSS - 1) / 2.0
    camera = Camera("orthographic", 1.0 / pitch, 1.0 / pitch, centre, centre, PIXELS_ACROSS, PIXELS_ACROSS)
    mesh = ray_mesh(part.vertices, triangles, np.zeros(len(triangles), dtype=np.int32))
    R = camera_rotation(directions)
    t = -R @ middle + np.array([0.0, 0.0, 2.0 * reach])
    # Head-on light and no slant limit: a pixel is detectable when it shows a front.
    shapes = cast_apparent_shapes(mesh, R, t, camera, HEAD_ON, np.pi / 2)
    return float(np.count_nonzero((shapes.normal[..., 2] < 0) & (shapes.face >= 0)) * pitch**2)
