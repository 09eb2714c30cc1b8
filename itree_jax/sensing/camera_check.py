"""Whether a camera matrix can be that of the images, and lengths in the unit that they should be in."""

import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError

WIDEST = np.radians(170.0)  # field of view: wider ones are no pinhole's
NARROWEST = np.radians(0.2)  # 3 mm at 900 mm
SQUARE = 2.0  # of fx to fy: pixels are square, or nearly
UNIT_RATIO = 20.0  # of two distances that should be alike: inches for mm make 25, metres 1000


def check_camera(camera: Camera, where: str) -> None:
    """Raises ItreeError, naming `where`, if focal lengths or principal point cannot belong to images of this size."""
    longer = max(camera.fx, camera.fy) / min(camera.fx, camera.fy)
    if not longer < SQUARE:
        raise ItreeError(f"{where}: fx is {camera.fx:.6g} and fy {camera.fy:.6g}: pixels cannot be so far from square")
    size = np.array([camera.width, camera.height])
    middle = np.array([camera.cx, camera.cy])
    if (middle < -size).any() or (middle > 2 * size).any():
        raise ItreeError(
            f"{where}: the principal point ({camera.cx:.6g}, {camera.cy:.6g}) is far outside of the image of "
            f"{size[0]} x {size[1]} px; was the camera calibrated at another image size?"
        )
    if camera.is_orthographic:
        return
    field = 2.0 * np.arctan(size.max() / (2.0 * min(camera.fx, camera.fy)))
    if not NARROWEST < field < WIDEST:
        raise ItreeError(
            f"{where}: with a focal length of {camera.fx:.6g} px, {size.max()} px see {np.degrees(field):.3g} degrees; "
            "give focal lengths in px (focal length in mm / size of a pixel in mm)"
        )


def check_distances(one: float, other: float, told: str) -> None:
    """Raises ItreeError if two distances [mm] that should be alike differ as by a wrong unit; `told` says which."""
    ratio = one / other
    if not 1.0 / UNIT_RATIO < ratio < UNIT_RATIO:
        raise ItreeError(f"{told}: {one:.4g} mm beside {other:.4g} mm; one of them is in another unit")
