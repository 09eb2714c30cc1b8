"""`itree simulate`: bins with known truth."""

import os
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Annotated, Literal

import tyro
from itree_kernels.errors import ItreeError

from itree_jax.cli.numbers import check_object_number, check_seed
from itree_jax.cli.outputs import check_folder, staged_folder
from itree_jax.cli.runtime import start_jax
from itree_jax.cli.terminal import progress, say


@dataclass(frozen=True)
class Simulate:
    """Drop parts into bins by physics (extra `sim`) and image them: a dataset with known poses."""

    model: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="MODEL")]
    """CAD file or bundled:NAME, as for `itree compile`."""
    sensor: Annotated[str, tyro.conf.arg(metavar="SENSOR")]
    """JSON file, scene folder whose camera and lights are taken, or bundled:NAME."""
    scenes: Annotated[int, tyro.conf.arg(metavar="N")]
    """Number of bins."""
    parts: Annotated[int, tyro.conf.arg(metavar="M")]
    """Parts dropped into each."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="DATASET")]
    """Folder to write; it must be new or empty."""
    units: Annotated[Literal["mm", "cm", "m", "in"] | None, tyro.conf.arg(metavar="mm|cm|m|in")] = None
    """Unit of the numbers in MODEL."""
    solid: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """Name or index of one solid of an assembly."""
    obj_id: Annotated[int, tyro.conf.arg(metavar="N")] = 1
    """Object number in the dataset."""
    second_camera: Annotated[float | None, tyro.conf.arg(metavar="MM")] = None
    """A second camera so far to the right of the first one, parallel to it."""
    seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Of the drops and the images; the same seed gives the same dataset."""
    quiet: bool = False
    """Show nothing but warnings and errors."""

    def run(self) -> None:
        """Raises ItreeError about model, sensor, numbers or output, or when the physics engine is missing."""
        check_folder(self.output)
        check_seed(self.seed)
        check_object_number(self.obj_id)
        if self.second_camera is not None and not (isfinite(self.second_camera) and self.second_camera != 0.0):
            raise ItreeError(f"--second-camera must be a distance in mm other than 0, it is {self.second_camera}")
        if self.output.is_dir() and os.listdir(self.output):
            raise ItreeError(f"{self.output} is not empty; remove it or choose another folder")
        with progress(self.quiet) as tell:
            tell("loading", 0.0)
            start_jax()
            from itree_cad.load import load_part

            from itree_jax.sensing.sensor_file import load_sensor
            from itree_jax.simulate import simulate

            part, sensor = load_part(self.model, self.units, self.solid), load_sensor(self.sensor)
            with staged_folder(self.output) as stage:
                simulate(
                    part, sensor, self.scenes, self.parts, stage, seed=self.seed, obj_id=self.obj_id,
                    second_camera=self.second_camera,
                    progress=lambda done, scenes: tell(f"scene {done} of {scenes}", done / scenes),
                )  # fmt: skip
        say(f"{self.output}: {self.scenes} scenes of up to {self.parts} parts '{part.name}'", self.quiet)
