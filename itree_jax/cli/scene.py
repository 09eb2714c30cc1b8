"""`itree scene`: images from a camera -> a scene folder."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from itree_kernels.errors import ItreeError

from itree_jax.cli.runtime import start_jax
from itree_jax.cli.terminal import say

if TYPE_CHECKING:
    from itree_jax.sensing.capture import Captured

FILE = tyro.conf.arg(metavar="FILE")


@dataclass(frozen=True)
class MakeScene:
    """Make a scene folder from one image per light, after checking exposure and the order of the lights."""

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="NEW_FOLDER")]
    """Scene folder to write; its name should be the scene's number, such as 000001."""
    images: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="IMAGES...")]
    """One image per light, in the order of the sensor's lights."""
    sensor: Annotated[str, tyro.conf.arg(metavar="SENSOR")]
    """JSON file, scene folder whose camera and lights are taken, or bundled:NAME."""
    ambient: Annotated[Path | None, FILE] = None
    """Image of the scene with every lamp off, at the same exposure; it is subtracted."""
    depth: Annotated[Path | None, FILE] = None
    """Depth map of the same camera."""
    depth_scale: Annotated[float, tyro.conf.arg(metavar="MM")] = 1.0
    """Millimetres per step of the depth map."""
    camera_pose: Annotated[Path | None, FILE] = None
    """JSON {"R": [9], "t": [3, mm]}, world (z up) to camera; default: the camera looks straight down."""
    right_images: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="IMAGES...")] = ()
    """Of a second camera, one per light."""
    right_sensor: Annotated[str | None, tyro.conf.arg(metavar="SENSOR")] = None
    """The second camera, with the lights in its own frame."""
    right_pose: Annotated[Path | None, FILE] = None
    """JSON {"R": [9], "t": [3, mm]} of the second camera: X_right = R X_left + t."""
    right_ambient: Annotated[Path | None, FILE] = None
    """The second camera's image with every lamp off."""
    quiet: bool = False
    """Show nothing but warnings and errors."""

    def run(self) -> None:
        """Raises ItreeError about an image, the sensor or the output, before anything is written."""
        self._check()
        start_jax()
        from itree_jax.sensing.capture import capture, read_pose
        from itree_jax.sensing.scene_writer import write_scene
        from itree_jax.sensing.sensor_file import load_sensor

        pose = None if self.camera_pose is None else read_pose(self.camera_pose)
        number = int(self.folder.name) if self.folder.name.isdecimal() else 0
        left = capture(
            self.images, load_sensor(self.sensor), scene_id=number,
            ambient=self.ambient, depth=self.depth, depth_scale=self.depth_scale, camera_pose=pose,
        )  # fmt: skip
        right = self._right(left)
        for warning in (*left.warnings, *(right.warnings if right else ())):
            print(f"itree: warning: {warning}", file=sys.stderr)
        other = None if right is None else right.scene
        write_scene(self.folder, left.scene, None, right=other, depth_scale=left.depth_scale)
        cameras = "" if right is None else ", two cameras"
        depth = "" if self.depth is None else ", depth"
        say(f"{self.folder}: {len(self.images)} lights{depth}{cameras}", self.quiet)

    def _check(self) -> None:
        if self.folder.exists():
            raise ItreeError(f"{self.folder} exists already; give the name of a new folder")
        if not self.folder.absolute().parent.is_dir():
            raise ItreeError(f"there is no folder {self.folder.parent} to make {self.folder.name} in; make it first")
        if not self.images:
            raise ItreeError("no images are given; give one for each light, in the order of the sensor's lights")
        of_right = (bool(self.right_images), self.right_sensor is not None, self.right_pose is not None)
        if any(of_right) and not all(of_right):
            raise ItreeError("a second camera needs all of --right-images, --right-sensor and --right-pose")
        if self.right_ambient is not None and not self.right_images:
            raise ItreeError("--right-ambient is given without --right-images")

    def _right(self, left: "Captured") -> "Captured | None":
        from itree_jax.sensing.capture import RIGHT_IM_ID, capture, read_pose, second_camera
        from itree_jax.sensing.sensor_file import load_sensor

        if self.right_sensor is None or self.right_pose is None:
            return None
        right = capture(
            self.right_images, load_sensor(self.right_sensor), scene_id=left.scene.scene_id, im_id=RIGHT_IM_ID,
            ambient=self.right_ambient,
        )  # fmt: skip
        return second_camera(left, right, read_pose(self.right_pose))
