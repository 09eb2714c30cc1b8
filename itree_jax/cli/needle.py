"""`itree needle`: photometric stereo alone, images -> needle map."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from itree_kernels.errors import ItreeError
from itree_kernels.whole_files import write_whole

from itree_jax.cli.outputs import check_folder, staged_folder
from itree_jax.cli.runtime import start_jax
from itree_jax.cli.terminal import output, progress, say

if TYPE_CHECKING:
    from rich.table import Table

    from itree_jax.sensing.needle import NeedleMap
    from itree_jax.sensing.needle_input import NeedleInput


@dataclass(frozen=True)
class Needle:
    """Photometric stereo alone: surface normals and albedo from one image under each light.

    Writes normals.npy (float32, unit, camera frame: x right, y down, z forward, NaN where none), albedo.npy,
    uncertainty.npy (standard deviation [rad]), mask.png, normals.png (16 bit, red green blue = x y z, 0..65535 for
    -1..1) and needles.png.
    """

    images: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="IMAGES")]
    """Scene folder, or a folder with one image per light in the order of their numbers (or of its filenames.txt) and,
    if only a part of them counts, a mask."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="DIR")]
    """Folder to write."""
    lights: Annotated[str | None, tyro.conf.arg(metavar="LIGHTS")] = None
    """Lights or sensor JSON, scene folder, bundled:NAME, or folder with light_directions.txt in DiLiGenT's frame (x
    right, y up, z to the viewer); none: IMAGES tells them."""
    method: Annotated[Literal["robust", "least-squares"], tyro.conf.arg(metavar="robust|least-squares")] = "robust"
    """Leave out shadows and highlights, or take every light at every pixel."""
    channel: Literal["mean", "red", "green", "blue"] | None = None
    """What to take of images with colour, which must be linear; none: colour is refused, unless IMAGES tells the
    lights' colours."""
    ambient: Annotated[Path | None, tyro.conf.arg(metavar="IMAGE")] = None
    """Image with every lamp off, to be subtracted."""
    albedo_tolerance: Annotated[float | None, tyro.conf.arg(metavar="SHARE")] = None
    """Leave out pixels whose albedo differs by more from the dominant one, for scenes of one material (robust only)."""
    material: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")] = None
    """Images of a sphere of the parts' material under the same lights, with its mask: the normal is then read as that
    material shows it, not by Lambert's law (robust only)."""
    quiet: bool = False
    """Show nothing but warnings and errors."""

    def run(self) -> None:
        """Raises ItreeError about images or lights; the folder is written whole or not at all."""
        check_folder(self.output)
        if self.albedo_tolerance is not None and (self.method != "robust" or not self.albedo_tolerance > 0.0):
            raise ItreeError("--albedo-tolerance must be a positive share such as 0.2, and goes with --method robust")
        if self.material is not None and self.method != "robust":
            raise ItreeError("--material goes with --method robust")
        with progress(self.quiet) as tell:
            tell("loading", 0.0)
            start_jax()
            from itree_jax.sensing.needle_files import write_needle_map
            from itree_jax.sensing.needle_input import load_needle_input

            given = load_needle_input(self.images, self.lights, self.channel, self.ambient)
            tell("photometric stereo", 0.3)
            needle = self._solve(given)
            with staged_folder(self.output) as stage:
                there = write_needle_map(stage, needle, given.mask)
                write_whole(stage / "needles.png", _drawn(given, needle, there))
        if not self.quiet:
            output().print(_table(given, needle, there))
        say(f"{self.output}: normals, albedo, uncertainty, mask", self.quiet)

    def _solve(self, given: "NeedleInput") -> "NeedleMap":
        import numpy as np

        from itree_jax.sensing.near_lights import lights_of
        from itree_jax.sensing.needle import NeedleMap
        from itree_jax.sensing.photometric import least_squares, needle_map
        from itree_jax.sensing.reading import read_needles

        if given.sensor.is_depth_camera:
            return read_needles(given.images, given.sensor, given.depth)
        images = np.where(given.mask, given.images, np.float32(0.0))  # the dominant albedo is that inside
        if self.method == "robust":
            found = needle_map(images, given.sensor, given.depth, self.albedo_tolerance)
            if self.material is not None:
                found = self._by_material(NeedleMap(*(np.asarray(a) for a in found)), given)
        else:
            found = least_squares(images, *lights_of(given.sensor, given.depth), given.sensor.noise)
        return NeedleMap(*(np.asarray(a) for a in found))


    def _by_material(self, needle: "NeedleMap", given: "NeedleInput") -> "NeedleMap":
        from itree_jax.sensing.light_calibration.calibrate import load_sphere
        from itree_jax.sensing.material_response import apply_response
        from itree_jax.sensing.sphere_response import response_of_sphere

        assert self.material is not None
        place = load_sphere(self.material, given.sensor, None, self.channel or "mean")
        if len(place.images) != given.sensor.light_count:
            raise ItreeError(
                f"{self.material}: {len(place.images)} images of the sphere, but {given.sensor.light_count} lights"
            )
        return apply_response(needle, response_of_sphere(place.images, given.sensor, place.sphere))


def _drawn(given: "NeedleInput", needle: "NeedleMap", there: object) -> bytes:
    """Needles on the brightest of the images at each pixel; of a depth camera, as a light beside it would show them."""
    import numpy as np

    from itree_jax.report.scene_pictures import displayed, needle_lines, white_level
    from itree_jax.report.scene_view import head_light
    from itree_jax.sensing.image_file import png_bytes

    images = given.images if len(given.images) else head_light(needle)[None]
    inside = images[:, given.mask]
    white = white_level(inside[:, :, None]) if inside.size else 1.0
    shown = needle._replace(interpretable=np.asarray(there))
    return png_bytes(needle_lines(displayed(images.max(0), white), shown, 1.0))


def _table(given: "NeedleInput", needle: "NeedleMap", there: object) -> "Table":
    import numpy as np
    from rich.table import Table

    from itree_jax.sensing.needle_files import uncertainty

    mask = np.asarray(there)
    share = 100.0 * mask.sum() / max(int(given.mask.sum()), 1)
    albedo = f"{np.median(needle.albedo[mask]):.3f}" if mask.any() else "-"
    std = f"{np.degrees(np.median(uncertainty(needle)[mask])):.2f}" if mask.any() else "-"
    table = Table("lights", "pixels asked for", "with a normal [%]", "median albedo", "median std [deg]")
    table.add_row(str(len(given.images)), str(int(given.mask.sum())), f"{share:.1f}", albedo, std)
    return table
