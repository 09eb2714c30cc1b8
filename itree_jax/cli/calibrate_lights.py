"""`itree calibrate-lights`: photographs of a sphere -> light directions, or positions, and intensities."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from itree_kernels.errors import ItreeError
from itree_kernels.whole_files import write_whole

from itree_jax.cli.outputs import check_file
from itree_jax.cli.terminal import output, progress, say

if TYPE_CHECKING:
    from rich.table import Table

    from itree_jax.sensing.light_calibration.calibrate import Calibration, SphereImages
    from itree_jax.sensor import Sensor


@dataclass(frozen=True)
class CalibrateLights:
    """Find the lights from photographs of a mirror sphere or a matte sphere, one image under each light."""

    images: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="IMAGES...")]
    """Folder with one image per light in the order of their numbers, and a mask (sphere white) named so. Several
    folders are several places of the same sphere."""
    sphere: Annotated[Literal["chrome", "matte"], tyro.conf.arg(metavar="chrome|matte")]
    """What it is: a mirror, of which the highlight is used, or white and dull, of which the shading is."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="lights.json")]
    """File to write: what "lights" of a sensor JSON holds."""
    mask: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Mask of the sphere, with one folder of images whose mask is not in it."""
    camera: Annotated[str | None, tyro.conf.arg(metavar="SENSOR")] = None
    """Sensor JSON (its "lights" may be missing), scene folder or bundled:NAME; none: an orthographic camera."""
    near: bool = False
    """Near point lights: positions, from two or more places. Needs a pinhole --camera and --radius-mm."""
    radius_mm: Annotated[float | None, tyro.conf.arg(metavar="R")] = None
    """Radius of the sphere [mm]."""
    intensities_from: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")] = None
    """Photographs of a matte sphere under the same lights, for the intensities that a mirror sphere can't tell."""
    channel: Literal["mean", "red", "green", "blue"] = "mean"
    """What to take of images with colour: one channel, or the mean of the three, which must be linear (no gamma)."""
    picture: Annotated[Path | None, tyro.conf.arg(metavar="FILE.png")] = None
    """Draw the fit: outline, highlight, predicted shading and what is left."""
    quiet: bool = False
    """Show nothing but warnings and errors."""

    def run(self) -> None:
        """Raises ItreeError about images, mask or camera, before anything is written."""
        self._check()
        with progress(self.quiet) as tell:
            tell("loading", 0.0)
            from itree_jax.sensing.light_calibration.calibrate import calibrate, load_sphere
            from itree_jax.sensing.sensor_file import load_unlit_sensor

            sensor = None if self.camera is None else load_unlit_sensor(self.camera)
            if self.near and (sensor is None or sensor.camera.is_orthographic):
                raise ItreeError(
                    "--near needs --camera with a pinhole camera: an orthographic one cannot tell how far the sphere is"
                )
            radius = 1.0 if self.radius_mm is None else self.radius_mm
            places = [load_sphere(folder, sensor, self.mask, self.channel, radius) for folder in self.images]
            matte = None
            if self.intensities_from is not None:
                matte = load_sphere(self.intensities_from, sensor, None, self.channel, radius)
            tell("fitting", 0.5)
            near_at = sensor.working_distance if self.near and sensor is not None else None
            found = calibrate(places, self.sphere, near_at, matte)
            if self.picture is not None:
                write_whole(self.picture, _drawn(places, found, matte))
            write_whole(self.output, json.dumps(found.to_json(), indent=2) + "\n")
        if not self.quiet:
            output().print(light_table(found, places))
        say(f"{self.output}: {len(found.directions)} lights ({self._how(places, sensor)})", self.quiet)

    def _check(self) -> None:
        check_file(self.output)
        check_file(self.picture)
        if not self.images:
            raise ItreeError("no IMAGES are given: a folder with one photograph of the sphere under each light")
        if self.mask is not None and len(self.images) > 1:
            raise ItreeError("--mask goes with one folder of images; with several, put each one's mask into it")
        if self.near and (self.radius_mm is None or len(self.images) < 2):
            raise ItreeError("--near needs --radius-mm R, and folders of the sphere at two places or more")
        if self.radius_mm is not None and not self.radius_mm > 0.0:
            raise ItreeError(f"--radius-mm must be positive, it is {self.radius_mm}")
        if self.intensities_from is not None and (self.sphere == "matte" or self.near):
            raise ItreeError("--intensities-from goes with --sphere chrome and distant lights")

    def _how(self, places: "list[SphereImages]", sensor: "Sensor | None") -> str:
        camera = "orthographic camera assumed" if sensor is None else f"{sensor.camera.kind} camera"
        return f"{camera}, outline within {max(p.sphere.outline_rms for p in places):.2f} px rms"


def light_table(found: "Calibration", places: "list[SphereImages]") -> "Table":
    """A row for each light."""
    import numpy as np
    from rich.table import Table

    near = found.positions is not None
    heads = ["light", "image", "direction x", "y", "z", "off axis [deg]"]
    heads += ["position [mm] x", "y", "z", "rays miss [mm]"] if near else []
    heads += ["intensity", "shading residual [%]" if found.shading_residuals is not None else "highlight radius [px]"]
    table = Table(*heads)
    for k, direction in enumerate(found.directions):
        row = [str(k), Path(places[0].names[k]).name, *(f"{x:+.4f}" for x in direction)]
        row.append(f"{np.degrees(np.arccos(-direction[2])):.1f}")
        if found.positions is not None and found.misses is not None:
            row += [*(f"{x:.1f}" for x in found.positions[k]), f"{found.misses[k]:.2f}"]
        row.append(f"{found.intensities[k]:.4f}")
        if found.shading_residuals is not None:
            row.append(f"{100 * found.shading_residuals[k]:.2f}")
        elif found.highlights is not None:
            row.append(f"{max(h.radius[k] for h in found.highlights):.1f}")
        table.add_row(*row)
    return table


def _drawn(places: "list[SphereImages]", found: "Calibration", matte: "SphereImages | None") -> bytes:
    from itree_jax.report.light_pictures import calibration_picture
    from itree_jax.sensing.image_file import png_bytes

    return png_bytes(calibration_picture(places, found, matte))
