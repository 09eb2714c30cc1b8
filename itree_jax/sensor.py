"""The sensor: camera, lights, noise and the limits that make a face detectable (Ikeuchi 1987, sec. 2.1.1)."""

from dataclasses import dataclass

import numpy as np
from itree_kernels.camera import Camera
from jaxtyping import Bool, Float


@dataclass(frozen=True)
class Noise:
    """Shot noise, read noise and quantisation of the camera. An intensity of 1.0 is full scale."""

    full_well_e: float = 12000.0  # electrons at full scale; shot noise is the root of the electrons
    read_noise_e: float = 6.0  # [electrons]
    bits: int = 12  # quantisation


@dataclass(frozen=True)
class Sensor:
    """One camera with three or more switchable lights, distant ones or near points; or a depth camera.

    Detectable (sec. 2.1.1): a point is detectable when its slant is under `slant_limit` and no light is blocked there,
    by the surface itself (attached shadow) or by another part of it (cast shadow).

    A depth camera has no lights (`light_directions` [0, 3], `light_intensities` [0]): its needle map comes from the
    gradient of its depth map, whose noise is `depth_noise`; detectable is then what is slanted by less than the limit.
    """

    camera: Camera
    light_directions: Float[np.ndarray, "lights 3"]  # unit, from the scene toward the light, camera frame
    light_intensities: Float[np.ndarray, "lights"]  # relative; exposure is folded in
    noise: Noise
    slant_limit: float  # [rad], between the surface normal and the direction to the viewer
    smallest_region: float  # [mm^2] in the image plane: smaller regions are nondetectable
    working_distance: float  # [mm] from the camera to the parts; with an orthographic camera only a label
    distortion: tuple[float, ...] = ()  # OpenCV's k1 k2 p1 p2 [k3 ...]; images are undistorted on load
    gamma: float = 1.0  # response: stored value = intensity ** (1 / gamma)
    region_of_interest: Bool[np.ndarray, "height width"] | None = None  # True where parts may lie
    bit_depth: int | None = None  # full scale of stored integers is 2**bit_depth - 1; None: that of the file, 8 or 16

    # [mm], camera frame: near point lights (`sensing.near_lights`). Directions and intensities are then those where the
    # optical axis meets the working distance.
    light_positions: Float[np.ndarray, "lights 3"] | None = None

    # [mm] standard deviation of a depth camera's map; None of a camera with lights, whose depth maps tell their own
    depth_noise: float | None = None

    @property
    def light_count(self) -> int:
        return len(self.light_directions)

    @property
    def is_depth_camera(self) -> bool:
        return self.light_count == 0

    @property
    def mm_per_px(self) -> float:
        """Size of a pixel [mm] at the working distance."""
        return self.camera.mm_per_px(self.working_distance)
