"""The bin that parts lie in, and where the camera stands above it.

Bin frame: origin in the middle of the floor, x along the longer side, z up.
"""

from dataclasses import dataclass

import numpy as np
from itree_kernels.bin import bin_mesh
from itree_kernels.errors import ItreeError
from itree_kernels.mesh import RayMesh, ray_mesh
from jaxtyping import Bool, Float

from itree_jax.sensor import Sensor
from itree_jax.world.bin_walls import BinWalls

FIELD_FRACTION = 0.6  # of the field of view: parts against a wall stay in the image, also when they stand up
WALL_HEIGHT = 0.5  # of the part's diameter: keeps a falling part in, and shades the floor no farther than that
WALL_THICKNESS = 4.0  # [mm]
TABLE = 2.0  # of the bin's size, to each side of its middle: more than twice the field of view
LEAST_ROOM = 1.3  # of the part's diameter: the shorter side of the smallest bin


@dataclass(frozen=True)
class Bin:
    """An open box; its inner floor is z = 0."""

    inner_size: tuple[float, float]  # x, y [mm]
    wall_height: float  # [mm]
    wall_thickness: float = WALL_THICKNESS  # [mm]

    def contains(self, X_bin: Float[np.ndarray, "*n 3"]) -> Bool[np.ndarray, "*n"]:
        """Whether points [mm] lie between the walls, at any height above the floor."""
        inside = (np.abs(X_bin[..., :2]) < np.asarray(self.inner_size) / 2).all(axis=-1)
        return inside & (X_bin[..., 2] > 0)


def bin_for(sensor: Sensor, diameter: float) -> Bin:
    """A bin of 60 % of the field of view at the working distance, for parts of that diameter [mm].

    Raises ItreeError if a part has no room in it: sensor and part do not fit, or the unit of one is wrong.
    """
    camera, scale = sensor.camera, FIELD_FRACTION * sensor.mm_per_px
    size = (scale * camera.width, scale * camera.height)
    if min(size) < LEAST_ROOM * diameter:
        raise ItreeError(
            f"the sensor sees {camera.width * sensor.mm_per_px:.0f} x {camera.height * sensor.mm_per_px:.0f} mm at its "
            f"working distance; a bin of {size[0]:.0f} x {size[1]:.0f} mm inside has no room for a part of diameter "
            f"{diameter:.1f} mm. Take a sensor with a wider field of view, or check the units of the part."
        )
    return Bin(size, WALL_HEIGHT * diameter)


def camera_above(sensor: Sensor) -> Float[np.ndarray, "4 4"]:
    """T_cam_bin of a camera that looks straight down from its working distance on the middle of the floor."""
    T_cam_bin = np.diag([1.0, -1.0, -1.0, 1.0])
    centre = np.array([(sensor.camera.width - 1) / 2, (sensor.camera.height - 1) / 2])
    T_cam_bin[:3, 3] = sensor.camera.unproject(centre, np.array(sensor.working_distance))
    return T_cam_bin


def walls_of(bin_: Bin, sensor: Sensor) -> BinWalls:
    """The bin as an obstacle, in the frame of the camera above it."""
    return BinWalls(bin_.inner_size, bin_.wall_height, bin_.wall_thickness, camera_above(sensor))


def bin_ray_mesh(bin_: Bin, device: str | None = None) -> RayMesh:
    """The bin on its table, which reaches beyond the image, as a mesh of one component face."""
    vertices, triangles = bin_mesh(bin_.inner_size, bin_.wall_thickness, bin_.wall_height)
    x, y = TABLE * np.asarray(bin_.inner_size)
    table = np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
    vertices = np.concatenate([vertices, np.column_stack([table, np.full(4, -bin_.wall_thickness)])])
    triangles = np.concatenate([triangles, np.array([[0, 1, 2], [0, 2, 3]]) + len(vertices) - 4])
    return ray_mesh(vertices, triangles, np.zeros(len(triangles), dtype=np.int32), device)
