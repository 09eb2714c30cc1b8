"""`itree compile`: CAD file + sensor -> tree file."""

import re
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from itree_jax.cli.numbers import check_object_number, check_seed
from itree_jax.cli.outputs import check_file
from itree_jax.cli.runtime import start_jax
from itree_jax.cli.terminal import progress, say


@dataclass(frozen=True)
class Compile:
    """Compile a CAD model for a sensor into an interpretation tree."""

    model: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="MODEL")]
    """STEP, STL, PLY, OBJ, 3MF or GLB file, part file (JSON), or bundled:NAME."""
    sensor: Annotated[str, tyro.conf.arg(metavar="SENSOR")]
    """JSON file, scene folder whose camera and lights are taken, or bundled:NAME."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="TREE")]
    """Tree file to write."""
    units: Annotated[Literal["mm", "cm", "m", "in"] | None, tyro.conf.arg(metavar="mm|cm|m|in")] = None
    """Unit of the numbers in MODEL; needed for STL, PLY and OBJ in anything but mm."""
    solid: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """Name or index of one solid of an assembly."""
    obj_id: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Object number in results; default: N of a file called obj_N, else 1."""
    policy: Literal["measured", "paper"] = "measured"
    """Rule of a node: the one of least measured error, or, as in the paper, the first under the error bound."""
    dome: Annotated[int, tyro.conf.arg(metavar="F")] = 1
    """Frequency of the dome: 60 F^2 views."""
    label_faces: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Most digits of a shape label, for a part that names no faces (default 8)."""
    seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Seed of the noisy draws; the same seed gives the same file."""
    quiet: bool = False
    """Show nothing but warnings and errors."""

    def run(self) -> None:
        """Raises ItreeError about the model, the sensor or the output."""
        check_file(self.output)
        check_seed(self.seed)
        check_object_number(self.obj_id)
        start = time.perf_counter()
        with progress(self.quiet) as tell:
            tell("loading", 0.0)
            start_jax()
            from itree_cad.load import load_part

            from itree_jax.compile import compile_tree
            from itree_jax.sensing.sensor_file import load_sensor
            from itree_jax.tree.tree_file import save_tree

            part, sensor = load_part(self.model, self.units, self.solid), load_sensor(self.sensor)
            tree = compile_tree(
                part, sensor, obj_id=self._object_number(), policy=self.policy, dome_frequency=self.dome,
                label_faces=self.label_faces, seed=self.seed, report=tell,
            )  # fmt: skip
            save_tree(tree, self.output)
        kept = int((~tree.groups.pruned).sum())
        say(
            f"{self.output}: {part.name}, {part.diameter:.1f} mm across, object {tree.obj_id}: "
            f"{tree.groups.group_count} attitude groups, {kept} of them leaves, {len(tree.nodes.branch)} branches; "
            f"{time.perf_counter() - start:.0f} s. `itree show {self.output}` tells more.",
            self.quiet,
        )

    def _object_number(self) -> int:
        if self.obj_id is not None:
            return self.obj_id
        named = re.fullmatch(r"obj_(\d+)", Path(self.model).stem)
        return int(named.group(1)) if named else 1
